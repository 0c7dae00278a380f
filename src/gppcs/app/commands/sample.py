"""The command `gppcs sample`: a synthetic scan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from gppcs import __version__
from gppcs.app import options
from gppcs.app.outputs import check_output
from gppcs.app.printing import note_left_out, print_json, say, started
from gppcs.clouds.quantities import count_of

EPILOG = "gppcs sample fan -o fan.ply --points 50k --noise 0.002"


def _names() -> list[str]:
    from gppcs.scans import SCANS, SCENES

    return [*SCANS, *SCENES]


def sample(
    name: str = typer.Argument(
        ...,
        metavar="NAME",
        help="medallion, bracket, fan, statue or sphere; or a scene as a sensor sees it: room, street or terrain.",
        show_default=False,
        autocompletion=_names,
    ),
    output: Path = options.output("OUT", "The file to write."),
    points: str = options.option(
        "N", "Number of points, outliers included, such as 50000, 50k or 1.5M.", default="200k"
    ),
    noise: float = options.option(
        None, "Standard deviation of the noise on each coordinate, as a share of the diagonal.", default=0.0
    ),
    outliers: float = options.option(
        None, "Share of the points that are outliers, anywhere in the enlarged bounding box.", default=0.0
    ),
    uneven: float = options.option(
        None, "Share of the density that is lost from one end of an object to the other, from 0 to 0.999.", default=0.0
    ),
    seed: int = options.option(None, "Seed of random numbers. The same seed gives the same scan.", default=0),
    output_format: str | None = options.TO,
    ascii: bool | None = options.ASCII,  # noqa: A002
    force: bool = options.FORCE,
    lossy: bool = options.LOSSY,
    quiet: bool = options.QUIET,
    as_json: bool = options.JSON,
) -> None:
    """Make a synthetic scan of a surface that is known exactly, with its normals.

    With --to, the name - stands for standard output.
    """
    from gppcs import io, scans

    started(quiet)
    io.format_to_write(output, output_format, ascii)
    check_output(output, [], force)
    settings: dict[str, Any] = {"noise": noise, "outliers": outliers, "uneven": uneven, "seed": seed}
    cloud = scans.sample(name, count_of("n_points", points), **settings)
    note_left_out(output, io.store(output, cloud, output_format, force, lossy, ascii))
    if io.is_standard(output):
        return
    if as_json:
        print_json({"output": str(output), "name": name, "points": len(cloud), **settings, "version": __version__})
    elif not quiet:
        say(f"{output}: {len(cloud):,} points")
