"""The options that say how many points to keep."""

from __future__ import annotations

from typing import Annotated

import typer

from gppcs.app import panels
from gppcs.methods import METHODS

Ratio = Annotated[
    str | None,
    typer.Option(
        metavar="SHARE",
        help="Share of the points to keep, above 0 and at most 1, such as 0.03 or 3%. Or give --points.",
        rich_help_panel=panels.SIZE,
    ),
]
Points = Annotated[
    str | None,
    typer.Option(
        metavar="M",
        help="Number of points to keep, such as 5000, 5,000, 5k or 1.5M. Or give --ratio.",
        rich_help_panel=panels.SIZE,
    ),
]
Tolerance = Annotated[
    str | None,
    typer.Option(
        metavar="LENGTH[:p95]",
        help="Keep the fewest points whose local surface no original point is farther from than this, outliers aside: "
        "0.5 (in the unit of the coordinates), 0.5mm, or 0.02% of the diagonal. With :p95, :mean or :rms behind it, it "
        "bounds that error instead; with :max, outliers count, too. In place of --points.",
        rich_help_panel=panels.SIZE,
    ),
]
Spacing = Annotated[
    str | None,
    typer.Option(
        metavar="LENGTH",
        help="Keep as many points as have this spacing: 0.05, 5cm or 1%. In place of --points. "
        + " ".join(
            f"{name}: {known.supports['spacing']}" for name, known in METHODS.items() if "spacing" in known.supports
        ),
        rich_help_panel=panels.SIZE,
    ),
]
MaxGap = Annotated[
    str | None,
    typer.Option(
        metavar="LENGTH",
        help="Add points until each original point has a kept one within this distance. Alone or with --points and so "
        "on.",
        rich_help_panel=panels.SIZE,
    ),
]
Unit = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Unit of the coordinates, such as m or mm, for lengths with a unit. By default, the coordinate system of "
        "the input tells it.",
        rich_help_panel=panels.SIZE,
    ),
]
