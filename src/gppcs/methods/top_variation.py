"""The points of largest surface variation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection, largest

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class TopVariation(Method):
    """The points of largest surface variation.

    Parameters
    ----------
    neighbours : int
        About how many points a neighbourhood holds.
    """

    name = "top-variation"
    summary = "the points of largest surface variation, and no others"
    source = "baseline; surface variation: Pauly, Gross and Kobbelt 2002"

    neighbours: int = 25

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self.neighbours >= 3, "neighbours", "at least 3")

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        from gppcs.surface.surface_variation import estimate_features

        stages = stages or Stages()
        with stages("surface variation"):
            variation = estimate_features(points, self.neighbours).surface_variation
        return Selection(largest(variation, n_points))
