"""The command `gppcs compare`: several methods, or pipelines to a mesh, on one cloud, as tables and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gppcs.app import options
from gppcs.app.options import LOOK, METHOD, option
from gppcs.app.pages import how_made, rebuilt
from gppcs.app.printing import emit, names_of, print_error, say, started
from gppcs.errors import OutputError, ParameterError
from gppcs.methods import METHODS

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud
    from gppcs.clouds.mesh import Mesh
    from gppcs.drawing.camera import Viewpoint
    from gppcs.drawing.web.contents import Named
    from gppcs.evaluation.comparison import Entry
    from gppcs.evaluation.mesh_comparison import MeshEntry

EPILOG = (
    "gppcs compare scan.ply --ratio 3% -o comparison\n\n"
    "gppcs compare scan.ply --points 5k --methods fps,hc,wlop --mesh surface.ply -o comparison\n\n"
    "gppcs compare scan.ply --ratio 3% --meshes -o meshes\n\n"
    "gppcs compare scan.ply --ratio 3% --meshes --methods mesh,poisson-decimated -o meshes\n\n"
    "[bold]Pipelines to a mesh[/bold]\n\n"
    "mesh, mesh-moved, mesh-effort: gppcs mesh, without and with --moved, and with --effort 2\n\n"
    "poisson-kept, ball-pivoting, advancing-front: gp keeps points; then screened Poisson reconstruction, ball "
    "pivoting or CGAL's advancing front (needs the extra cgal) makes a mesh of them\n\n"
    "poisson-decimated: screened Poisson reconstruction of all points, then decimation\n\n"
    "gppcs evaluate --help defines the figures of the tables."
)


def compare(
    context: typer.Context,
    cloud: options.Cloud,
    output: Annotated[
        Path,
        options.output("DIR", "The folder for table.csv, table.md, picture.png and report.html; it may be new."),
    ],
    ratio: options.Ratio = None,
    points: options.Points = None,
    meshes: Annotated[
        bool,
        option("Compare pipelines to a light mesh instead of methods. Needs the extra evaluate.", METHOD, "--meshes"),
    ] = False,
    methods: Annotated[
        str | None,
        option("Names of methods or pipelines, in the order of the table. By default all.", METHOD, metavar="NAME,..."),
    ] = None,
    mesh: Annotated[
        Path | None,
        option("A mesh file of the true surface of IN, to compare meshes with.", LOOK),
    ] = None,
    seed: options.Seed = None,
    detail: Annotated[
        list[str] | None,
        option("Let this attribute count in the choice of gp, and measure its error.", METHOD, metavar="NAME[:WEIGHT]"),
    ] = None,
    input_format: options.From = None,
    columns: options.Columns = None,
    invalid: options.Invalid = "error",
    picture: Annotated[
        bool, option("Draw the clouds and the meshes rebuilt from them. Needs the extras view and evaluate.", LOOK)
    ] = True,
    colour: options.Colour = None,
    report: Annotated[
        bool,
        option("Also write report.html, a page for the browser; see gppcs report.", LOOK, "--report"),
    ] = False,
    view: options.View = None,
    up: options.Up = None,
    threads: options.Threads = None,
    force: options.Force = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Simplify a cloud by several methods, evaluate each result, and write tables and a picture.

    With --meshes, make a light mesh of the cloud by several pipelines instead.
    """
    from gppcs import io
    from gppcs.app.tables import as_csv, as_markdown, columns_of, label_of, print_table, record_of
    from gppcs.drawing.colours import Colourable
    from gppcs.drawing.web.contents import Named, report_page
    from gppcs.evaluation.comparison import checked_methods
    from gppcs.evaluation.comparison import compare as compared
    from gppcs.evaluation.mesh_comparison import checked_pipelines, compare_meshes
    from gppcs.io.mesh_files import read_mesh

    timer, weights = started(quiet, threads), options.weights_of(detail)
    _check_options(meshes, seed, weights, picture, report, view or up, colour)
    if picture:
        _require_extras(names_of(methods) or ())
    work: Any
    if meshes:
        work = partial(compare_meshes, pipelines=checked_pipelines(names_of(methods), ratio, points))
    else:
        checked_methods(names_of(methods) or METHODS, ratio, points, seed)
        work = partial(compared, methods=names_of(methods) or None, seed=seed, detail=weights)
    viewpoint, inputs = options.viewpoint_of(view, up), [cloud, *filter(None, [mesh])]
    names = ["table.csv", "table.md", *(["picture.png"] if picture else []), *(["report.html"] if report else [])]
    _check_folder(output, names, inputs, force)
    surface = read_mesh(mesh) if mesh else None
    original = io.read(cloud, input_format, names_of(columns))
    if colour is not None:
        Colourable.from_cloud(original).require(colour)
    entries = work(original, ratio=ratio, n_points=points, mesh=surface, invalid=invalid, timer=timer)
    kind, labels, records = "pipeline" if meshes else "method", [*map(label_of, entries)], [*map(record_of, entries)]
    if not (meshes or methods) and (missing := METHODS.keys() - {record["method"] for record in records}):
        print_error(f"note: {cloud}: left out, as memory is too small: {', '.join(sorted(missing))}")
    with timer("tables and picture"):
        table = kind, labels, columns_of(records)
        contents = {"table.csv": as_csv(records).encode(), "table.md": as_markdown(*table).encode()}
        shown = _meshes(entries) if meshes else _clouds(entries, original, surface, picture)
        if not meshes and picture and surface is None:
            finite = original[original.is_finite()]
            surface = rebuilt("the original", finite, finite, "; give a mesh with --mesh")
        if picture:
            relative = [record["relative"] for record in records if record["relative"]]
            contents["picture.png"] = _drawn(original, surface, shown, relative, viewpoint, colour)
    if report and shown:  # without results no pipeline has found a surface, and the notes say so
        made = how_made(context.obj, inputs)
        page = BytesIO()
        report_page(Named(cloud.name, original, surface), shown, made, viewpoint, timer, list(weights)).write(page)
        contents["report.html"] = page.getvalue()
    output.mkdir(exist_ok=True)
    for name, content in contents.items():
        with io.whole_output(output / name, force) as file:
            file.write(content)
    if not (as_json or quiet):
        print_table(*table)
        say(f"{output}: {', '.join(contents)}")
    for label, record in zip(labels, records, strict=True):
        if as_json:
            emit(record, as_json)
        if record["failure"]:
            print_error(f"note: {label}: {record['failure']}")


def _check_options(
    meshes: bool, seed: int | None, detail: object, picture: bool, report: bool, viewpoint: object, colour: object
) -> None:
    """Check that the options go together."""
    if meshes and (seed is not None or detail):
        raise ParameterError("expected --meshes without --seed and --detail, which pipelines do not use")
    if viewpoint and not (picture or report):
        raise ParameterError("expected a picture or --report to turn by --view and --up; leave out --no-picture")
    if colour and not picture:
        raise ParameterError("expected a picture to colour by --colour; leave out --no-picture")


def _require_extras(pipelines: Sequence[str]) -> None:
    """Raise an error that names all packages that a picture lacks."""
    from gppcs.engine.extras import require_all, require_matplotlib, require_pymeshlab, require_pyvista
    from gppcs.evaluation.mesh_comparison import require_pipeline

    needed = (partial(require_pipeline, name) for name in pipelines)
    require_all(require_pymeshlab, require_matplotlib, require_pyvista, *needed)


def _clouds(entries: Sequence[Entry], original: PointCloud, surface: Mesh | None, drawn: bool) -> list[Named]:
    """Return the simplified clouds, with their surfaces if these were compared or are drawn."""
    from gppcs.drawing.web.contents import Named
    from gppcs.evaluation.comparison import rebuilt_mesh, trimmed_mesh

    finite, shown = original[original.is_finite()], []
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

    shown = []
    for entry in entries:
        if entry.report and entry.mesh:
            vertices = PointCloud(entry.mesh.vertices[np.unique(entry.mesh.faces)])
            reason = f"it is a vertex of the mesh by {entry.pipeline}"
            shown.append(Named(entry.pipeline, vertices, entry.mesh, reason))
    return shown


def _drawn(
    original: PointCloud,
    surface: Mesh | None,
    shown: Sequence[Named],
    relative: Sequence[dict[str, float]],
    viewpoint: Viewpoint,
    colour: str | None,
) -> bytes:
    """Return a PNG of the original and each result, in the colours of the nearest original points, and their meshes."""
    from gppcs.drawing.cloud_images import painted
    from gppcs.drawing.side_by_side import Column, draw_comparison

    everything, legend = painted(original[original.is_finite()], colour)
    columns = [Column("original", everything, "", surface)]
    for named, figures in zip(shown, relative, strict=True):
        name = next(name for name in ("mesh_mean", "hausdorff_mean", "surface_mean") if name in figures)
        caption = f"{name.replace('_', ' ')}\n{figures[name]:.2e} diagonals"
        counted = "vertices" if "vertices" in figures else "points"
        columns.append(Column(named.name, everything.at(named.cloud.points), caption, named.mesh, counted))
    image = BytesIO()
    draw_comparison(image, columns, viewpoint, legend)
    return image.getvalue()


def _check_folder(folder: Path, names: list[str], inputs: list[Path], force: bool) -> None:
    """Check that files of these names can be written in a folder."""
    from gppcs.io import check_distinct, check_writable, is_standard

    if is_standard(folder) or ((folder.exists() or folder.is_symlink()) and not folder.is_dir()):
        raise OutputError(f"{folder}: expected a folder, found something else; name a folder")
    if not force and folder.is_dir() and any(folder.iterdir()):
        raise OutputError(f"{folder}: expected a new or empty folder; choose another, or overwrite tables with force")
    if not folder.absolute().parent.is_dir():
        raise OutputError(f"{folder}: expected an existing parent folder, found none; make it first")
    targets = [folder / name for name in names]
    check_distinct(targets, inputs)
    for target in targets:
        check_writable(target, force, makes_folders=True)
