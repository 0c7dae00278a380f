"""The command `gppcs curve`: the error of methods over the number of points."""

from __future__ import annotations

from pathlib import Path

from gppcs.app import options
from gppcs.app.outputs import check_output
from gppcs.app.panels import LOOK, METHOD, SIZE
from gppcs.app.printing import names_of, print_json, started
from gppcs.clouds.quantities import Measure, size_of
from gppcs.errors import file_path
from gppcs.methods import DEFAULT

EPILOG = (
    "gppcs curve scan.ply\n\n"
    "gppcs curve scan.ply --methods gp,fps,voxel --sizes 1%,2%,5%,10% --measure mean --plot curve.png\n\n"
    "The knee is the size from which on more points gain little: the point that is farthest below the line between "
    "the ends of the curve, with both axes scaled to 0 to 1. It takes at least three sizes."
)


def curve(
    cloud: Path = options.CLOUD,
    methods: str = options.option(
        "NAME,...", "Names of the methods, separated by commas. See gppcs methods.", METHOD, default=DEFAULT.name
    ),
    sizes: str | None = options.option(
        "SIZE,...", "Numbers of points and shares, such as 1%,5%,20k.", SIZE, show_default="0.1% to 20%"
    ),
    measure: Measure = options.option(
        None,
        "Which error: 95 % of the points are as near as that (p95), or the mean, rms or largest.",
        SIZE,
        default="p95",
    ),
    plot: Path | None = options.option("PNG", "Draw the curves. Needs the extra picture.", LOOK, parser=file_path),
    seed: int | None = options.SEED,
    input_format: str | None = options.FROM,
    columns: str | None = options.COLUMNS,
    inside: list[str] | None = options.INSIDE,
    only: str | None = options.ONLY,
    drop: options.Invalid | None = options.DROP_INVALID,
    threads: int | None = options.THREADS,
    force: bool = options.FORCE,
    quiet: bool = options.QUIET,
    as_json: bool = options.JSON,
) -> None:
    """Print the error over the number of points, for one method or several side by side.

    The first points of a ranking are judged if the method ranks its points (gp, fps, random, sample-elimination and
    top-variation). Other methods run once for each size.
    """
    from gppcs import io
    from gppcs.app.console import print_curves
    from gppcs.drawing.curves import draw_curves
    from gppcs.engine.extras import require_matplotlib
    from gppcs.evaluation.comparison import checked_methods
    from gppcs.evaluation.curves import curve as measured
    from gppcs.io.files import naming

    timer = started(quiet, threads)
    chosen = checked_methods(methods.split(","), None, 1, seed)
    wanted = None if sizes is None else [size_of("sizes", text) for text in sizes.split(",")]
    query, files = options.query_of(inside, only)
    if plot is not None:
        check_output(plot, [cloud, *files], force, [".png"])
        require_matplotlib()
    original = io.load(cloud, input_format, names_of(columns), query).cloud
    with naming(cloud):
        if query and not len(original):
            raise query.nothing_found()
        curves = measured(original, chosen, sizes=wanted, invalid="drop" if drop else "error", timer=timer)
    if plot is not None:
        with io.whole_output(plot, force) as file:
            draw_curves(file, curves, measure)
        if io.is_standard(plot):  # where nothing else may go
            return
    if as_json:
        for each in curves:
            print_json(
                {
                    "input": str(cloud),
                    "method": each.method.name,
                    "points": each.sizes.tolist(),
                    "errors": {name: values.tolist() for name, values in each.errors.items()},
                    "diagonal": each.diagonal,
                    "knee": each.knee(measure) if each.has_knee else None,
                }
            )
    elif not quiet:
        print_curves(str(cloud), curves, measure, len(original))
