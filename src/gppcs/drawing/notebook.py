"""Shows clouds and results in a notebook: a small picture with a table, and the viewer."""

from __future__ import annotations

import base64
import tempfile
import webbrowser
from html import escape
from io import BytesIO
from pathlib import Path

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.drawing.single import draw_single
from gppcs.drawing.viewpoint import Viewpoint
from gppcs.drawing.web.contents import Named, report_page, view_page
from gppcs.engine.progress import in_notebook
from gppcs.engine.timer import in_words
from gppcs.errors import InputError, MissingExtraError
from gppcs.simplification import Result

THUMBNAIL = (320, 240)  # pixels
MOST_DRAWN = 50_000  # points; of a larger cloud, the small picture shows some
HEIGHT = 720  # pixels of the viewer
CELL = 'style="text-align:left;vertical-align:top"'


def html_of(shown: PointCloud | Result) -> str:
    """Return what a notebook shows of a cloud or a result."""
    cloud = shown.cloud if isinstance(shown, Result) else shown
    rows = {"points": f"{len(cloud):,}"}
    if isinstance(shown, Result):
        rows |= {"method": repr(shown.method), "time": in_words(shown.seconds)}
    finite = cloud.points[cloud.finite_rows()]
    if len(finite):
        corners = {"low corner": finite.min(axis=0), "high corner": finite.max(axis=0)}
        rows |= {name: "  ".join(f"{value:.6g}" for value in corner) for name, corner in corners.items()}
    if len(finite) < len(cloud):
        rows["not finite"] = f"{len(cloud) - len(finite):,}"
    if cloud.attributes:
        rows["attributes"] = ", ".join(f"{name} ({values.dtype})" for name, values in cloud.attributes.items())
    cells = (f"<tr><th {CELL}>{escape(name)}</th><td {CELL}>{escape(value)}</td></tr>" for name, value in rows.items())
    table = f"<table><caption {CELL}>{type(shown).__name__}</caption>{''.join(cells)}</table>"
    return f'<div style="display:flex;flex-wrap:wrap;gap:1em">{_picture(cloud)}{table}</div>'


def show(
    shown: PointCloud | Result,
    original: PointCloud | None = None,
    up: str | None = None,
    view: tuple[float, float] | None = None,
) -> None:
    """Show a cloud or a result in the viewer: below the cell of a notebook, otherwise in the browser."""
    viewpoint = Viewpoint(up, view)
    if isinstance(shown, Result):
        named = Named(str(shown.method), shown.cloud, reason=shown.method.summary)
        made = [("method", repr(shown.method)), ("time", in_words(shown.seconds))]
    else:
        named, made = Named("cloud", shown), []
    if original is None:
        page = view_page([named], made, viewpoint)
    else:
        page = report_page(Named("original", original), [named], made, viewpoint)
    content = BytesIO()
    page.write(content)
    (_embed if in_notebook() else _open)(content.getvalue())


def _picture(cloud: PointCloud) -> str:
    """Return a small picture as an element of HTML, or nothing if none can be drawn."""
    if len(cloud) > MOST_DRAWN:
        cloud = cloud.take(np.unique(np.random.default_rng(0).integers(len(cloud), size=MOST_DRAWN)))
    image = BytesIO()
    try:
        drawn = draw_single(image, cloud, size=THUMBNAIL, bar=False)
    except (InputError, MissingExtraError):
        return ""
    text = f"coloured by {drawn.colour}"
    width, height = THUMBNAIL
    content = base64.b64encode(image.getvalue()).decode()
    return f'<img src="data:image/png;base64,{content}" width="{width}" height="{height}" alt="{text}" title="{text}">'


def _embed(page: bytes) -> None:
    """Show a page below the cell. The page's own policy lets no other script run, whatever names contain."""
    from IPython.display import HTML, display

    style = f"width:100%;height:{HEIGHT}px;border:0"
    frame = f'<iframe title="Point clouds" srcdoc="{escape(page.decode())}" style="{style}"></iframe>'
    display(HTML(f"<div>{frame}</div>"))  # IPython warns of a bare frame


def _open(page: bytes) -> None:
    """Open a page in the browser, or print where it is."""
    path = Path(tempfile.mkdtemp(prefix="gppcs-")) / "view.html"
    path.write_bytes(page)
    if not webbrowser.open(path.as_uri()):
        print(f"no browser was found; open {path} yourself")  # noqa: T201
