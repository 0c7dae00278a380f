"""The method `sample-elimination`: weighted sample elimination."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MOST_IN_AREA = 1.5  # Points at a distance of 1 in each unit of area: 1.15 is the most, and the area may be off.


@dataclass(frozen=True)
class SampleElimination(Method):
    """Weighted sample elimination.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("sphere", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=100, method=gppcs.SampleElimination()).indices)
    100
    """

    name = "sample-elimination"
    summary = "removes the most crowded point again and again: an even cover with blue noise"
    description = (
        "Removes the most crowded point, the one with the nearest neighbours, again and again. The order is "
        "progressive: the first half of the kept points is evenly spread too, so is the first quarter, and so on."
    )
    source = "Yuksel 2015"
    ranks = True
    spacing = "No two kept points are nearer than it: the longest start of the progressive order for which that holds."
    bytes_per_point: ClassVar[int] = 150

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method.__call__`."""
        from gppcs.methods.sample_elimination.elimination import eliminate

        stages = Stages.of(stages)
        with stages("elimination", len(points) - n_points) as advanced:
            return Selection(eliminate(points, n_points, advanced))

    def at_spacing(self, points: NDArray[np.float64], spacing: float, stages: Stages) -> Selection:
        """Choose points of which no two are nearer than the spacing; see `Method.at_spacing`.

        Parameters
        ----------
        points : (N, 3) array, float64
            Finite and without repeats.
        spacing : float
            In the unit of the points.
        stages : Stages
            Times "elimination".

        Returns
        -------
        Selection
        """
        import math

        from gppcs.methods.sample_elimination.elimination import eliminate, far_apart
        from gppcs.spatial.kdtree import KdTree
        from gppcs.spatial.spacing import surface_area

        densest = MOST_IN_AREA * surface_area(KdTree.build(points)) / spacing / spacing
        count = min(len(points), max(1, math.ceil(min(densest, 1e18))))
        with stages("elimination", len(points) - count) as advanced:
            order = eliminate(points, count, advanced)
            return Selection(order[: far_apart(points[order], spacing)])
