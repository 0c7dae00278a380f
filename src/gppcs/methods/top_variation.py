"""The method `top-variation`: the points of largest surface variation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection, largest, parameter

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class TopVariation(Method):
    """The points of largest surface variation.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=90, method=gppcs.TopVariation(neighbours=15)).indices)
    90
    """

    name = "top-variation"
    summary = "the points of largest surface variation, and no others"
    description = "Chooses the points of largest surface variation. Flat parts of the surface keep no points."
    source = "baseline; surface variation: Pauly, Gross and Kobbelt 2002"
    ranks = True
    bytes_per_point: ClassVar[int] = 150

    neighbours: int = parameter(25, "About how many points a neighbourhood holds.", least=3)

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method.__call__`."""
        from gppcs.surface.surface_variation import estimate_features

        stages = Stages.of(stages)
        with stages("surface variation"):
            variation = estimate_features(points, self.neighbours).surface_variation
        return Selection(largest(variation, n_points))
