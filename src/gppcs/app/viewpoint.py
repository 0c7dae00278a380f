"""The options of pictures: `--view` and `--up`, which set the viewpoint, and `--colour`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gppcs.app import panels
from gppcs.errors import ParameterError

if TYPE_CHECKING:
    from gppcs.drawing.viewpoint import Viewpoint

View = Annotated[
    str | None,
    typer.Option(
        metavar="AZIMUTH,ELEVATION",
        help="Direction of the view, in degrees. At 0,0 it is horizontal with x to the right (y with --up x or -x). "
        "A larger azimuth moves the viewer to the right around the cloud, a larger elevation up. Guessed by default.",
        rich_help_panel=panels.LOOK,
    ),
]
Up = Annotated[
    Literal["x", "y", "z", "-x", "-y", "-z"] | None,
    typer.Option(
        help="The axis that points up in the picture. Guessed by default.",
        rich_help_panel=panels.LOOK,
    ),
]
Colour = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="What the colours of the points in the picture show: rgb, variation (surface variation), or an attribute "
        "of the input. By default surface variation, which shows where a method should keep more points.",
        rich_help_panel=panels.LOOK,
    ),
]


def require_picture(colour: str | None, picture: bool) -> None:
    """Raise a ParameterError if a colour is given without a picture."""
    if colour is not None and not picture:
        raise ParameterError(
            "expected a picture to colour by --colour, found none; request a picture or omit the option"
        )


def viewpoint_of(view: str | None, up: str | None, picture: bool) -> Viewpoint:
    """Return the viewpoint that the options set."""
    from gppcs.drawing.viewpoint import Viewpoint

    if not picture and (view or up):
        raise ParameterError(
            "expected a picture to turn with --view and --up, found none; request a picture or omit these options"
        )
    if view is None:
        return Viewpoint(up)
    try:
        azimuth, elevation = map(float, view.split(","))
    except ValueError:
        raise ParameterError(f"expected --view AZIMUTH,ELEVATION in degrees, such as 30,20, found {view!r}") from None
    return Viewpoint(up, (azimuth, elevation))
