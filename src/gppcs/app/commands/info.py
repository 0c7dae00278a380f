"""The command `gppcs info`: facts about a cloud."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from gppcs.app.printing import Json, print_json

EPILOG = "[bold]Example[/bold]\n\ngppcs info scan.ply --json"


def info(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A point cloud file.", show_default=False)],
    as_json: Json = False,
) -> None:
    """Print the number of points, bounding box, spacing, attributes, repeats and invalid points."""
    from gppcs import io
    from gppcs.app.console import print_table
    from gppcs.clouds.summary import info as summarise

    summary = summarise(io.read(file))
    if as_json:
        print_json({"file": str(file), **dataclasses.asdict(summary)})
        return
    rows = {
        "points": f"{summary.points:,}",
        "low corner": "  ".join(f"{value:.9g}" for value in summary.low),
        "high corner": "  ".join(f"{value:.9g}" for value in summary.high),
        "diagonal": f"{summary.diagonal:.6g}",
        "spacing": f"{summary.spacing:.4g} (median distance to the nearest other point)",
        "repeats": f"{summary.repeats:,}",
        "not finite": f"{summary.non_finite:,}",
        "coordinates": summary.coordinate_type,
    }
    rows |= {f"attribute {name}": kind for name, kind in summary.attributes.items()}
    print_table(str(file), rows)
