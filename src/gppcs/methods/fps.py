"""The method `fps`: farthest point sampling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class FarthestPoint(Method):
    """Farthest point sampling.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("sphere", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=10, method=gppcs.FarthestPoint()).indices)
    10
    """

    name = "fps"
    summary = "farthest point sampling: the most even cover"
    description = (
        "Starts with the point nearest the centroid. Each further point is the farthest from all points chosen before "
        "it; this is exact. A smaller selection is the start of a larger one."
    )
    source = "Eldar, Lindenbaum, Porat and Zeevi 1997"
    bytes_per_point: ClassVar[int] = 150

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method.__call__`."""
        from gppcs.spatial.farthest_points import farthest_points

        stages = Stages.of(stages)
        with stages("farthest points", n_points) as advanced:
            indices, _ = farthest_points(points, n_points, advanced=advanced)
        return Selection(indices)
