"""The options that say from where pictures are drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gppcs.errors import ParameterError

if TYPE_CHECKING:
    from gppcs.drawing.camera import Viewpoint

View = Annotated[
    str | None,
    typer.Option(
        metavar="AZIMUTH,ELEVATION",
        help="From where the picture looks, in degrees: at 0,0 level, with x to the right (y with --up x or -x); "
        "a larger azimuth goes to the right around the cloud, a larger elevation up. Guessed where not given.",
    ),
]
Up = Annotated[
    Literal["x", "y", "z", "-x", "-y", "-z"] | None,
    typer.Option(help="The axis that points upwards in the picture. Guessed where not given."),
]


def viewpoint_of(view: str | None, up: str | None, picture: bool) -> Viewpoint:
    """Return the viewpoint that the options say; they say nothing where there is no picture."""
    from gppcs.drawing.camera import Viewpoint

    if not picture and (view or up):
        raise ParameterError(
            "expected a picture to turn with --view and --up, found none; ask for one or leave them out"
        )
    if view is None:
        return Viewpoint(up)
    try:
        azimuth, elevation = map(float, view.split(","))
    except ValueError:
        raise ParameterError(f"expected --view AZIMUTH,ELEVATION in degrees, such as 30,20, found {view!r}") from None
    return Viewpoint(up, (azimuth, elevation))
