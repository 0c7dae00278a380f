"""The method `sample-elimination`: weighted sample elimination."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.methods.method import RANKING, Feature, Method, Selection, Task

if TYPE_CHECKING:
    from gppcs.engine.arrays import Floats


@dataclass(frozen=True)
class SampleElimination(Method):
    """Weighted sample elimination."""

    name = "sample-elimination"
    summary = "removes the most crowded point again and again: an even cover with blue noise"
    description = (
        "Removes the most crowded point, the one with the nearest neighbours, again and again. The order is "
        "progressive: the first half of the kept points is evenly spread too, so is the first quarter, and so on."
    )
    source = "Yuksel 2015"
    supports = {
        Feature.RANKING: RANKING,
        Feature.SPACING: "No two kept points are nearer than it: the longest start of the progressive order with that.",
    }
    _bytes_per_point = 150

    def __call__(self, task: Task) -> Selection:
        from gppcs.methods.sample_elimination.elimination import eliminate, first_at_spacing

        points = task.points
        count = task.n_points if task.spacing is None else _limit_at_spacing(points, task.spacing)
        with task.timer("elimination", len(points) - count) as on_progress:
            order = eliminate(points, count, on_progress)
        return Selection(order if task.spacing is None else order[: first_at_spacing(points[order], task.spacing)])


def _limit_at_spacing(points: Floats, spacing: float) -> int:
    """Return how many points no two of which are nearer than a spacing there may be at most."""
    from gppcs.spatial.kdtree import KdTree
    from gppcs.spatial.spacing import surface_area

    # The densest packing has 1.15 points at a distance of 1 in each unit of area, and the area may be off.
    densest = 1.5 * surface_area(KdTree.build(points)) / spacing / spacing
    return min(len(points), max(1, math.ceil(min(densest, 1e18))))
