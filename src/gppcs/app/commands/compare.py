"""The command `gppcs compare`: several methods on one cloud, as tables and a picture."""

from io import BytesIO
from pathlib import Path
from typing import Annotated

import typer

import gppcs
from gppcs.app import options
from gppcs.app.options import LOOK, METHOD, option
from gppcs.app.printing import emit, names_of, note_units, print_error, say, started
from gppcs.errors import OutputError, ParameterError
from gppcs.methods import METHODS

EPILOG = (
    "gppcs compare scan.ply --ratio 3% -o comparison\n\n"
    "gppcs compare scan.ply --points 5k --methods fps,hc,wlop --mesh surface.ply -o comparison\n\n"
    "gppcs evaluate --help defines the figures of the tables."
)


def compare(
    context: typer.Context,
    cloud: options.Cloud,
    output: Annotated[
        Path, options.output("DIR", "The folder for table.csv, table.md, picture.png and report.html; it may be new.")
    ],
    ratio: options.Ratio = None,
    points: options.Points = None,
    methods: Annotated[
        str | None,
        option("Names of methods, in the order of the table. By default all.", METHOD, metavar="NAME,..."),
    ] = None,
    mesh: Annotated[Path | None, option("A mesh file of the true surface of IN, to measure from.", LOOK)] = None,
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
        bool, option("Also write report.html, a page for the browser; see gppcs report.", LOOK, "--report")
    ] = False,
    view: options.View = None,
    up: options.Up = None,
    threads: options.Threads = None,
    force: options.Force = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Simplify a cloud by several methods, evaluate each result, and write tables and a picture."""
    from gppcs import io
    from gppcs.app.outputs import read_each
    from gppcs.app.pages import draw_beside, how_made, named_clouds, rebuilt
    from gppcs.app.tables import as_csv, as_markdown, columns_of, print_table, record_of
    from gppcs.drawing.colours import Colourable
    from gppcs.drawing.web.contents import Named, report_page
    from gppcs.engine.extras import require_all, require_matplotlib, require_pymeshlab
    from gppcs.evaluation.comparison import checked_methods

    timer, weights, chosen = started(quiet, threads), options.weights_of(detail), names_of(methods)
    if (ratio is None) == (points is None):
        actual = "none; a ratio of 0.1 keeps a tenth" if ratio is None else "both; leave one out"
        raise ParameterError(f"expected one of --ratio and --points, found {actual}")
    if not picture and (colour or ((view or up) and not report)):
        raise ParameterError("expected a picture for --colour, --view and --up; leave out --no-picture")
    if picture:
        require_all(require_pymeshlab, require_matplotlib)
    checked_methods(chosen or METHODS, ratio, points, seed)
    viewpoint, inputs = options.viewpoint_of(view, up), [cloud, *filter(None, [mesh])]
    names = ["table.csv", "table.md", *(["picture.png"] if picture else []), *(["report.html"] if report else [])]
    _check_folder(output, names, inputs, force)
    surface = gppcs.read_mesh(mesh) if mesh else None
    original = read_each([cloud], input_format, names_of(columns))[0][0]
    if colour is not None:
        Colourable.from_cloud(original).require(colour)
    note_units(cloud, original)
    entries = gppcs.compare(
        original,
        chosen,
        ratio=ratio,
        n_points=points,
        mesh=surface,
        seed=seed,
        detail=weights,
        invalid=invalid,
        timer=timer,
    )
    labels, records = [str(entry.method) for entry in entries], [*map(record_of, entries)]
    if not methods and (missing := METHODS.keys() - {record["method"] for record in records}):
        print_error(f"note: {cloud}: left out, as memory is too small: {', '.join(sorted(missing))}")
    with timer("tables and picture"):
        table = labels, columns_of(records)
        contents = {"table.csv": as_csv(records).encode(), "table.md": as_markdown(*table).encode()}
        finite = original[original.is_finite()]
        shown = named_clouds(entries, finite, bool(surface), picture)
        if picture and surface is None:
            surface = rebuilt("the original", finite, finite, "; give a mesh with --mesh")
        if picture:
            captions = [_caption(record["relative"]) for record in records]
            image, results = BytesIO(), list(zip(shown, captions, strict=True))
            draw_beside(image, Named("original", finite, surface), results, viewpoint, colour)
            contents["picture.png"] = image.getvalue()
    if report:
        made = how_made(context.obj, inputs)
        page = report_page(Named(cloud.name, original, surface), shown, made, viewpoint, timer, list(weights))
        contents["report.html"] = page.content()
    output.mkdir(parents=True, exist_ok=True)
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


def _caption(figures: dict[str, float]) -> str:
    """Return the figure that stands below a result in the picture."""
    name = next(name for name in ("hausdorff_mean", "surface_mean") if name in figures)
    return f"{name.replace('_', ' ')}\n{figures[name]:.2e} diagonals"


def _check_folder(folder: Path, names: list[str], inputs: list[Path], force: bool) -> None:
    """Check that files of these names can be written in a folder."""
    from gppcs.io import check_distinct, check_writable, is_standard

    if is_standard(folder) or ((folder.exists() or folder.is_symlink()) and not folder.is_dir()):
        raise OutputError(f"{folder}: expected a folder, found something else; name a folder")
    if not force and folder.is_dir() and any(folder.iterdir()):
        raise OutputError(f"{folder}: expected a new or empty folder; choose another, or overwrite tables with --force")
    check_distinct([folder / name for name in names], inputs)
    for name in names:
        check_writable(folder / name, force, makes_folders=True)
