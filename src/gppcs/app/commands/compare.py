"""The command `gppcs compare`: several methods, or ways to a mesh, on one cloud, as tables and a picture."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gppcs.app import options, panels
from gppcs.app.mesh_pictures import drawn_meshes, named_meshes
from gppcs.app.pages import how_made, rebuilt
from gppcs.app.printing import names_of, print_error, print_json, progress, say
from gppcs.app.viewpoint import require_picture, viewpoint_of
from gppcs.clouds.quantities import count_of, share_of
from gppcs.engine.threads import set_threads
from gppcs.errors import OutputError, ParameterError, file_path
from gppcs.methods import METHODS

if TYPE_CHECKING:
    from gppcs.app.tables import Row
    from gppcs.clouds.cloud import PointCloud
    from gppcs.clouds.mesh import Mesh
    from gppcs.drawing.viewpoint import Viewpoint
    from gppcs.drawing.web.contents import Named
    from gppcs.engine.timer import Timer
    from gppcs.evaluation.comparison import Entry

Work = Callable[..., Any]  # takes a cloud, mesh, invalid and timer, and returns the entries of a comparison
EPILOG = (
    "[bold]Examples[/bold]\n\n"
    "gppcs compare scan.ply --ratio 3% -o comparison\n\n"
    "gppcs compare scan.ply --points 5k --methods fps,hc,wlop --mesh surface.ply -o comparison\n\n"
    "gppcs compare scan.ply --ratio 3% --meshes -o meshes\n\n"
    "gppcs compare scan.ply --ratio 3% --meshes --methods mesh,poisson-decimated -o meshes\n\n"
    "[bold]Ways to a mesh[/bold]\n\n"
    "mesh, mesh-moved: gppcs mesh, without and with --moved\n\n"
    "poisson-kept, ball-pivoting, advancing-front: gp keeps points; then screened Poisson reconstruction, ball "
    "pivoting or CGAL's advancing front (needs the extra cgal) makes a mesh of them\n\n"
    "poisson-decimated: screened Poisson reconstruction of all points, then decimation\n\n"
    "gppcs evaluate --help defines the figures of the tables."
)


def compare(
    context: typer.Context,
    cloud: Annotated[
        Path, typer.Argument(metavar="IN", parser=file_path, help="A point cloud file.", show_default=False)
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            parser=file_path,
            help="The folder for table.csv, table.md, picture.png and report.html. It is created if it does not exist.",
        ),
    ],
    ratio: options.Ratio = None,
    points: options.Points = None,
    meshes: Annotated[
        bool,
        typer.Option(
            "--meshes",
            help="Compare ways to make a light mesh instead of methods. They are listed below. Needs the extra "
            "evaluate.",
            rich_help_panel=panels.METHOD,
        ),
    ] = False,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="Names of the methods, separated by commas, in the order of the table. See gppcs methods. With "
            "--meshes, names of ways to a mesh; by default all ways whose packages are installed.",
            show_default="all",
            rich_help_panel=panels.METHOD,
        ),
    ] = None,
    mesh: Annotated[
        Path | None,
        typer.Option(
            help="A mesh file of the true surface of IN. The meshes that are made or rebuilt are compared with it.",
            rich_help_panel=panels.LOOK,
        ),
    ] = None,
    seed: options.Seed = None,
    input_format: options.From = None,
    columns: options.Columns = None,
    drop: options.DropInvalid = None,
    picture: Annotated[
        bool,
        typer.Option(
            help="Draw the clouds and the meshes rebuilt from them. Needs the extras view and evaluate.",
            rich_help_panel=panels.LOOK,
        ),
    ] = True,
    colour: options.Colour = None,
    report: Annotated[
        bool,
        typer.Option(
            "--report",
            help="Also write report.html, a page that shows all clouds and the meshes of the picture in the browser; "
            "see gppcs report.",
            rich_help_panel=panels.LOOK,
        ),
    ] = False,
    view: options.View = None,
    up: options.Up = None,
    threads: options.Threads = None,
    force: options.Force = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Simplify a cloud by several methods, evaluate each result, and write tables and a picture.

    With --meshes, make a light mesh of the cloud in several ways instead.
    """
    from gppcs import io
    from gppcs.app.console import print_comparison
    from gppcs.app.tables import Row, as_csv, as_markdown
    from gppcs.drawing.attributes import Colourable
    from gppcs.drawing.web.contents import Named
    from gppcs.engine.timer import Timer
    from gppcs.io.mesh_files import read_mesh

    set_threads(threads)
    share = None if ratio is None else share_of("ratio", ratio)
    count = None if points is None else count_of("n_points", points)
    chosen = None if methods is None else [name.strip() for name in methods.split(",")]
    if meshes and seed is not None:
        raise ParameterError("expected --seed without --meshes, whose ways draw no random numbers")
    work = _of_ways(chosen, share, count) if meshes else _of_methods(chosen, share, count, seed)
    viewpoint = viewpoint_of(view, up, picture or report)
    require_picture(colour, picture)
    names = ["table.csv", "table.md", *(["picture.png"] if picture else []), *(["report.html"] if report else [])]
    targets = _targets([cloud, mesh] if mesh else [cloud], output, names, force)
    surface = read_mesh(mesh) if mesh else None
    timer = Timer(progress(quiet))
    original = io.read(cloud, input_format, names_of(columns))
    if colour is not None:
        Colourable.of(original).require(colour)
    entries = work(original, mesh=surface, invalid="drop" if drop else "error", timer=timer)
    rows = [Row.of(entry) for entry in entries]
    with timer("tables and picture"):
        contents = {"table.csv": as_csv(rows).encode(), "table.md": as_markdown(rows).encode()}
        surfaces = [surface] if meshes else _surfaces(original, entries, surface, picture)
        if picture and meshes:
            contents["picture.png"] = drawn_meshes(original, entries, surface, viewpoint, colour)
        elif picture:
            contents["picture.png"] = _drawn(original, entries, surfaces, viewpoint, colour)
    results = named_meshes(entries) if meshes else _named(entries, surfaces)
    if report and results:  # without results no way has found a surface, and the notes say so
        made = how_made(context.obj, [cloud, *([mesh] if mesh else [])])
        contents["report.html"] = _page(Named(cloud.name, original, surfaces[0]), results, made, viewpoint, timer)
    output.mkdir(exist_ok=True)
    for name, content in contents.items():
        with io.whole_file(targets[name], force) as file:
            file.write(content)
    if as_json:
        _print_records(rows)
    elif not quiet:
        print_comparison(rows)
        say(f"{output}: {', '.join(contents)}")
    for row in rows:
        if row.failure:
            print_error(f"note: {row.label}: {row.failure}")


def _of_methods(names: list[str] | None, ratio: float | None, n_points: int | None, seed: int | None) -> Work:
    """Return the comparison of methods, after checking its parameters."""
    from gppcs.evaluation.comparison import checked_methods
    from gppcs.evaluation.comparison import compare as compared

    chosen = checked_methods(METHODS if names is None else names, ratio, n_points, seed)
    return partial(compared, methods=chosen, ratio=ratio, n_points=n_points)


def _of_ways(names: list[str] | None, ratio: float | None, n_points: int | None) -> Work:
    """Return the comparison of ways to a mesh, after checking its parameters."""
    from gppcs.evaluation.mesh_comparison import checked_ways, compare_meshes

    return partial(compare_meshes, ways=checked_ways(names, ratio, n_points), ratio=ratio, n_points=n_points)


def _surfaces(original: PointCloud, entries: Sequence[Entry], surface: Mesh | None, wanted: bool) -> list[Mesh | None]:
    """Return the surface of the original, if known or wanted, and those rebuilt from the simplified clouds."""
    from gppcs.evaluation.comparison import rebuilt_mesh, trimmed_mesh

    original = original.take(original.finite_rows())
    if surface:
        measured = (entry.report.rebuilt for entry in entries)
        return [surface, *(trimmed_mesh(each.mesh, original) if each else None for each in measured)]
    if not wanted:
        return [None] * (1 + len(entries))
    return [
        rebuilt("the original", original, original, "; give a mesh with --mesh"),
        *(rebuilt_mesh(entry.result.cloud, original) for entry in entries),
    ]


def _named(entries: Sequence[Entry], surfaces: Sequence[Mesh | None]) -> list[Named]:
    """Return the simplified clouds with the names of the methods and their surfaces, for a page."""
    from gppcs.drawing.web.contents import Named

    return [
        Named(str(entry.result.method), entry.result.cloud, mesh, entry.result.method.summary)
        for entry, mesh in zip(entries, surfaces[1:], strict=True)
    ]


def _page(
    original: Named, results: Sequence[Named], made: list[tuple[str, str]], viewpoint: Viewpoint, timer: Timer
) -> bytes:
    """Return an HTML page of the original and each result."""
    from gppcs.drawing.web.contents import report_page

    page = BytesIO()
    report_page(original, results, made, viewpoint, timer).write(page)
    return page.getvalue()


def _drawn(
    original: PointCloud,
    entries: Sequence[Entry],
    meshes: Sequence[Mesh | None],
    viewpoint: Viewpoint,
    colour: str | None,
) -> bytes:
    """Return a PNG of the original and each simplified cloud, with the meshes rebuilt from them."""
    import numpy as np

    from gppcs.drawing.paint import painted
    from gppcs.drawing.side_by_side import Column, draw_comparison

    rows = original.finite_rows()
    everything, legend = painted(original.take(rows), colour)
    columns = [Column("original", everything, "", meshes[0])]
    for entry, mesh in zip(entries, meshes[1:], strict=True):
        kept = everything.kept(np.searchsorted(rows, entry.result.indices), entry.result.cloud.points)
        columns.append(Column(str(entry.result.method), kept, _caption(entry), mesh))
    image = BytesIO()
    draw_comparison(image, columns, viewpoint, legend)
    return image.getvalue()


def _caption(entry: Entry) -> str:
    """Return the mean error of a method, in diagonals of the original's bounding box."""
    figures = entry.report.figures(relative=True)
    name = "hausdorff_mean" if "hausdorff_mean" in figures else "surface_mean"
    return f"{name.replace('_', ' ')}\n{figures[name]:.2e} diagonals"


def _print_records(rows: Sequence[Row]) -> None:
    """Print the comparison as one JSON object for each method or way."""
    for row in rows:
        parameters = {} if row.parameters is None else {"parameters": row.parameters}
        measured = {"seconds": row.seconds, "figures": row.figures, "relative": row.relative}
        print_json({row.kind: row.name, **parameters, **measured, "failure": row.failure})


def _targets(inputs: list[Path], folder: Path, names: list[str], force: bool) -> dict[str, Path]:
    """Return the paths of the output files by name, after checking that each can be written."""
    from gppcs.engine.extras import require_pymeshlab, require_pyvista
    from gppcs.io import check_distinct, check_writable, is_standard

    if is_standard(folder):
        raise OutputError(f"{folder}: expected a folder, found the name of standard output; name a folder")
    if os.path.lexists(folder) and not folder.is_dir():
        found = "a file" if folder.exists() else "a link to nothing"
        raise OutputError(f"{folder}: expected a folder, found {found}; name a folder")
    if not force and folder.is_dir() and any(folder.iterdir()):
        raise OutputError(
            f"{folder}: expected a new or empty folder, found one with files; choose another, or use --force to "
            "overwrite earlier tables and pictures in it"
        )
    if not folder.absolute().parent.is_dir():
        raise OutputError(f"{folder}: expected an existing parent folder, found none; make it first")
    if "picture.png" in names:
        require_pymeshlab()
        require_pyvista()
    targets = {name: folder / name for name in names}
    check_distinct(list(targets.values()), inputs)
    for target in targets.values():
        check_writable(target, force, makes_folders=True)
    return targets
