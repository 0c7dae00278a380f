"""Shows clouds and results in the viewer, in a notebook or in the browser."""

import sys
import tempfile
import time
import webbrowser
from contextlib import suppress
from html import escape
from pathlib import Path

from gppcs.clouds.cloud import CloudLike
from gppcs.drawing.camera import Viewpoint
from gppcs.drawing.web.contents import Named, report_page, view_page
from gppcs.engine.timer import in_words
from gppcs.io.reading import as_cloud
from gppcs.result import Result


def show(
    cloud: CloudLike | Result,
    original: CloudLike | None = None,
    *,
    up: str | None = None,
    view: tuple[float, float] | None = None,
) -> None:
    """Show a cloud or a result in the viewer: below the cell of a notebook, otherwise in the browser.

    Parameters
    ----------
    cloud : Result, PointCloud, (N, 3) array-like, path or object that `PointCloud.from_object` takes
    original : PointCloud and so on, optional
        The cloud that was simplified. It is shown beside the other, with figures, as `gppcs report` does.
    up : str, optional
        The axis that points up: x, y, z, -x, -y or -z. Guessed by default.
    view : (azimuth, elevation), optional
        Direction of the first view, in degrees. Guessed by default.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> gppcs.show(gppcs.simplify(cloud, ratio=0.1), cloud)  # doctest: +SKIP
    """
    viewpoint = Viewpoint(up, view)
    if isinstance(cloud, Result):
        named = Named(str(cloud.method), cloud.cloud, reason=cloud.method.summary)
        made = [("method", repr(cloud.method)), ("time", in_words(cloud.seconds))]
    else:
        named, made = Named("cloud", as_cloud(cloud)), []
    if original is None:
        page = view_page([named], made, viewpoint)
    else:
        page = report_page(Named("original", as_cloud(original)), [named], made, viewpoint)
    ipython = sys.modules.get("IPython")
    in_notebook = ipython is not None and hasattr(ipython.get_ipython(), "kernel")
    (_embed if in_notebook else _open)(page.content())


def _embed(page: bytes) -> None:
    """Show a page below the cell. The page's own policy lets no other script run, whatever names contain."""
    from IPython.display import HTML, display

    style = "width:100%;height:720px;border:0"
    frame = f'<iframe title="Point clouds" srcdoc="{escape(page.decode())}" style="{style}"></iframe>'
    display(HTML(f"<div>{frame}</div>"))  # IPython warns of a bare frame


def new_page() -> Path:
    """Return the name of a page for the browser in a new temporary folder, and remove pages that are a day old."""
    for page in Path(tempfile.gettempdir()).glob("gppcs-*/view.html"):
        with suppress(OSError):  # such as those of other users
            if time.time() - page.stat().st_mtime > 24 * 3600:
                page.unlink()
                page.parent.rmdir()
    return Path(tempfile.mkdtemp(prefix="gppcs-")) / "view.html"


def _open(page: bytes) -> None:
    """Open a page in the browser, or print where it is."""
    path = new_page()
    path.write_bytes(page)
    if not webbrowser.open(path.as_uri()):
        print(f"no browser was found; open {path} yourself")  # noqa: T201
