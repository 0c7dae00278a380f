"""The method `random`: random sampling."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from gppcs.methods.method import RANKING, Feature, Method, Selection, Task
from gppcs.methods.parameters import parameter

if TYPE_CHECKING:
    from gppcs.engine.arrays import Ints

PART = 1 << 18  # Points of a part at most.


@dataclass(frozen=True)
class Random(Method):
    """Random sampling."""

    name = "random"
    summary = "random points, all equally likely, or evenly over the surface"
    description = (
        "Chooses the first points of a random permutation, so a smaller selection is the start of a larger one. Even "
        "density comes from exponential random numbers divided by areas (Efraimidis and Spirakis 2006)."
    )
    source = "baseline"
    supports = {
        Feature.RANKING: RANKING,
        Feature.FILES: "Other points than in memory, as random.",
    }
    _bytes_per_point = 60

    seed: int = parameter(0, "Seed of the permutation.", minimum=0)
    even: bool = parameter(
        False,
        "Whether points are likely in proportion to the area that each stands for, so that the kept points lie equally "
        "densely. A stray point stands for a large area: drop outliers first.",
    )

    def __call__(self, task: Task) -> Selection:
        import numpy as np

        from gppcs.spatial.kdtree import KdTree
        from gppcs.spatial.nearest import squared_radii

        with task.timer("permutation"):
            if task.stored is not None:
                return Selection(self._of_stored(task))
            rng, points = np.random.default_rng(self.seed), task.points
            if self.even:
                areas = squared_radii(KdTree.build(points))
                return Selection(np.argsort(rng.exponential(size=len(points)) / areas)[: task.n_points])
            return Selection(rng.permutation(len(points))[: task.n_points])

    def _of_stored(self, task: Task) -> Ints:
        """Return the indices of the different points with the smallest random numbers."""
        import numpy as np

        from gppcs.spatial.samples import smallest_numbers

        assert task.stored is not None
        numbers, indices = np.empty(0), np.empty(0, dtype=np.int64)
        choose = partial(smallest_numbers, task.stored, task.n_points, self.seed, self.even)
        for of_part in task.map_parts(choose, task.stored.parts(PART)):
            numbers = np.concatenate([numbers, of_part[0]])
            indices = np.concatenate([indices, of_part[1]])
            order = np.argsort(numbers, kind="stable")[: task.n_points]
            numbers, indices = numbers[order], indices[order]
        return indices
