"""The command `gppcs sample`: a synthetic scan."""

from pathlib import Path
from typing import Annotated, Any

from gppcs import __version__
from gppcs.app import options
from gppcs.app.options import option
from gppcs.app.printing import emit, note_left_out, say, started

EPILOG = "gppcs sample fan -o fan.ply --points 50k --noise 0.002"
NAMES = ("medallion", "bracket", "fan", "sphere", "fresco", "street", "village")


def sample(
    name: Annotated[
        str,
        options.argument("NAME", f"{', '.join(NAMES[:-1])} or {NAMES[-1]}.", autocompletion=lambda: list(NAMES)),
    ],
    output: Annotated[Path, options.output("OUT", "The file to write.")],
    points: Annotated[
        str, option("Number of points, outliers included, such as 50000, 50k or 1.5M.", metavar="N")
    ] = "200k",
    noise: Annotated[float, option("Standard deviation of each coordinate, as a fraction of the diagonal.")] = 0.0,
    outliers: Annotated[float, option("Fraction of points anywhere in the enlarged bounding box.")] = 0.0,
    uneven: Annotated[float, option("Fraction of the density lost from one end to the other, below 1.")] = 0.0,
    seed: Annotated[int, option("Seed of random numbers. The same seed gives the same scan.")] = 0,
    output_format: options.To = None,
    ascii: options.Ascii = None,  # noqa: A002
    force: options.Force = False,
    lossy: options.Lossy = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Make a synthetic scan of a surface that is known exactly, with its normals.

    With --to, the name - stands for standard output.
    """
    from gppcs import io, scans
    from gppcs.app.outputs import check_output
    from gppcs.clouds.quantities import count_of
    from gppcs.io.las import in_thousandths

    started(quiet)
    chosen = io.format_to_write(output, output_format, ascii)
    check_output(output, [], force)
    settings: dict[str, Any] = {"noise": noise, "outliers": outliers, "uneven": uneven, "seed": seed}
    cloud = scans.sample(name, count_of("n_points", points), **settings)
    if chosen.name in ("LAS", "LAZ", "COPC"):  # scenes are in metres, objects in millimetres
        cloud = in_thousandths(
            cloud, *(("metre", "1") if "classification" in cloud.attributes else ("millimetre", "0.001"))
        )
    note_left_out(output, io.store(output, cloud, chosen, force, lossy))
    if io.is_standard(output):
        return
    if as_json:
        emit({"output": str(output), "name": name, "points": len(cloud), **settings, "version": __version__}, as_json)
    elif not quiet:
        say(f"{output}: {len(cloud):,} points")
