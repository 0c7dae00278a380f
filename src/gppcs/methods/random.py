"""The method `random`: random sampling."""

from __future__ import annotations

from dataclasses import dataclass

from gppcs.methods.method import RANKING, Feature, Method, Selection, Task
from gppcs.methods.parameters import parameter


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
    supports = {Feature.RANKING: RANKING}
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
            rng, points = np.random.default_rng(self.seed), task.points
            if self.even:
                areas = squared_radii(KdTree.build(points))
                return Selection(np.argsort(rng.exponential(size=len(points)) / areas)[: task.n_points])
            return Selection(rng.permutation(len(points))[: task.n_points])
