"""Hierarchical clustering as a method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class HierarchicalClustering(Method):
    """Clusters of little variation, one point of each: large ones where the surface is flat, small where it bends.

    The most varied cluster is parted until there are as many as points asked for. The form with limits for size
    and variation, in which the number comes out as it does, is `gppcs.methods.hc.clustering.hierarchical_clusters`.
    """

    name = "hc"
    summary = "hierarchical clustering: the central point of each cluster of little variation"
    source = "Pauly, Gross and Kobbelt 2002"

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        from gppcs.methods.hc.clustering import clusters_by_variation

        stages = stages or Stages()
        with stages("clusters"):
            return Selection(clusters_by_variation(points, n_points))
