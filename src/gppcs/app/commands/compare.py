"""The command `gppcs compare`: several methods, or ways to a mesh, on one cloud, as tables and a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from gppcs.app import options
from gppcs.app.pages import how_made, rebuilt
from gppcs.app.panels import LOOK, METHOD
from gppcs.app.printing import names_of, print_error, print_json, say, started
from gppcs.clouds.quantities import count_of, share_of
from gppcs.errors import OutputError, ParameterError
from gppcs.methods import METHODS

if TYPE_CHECKING:
    from gppcs.app.tables import Row
    from gppcs.clouds.cloud import PointCloud
    from gppcs.clouds.mesh import Mesh
    from gppcs.drawing.viewpoint import Viewpoint
    from gppcs.drawing.web.contents import Named
    from gppcs.evaluation.comparison import Entry
    from gppcs.evaluation.mesh_comparison import MeshEntry

ADVICE = "; give a mesh with --mesh"  # where the original is too large to be rebuilt
EPILOG = (
    "gppcs compare scan.ply --ratio 3% -o comparison\n\n"
    "gppcs compare scan.ply --points 5k --methods fps,hc,wlop --mesh surface.ply -o comparison\n\n"
    "gppcs compare scan.ply --ratio 3% --meshes -o meshes\n\n"
    "gppcs compare scan.ply --ratio 3% --meshes --methods mesh,poisson-decimated -o meshes\n\n"
    "[bold]Ways to a mesh[/bold]\n\n"
    "mesh, mesh-moved, mesh-effort: gppcs mesh, without and with --moved, and with --effort 2\n\n"
    "poisson-kept, ball-pivoting, advancing-front: gp keeps points; then screened Poisson reconstruction, ball "
    "pivoting or CGAL's advancing front (needs the extra cgal) makes a mesh of them\n\n"
    "poisson-decimated: screened Poisson reconstruction of all points, then decimation\n\n"
    "gppcs evaluate --help defines the figures of the tables."
)


def compare(
    context: typer.Context,
    cloud: Path = options.CLOUD,
    output: Path = options.output(
        "DIR", "The folder for table.csv, table.md, picture.png and report.html. It is created if it does not exist."
    ),
    ratio: str | None = options.RATIO,
    points: str | None = options.POINTS,
    meshes: bool = options.flag(
        "--meshes",
        "Compare ways to make a light mesh instead of methods. They are listed below. Needs the extra evaluate.",
        METHOD,
    ),
    methods: str | None = options.option(
        "NAME,...",
        "Names of the methods, separated by commas, in the order of the table. See gppcs methods. With "
        "--meshes, names of ways to a mesh; by default all ways whose packages are installed.",
        METHOD,
        show_default="all",
    ),
    mesh: Path | None = options.option(
        None, "A mesh file of the true surface of IN. The meshes that are made or rebuilt are compared with it.", LOOK
    ),
    seed: int | None = options.SEED,
    detail: list[str] | None = options.option(
        "NAME[:WEIGHT]",
        "Measure the error of this attribute, too, and let it count in the choice of gp: rgb, a number or classes. "
        "Can be repeated.",
        METHOD,
    ),
    input_format: str | None = options.FROM,
    columns: str | None = options.COLUMNS,
    drop: options.Invalid | None = options.DROP_INVALID,
    picture: bool = options.option(
        None,
        "Draw the clouds and the meshes rebuilt from them. Needs the extras view and evaluate.",
        LOOK,
        default=True,
    ),
    colour: str | None = options.COLOUR,
    report: bool = options.flag(
        "--report",
        "Also write report.html, a page that shows all clouds and the meshes of the picture in the browser; "
        "see gppcs report.",
        LOOK,
    ),
    view: str | None = options.VIEW,
    up: options.Axis | None = options.UP,
    threads: int | None = options.THREADS,
    force: bool = options.FORCE,
    quiet: bool = options.QUIET,
    as_json: bool = options.JSON,
) -> None:
    """Simplify a cloud by several methods, evaluate each result, and write tables and a picture.

    With --meshes, make a light mesh of the cloud in several ways instead.
    """
    from gppcs import io
    from gppcs.app.console import print_comparison
    from gppcs.app.tables import Row, as_csv, as_markdown
    from gppcs.drawing.attributes import Colourable
    from gppcs.drawing.web.contents import Named, report_page
    from gppcs.engine.extras import require_all, require_matplotlib, require_pymeshlab, require_pyvista
    from gppcs.evaluation.comparison import checked_methods
    from gppcs.evaluation.comparison import compare as compared
    from gppcs.evaluation.mesh_comparison import checked_ways, compare_meshes
    from gppcs.evaluation.mesh_ways import require_way
    from gppcs.io.mesh_files import read_mesh

    timer = started(quiet, threads)
    share = None if ratio is None else share_of("ratio", ratio)
    count = None if points is None else count_of("n_points", points)
    counted = options.weights_of(detail)
    for wrong, message in (
        (meshes and seed is not None, "expected --seed without --meshes, whose ways draw no random numbers"),
        (meshes and counted, "expected --detail without --meshes, whose ways look at no attributes"),
        (
            (view or up) and not (picture or report),
            "expected a picture or --report to turn with --view and --up, found neither; leave out --no-picture",
        ),
        (colour and not picture, "expected a picture to colour by --colour, found none; leave out --no-picture"),
    ):
        if wrong:
            raise ParameterError(message)
    if picture:
        ways = (partial(require_way, name) for name in names_of(methods) or ())
        require_all(require_pymeshlab, require_matplotlib, require_pyvista, *ways)
    work: Any
    if meshes:
        work = partial(compare_meshes, ways=checked_ways(names_of(methods), share, count))
    else:
        checked_methods(names_of(methods) or METHODS, share, count, seed)
        work = partial(compared, methods=names_of(methods) or None, seed=seed, detail=counted)
    viewpoint, inputs = options.viewpoint_of(view, up), [cloud, *filter(None, [mesh])]
    names = ["table.csv", "table.md", *(["picture.png"] if picture else []), *(["report.html"] if report else [])]
    _check_folder(output, names, inputs, force)
    surface = read_mesh(mesh) if mesh else None
    original = io.read(cloud, input_format, names_of(columns))
    if colour is not None:
        Colourable.of(original).require(colour)
    entries = work(
        original, ratio=share, n_points=count, mesh=surface, invalid="drop" if drop else "error", timer=timer
    )
    rows = [Row.of(entry) for entry in entries]
    if not (meshes or methods) and (missing := METHODS.keys() - {row.name for row in rows}):
        print_error(f"note: {cloud}: left out, as memory is too small: {', '.join(sorted(missing))}")
    with timer("tables and picture"):
        contents = {"table.csv": as_csv(rows).encode(), "table.md": as_markdown(rows).encode()}
        shown = _meshes(entries) if meshes else _clouds(entries, original, surface, picture)
        if not meshes and picture and surface is None:
            surface = rebuilt("the original", finite := original.take(original.finite_rows()), finite, ADVICE)
        if picture:
            contents["picture.png"] = _drawn(original, surface, shown, rows, viewpoint, colour)
    if report and shown:  # without results no way has found a surface, and the notes say so
        made = how_made(context.obj, inputs)
        page = BytesIO()
        report_page(Named(cloud.name, original, surface), shown, made, viewpoint, timer, list(counted)).write(page)
        contents["report.html"] = page.getvalue()
    output.mkdir(exist_ok=True)
    for name, content in contents.items():
        with io.whole_file(output / name, force) as file:
            file.write(content)
    if not (as_json or quiet):
        print_comparison(rows)
        say(f"{output}: {', '.join(contents)}")
    for row in rows:
        if as_json:
            parameters = {"parameters": row.parameters} if row.kind == "method" else {}
            measured = {"seconds": row.seconds, "figures": row.figures, "relative": row.relative}
            print_json({row.kind: row.name, **parameters, **measured, "failure": row.failure})
        if row.failure:
            print_error(f"note: {row.label}: {row.failure}")


def _clouds(entries: Sequence[Entry], original: PointCloud, surface: Mesh | None, drawn: bool) -> list[Named]:
    """Return the simplified clouds, with their surfaces if these were compared or are drawn."""
    from gppcs.drawing.web.contents import Named
    from gppcs.evaluation.comparison import rebuilt_mesh, trimmed_mesh

    finite, shown = original.take(original.finite_rows()), []
    for entry in entries:
        result, mesh = entry.result, None
        if surface:
            mesh = trimmed_mesh(entry.report.rebuilt.mesh, finite) if entry.report.rebuilt else None
        elif drawn:
            mesh = rebuilt_mesh(result.cloud, finite)
        shown.append(Named(str(result.method), result.cloud, mesh, result.method.summary))
    return shown


def _meshes(entries: Sequence[MeshEntry]) -> list[Named]:
    """Return the meshes that were found with the vertices that triangles have."""
    import numpy as np

    from gppcs.clouds.cloud import PointCloud
    from gppcs.drawing.web.contents import Named

    return [
        Named(way, PointCloud(mesh.vertices[np.unique(mesh.faces)]), mesh, f"it is a vertex of the mesh by {way}")
        for way, mesh in ((entry.way, entry.mesh) for entry in entries if entry.report)
        if mesh
    ]


def _drawn(
    original: PointCloud,
    surface: Mesh | None,
    shown: Sequence[Named],
    rows: Sequence[Row],
    viewpoint: Viewpoint,
    colour: str | None,
) -> bytes:
    """Return a PNG of the original and each result, in the colours of the nearest original points, and their meshes."""
    from gppcs.drawing.paint import painted
    from gppcs.drawing.side_by_side import Column, draw_comparison

    everything, legend = painted(original.take(original.finite_rows()), colour)
    columns = [Column("original", everything, "", surface)]
    captions = {row.label: _caption(row.relative) for row in rows if row.relative}
    counted: Literal["points", "vertices"] = "points" if rows[0].kind == "method" else "vertices"
    for each in shown:
        kept = everything.at(each.cloud.points)
        columns.append(Column(each.name, kept, captions[each.name], each.mesh, counted))
    image = BytesIO()
    draw_comparison(image, columns, viewpoint, legend)
    return image.getvalue()


def _caption(relative: Mapping[str, float]) -> str:
    """Return the mean error of a result, in diagonals of the original's bounding box."""
    name = next(name for name in ("mesh_mean", "hausdorff_mean", "surface_mean") if name in relative)
    return f"{name.replace('_', ' ')}\n{relative[name]:.2e} diagonals"


def _check_folder(folder: Path, names: list[str], inputs: list[Path], force: bool) -> None:
    """Check that files of these names can be written in a folder."""
    from gppcs.io import check_distinct, check_writable, is_standard

    for wrong, message in (
        (is_standard(folder), "expected a folder, found the name of standard output; name a folder"),
        (folder.exists() and not folder.is_dir(), "expected a folder, found a file; name a folder"),
        (folder.is_symlink() and not folder.exists(), "expected a folder, found a link to nothing; name a folder"),
        (
            not force and folder.is_dir() and any(folder.iterdir()),
            "expected a new or empty folder, found one with files; choose another, or use --force to overwrite earlier "
            "tables and pictures in it",
        ),
        (not folder.absolute().parent.is_dir(), "expected an existing parent folder, found none; make it first"),
    ):
        if wrong:
            raise OutputError(f"{folder}: {message}")
    targets = [folder / name for name in names]
    check_distinct(targets, inputs)
    for target in targets:
        check_writable(target, force, makes_folders=True)
