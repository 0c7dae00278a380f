"""Farthest point sampling as a method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class FarthestPoint(Method):
    """Each point the farthest from those before it, from the point nearest the centroid on; exact."""

    name = "fps"
    summary = "farthest point sampling: the most even cover"
    source = "Eldar, Lindenbaum, Porat and Zeevi 1997"

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        from gppcs.spatial.farthest_points import farthest_points

        stages = stages or Stages()
        with stages("farthest points", n_points) as advanced:
            indices, _ = farthest_points(points, n_points, advanced=advanced)
        return Selection(indices)
