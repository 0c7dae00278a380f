"""What the options of pictures mean: `--view` and `--up`, which set the viewpoint."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gppcs.errors import ParameterError

if TYPE_CHECKING:
    from gppcs.drawing.viewpoint import Viewpoint


def viewpoint_of(view: str | None, up: str | None) -> Viewpoint:
    """Return the viewpoint that the options set."""
    from gppcs.drawing.viewpoint import Viewpoint

    if view is None:
        return Viewpoint(up)
    try:
        azimuth, elevation = map(float, view.split(","))
    except ValueError:
        raise ParameterError(f"expected --view AZIMUTH,ELEVATION in degrees, such as 30,20, found {view!r}") from None
    return Viewpoint(up, (azimuth, elevation))
