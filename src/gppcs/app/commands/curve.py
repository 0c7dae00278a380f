"""The command `gppcs curve`: the error of methods over the number of points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gppcs.app import options, panels
from gppcs.app.printing import names_of, numbers_of, print_json, progress
from gppcs.clouds.quantities import Measure, size_of
from gppcs.engine.threads import set_threads
from gppcs.errors import OutputError, file_path
from gppcs.methods import DEFAULT

if TYPE_CHECKING:
    from gppcs.amounts.curve import Curve

EPILOG = (
    "[bold]Examples[/bold]\n\n"
    "gppcs curve scan.ply\n\n"
    "gppcs curve scan.ply --methods gp,fps,voxel --sizes 1%,2%,5%,10% --measure mean --plot curve.png\n\n"
    "The knee is the size from which on more points gain little: the point that is farthest below the line between "
    "the ends of the curve, with both axes scaled to 0 to 1. It takes at least three sizes."
)


def curve(
    cloud: Annotated[
        Path, typer.Argument(metavar="IN", parser=file_path, help="A point cloud file.", show_default=False)
    ],
    methods: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help="Names of the methods, separated by commas. See gppcs methods.",
            rich_help_panel=panels.METHOD,
        ),
    ] = DEFAULT,
    sizes: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE,...",
            help="Numbers of points and shares, such as 1%,5%,20k.",
            show_default="0.1% to 20%",
            rich_help_panel=panels.SIZE,
        ),
    ] = None,
    measure: Annotated[
        Measure,
        typer.Option(
            help="Which error: 95 % of the points are as near as that (p95), or the mean, rms or largest.",
            rich_help_panel=panels.SIZE,
        ),
    ] = "p95",
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="PNG",
            parser=file_path,
            help="Draw the curves. Needs the extra picture.",
            rich_help_panel=panels.LOOK,
        ),
    ] = None,
    seed: options.Seed = None,
    input_format: options.From = None,
    columns: options.Columns = None,
    box: options.Box = None,
    only: options.Only = None,
    polygon: options.Inside = None,
    drop: options.DropInvalid = None,
    threads: options.Threads = None,
    force: options.Force = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Print the error over the number of points, for one method or several side by side.

    The first points of a ranking are judged if the method ranks its points (gp, fps, random, sample-elimination and
    top-variation). Other methods run once for each size.
    """
    from gppcs import io
    from gppcs.app.console import print_curves
    from gppcs.drawing.curves import draw_curves
    from gppcs.engine.extras import require_matplotlib
    from gppcs.engine.timer import Timer
    from gppcs.evaluation.comparison import checked_methods
    from gppcs.evaluation.curves import curve as measured
    from gppcs.io.files import naming
    from gppcs.io.query import Query

    set_threads(threads)
    chosen = checked_methods([name.strip() for name in methods.split(",")], None, 1, seed)
    wanted = None if sizes is None else [size_of("sizes", text) for text in sizes.split(",")]
    if plot is not None:
        if not io.is_standard(plot) and plot.suffix.lower() != ".png":
            raise OutputError(f"{plot}: expected a name that ends in .png for the plot")
        require_matplotlib()
        io.check_distinct([plot], [cloud, *filter(None, [polygon])])
        io.check_output(plot, force)
    query: dict[str, Any] = {"box": numbers_of(box), "only": only, "polygon": polygon}
    original = io.load(cloud, input_format, names_of(columns), **query).cloud
    with naming(cloud):
        asked = Query.of(resolution=None, **query)
        if asked and not len(original):
            raise asked.nothing_found()
        curves = measured(
            original, chosen, sizes=wanted, invalid="drop" if drop else "error", timer=Timer(progress(quiet))
        )
    if plot is not None:
        with io.whole_output(plot, force) as file:
            draw_curves(file, curves, measure)
        if io.is_standard(plot):  # where nothing else may go
            return
    if as_json:
        for each in curves:
            print_json({"input": str(cloud), **_record(each, measure)})
    elif not quiet:
        print_curves(str(cloud), curves, measure, len(original))


def _record(curve: Curve, measure: Measure) -> dict[str, object]:
    """Return a curve as the record that `--json` prints."""
    errors = {name: values.tolist() for name, values in curve.errors.items()}
    return {
        "method": curve.method.name,
        "points": curve.sizes.tolist(),
        "errors": errors,
        "diagonal": curve.diagonal,
        "knee": curve.knee(measure) if curve.has_knee else None,
    }
