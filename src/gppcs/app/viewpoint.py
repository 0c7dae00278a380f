"""What the options of pictures mean: `--view` and `--up`, which set the viewpoint, and `--colour`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gppcs.errors import ParameterError

if TYPE_CHECKING:
    from gppcs.drawing.viewpoint import Viewpoint


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
