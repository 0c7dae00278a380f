"""The method `random`: random sampling."""

from dataclasses import dataclass
from typing import Any

from gppcs.methods.method import RANKING, Feature, Method, Selection, Task
from gppcs.methods.parameters import parameter


@dataclass(frozen=True)
class Random(Method):
    """Random sampling."""

    name = "random"
    summary = "random points, all equally likely, or evenly over the surface"
    description = (
        "Chooses the points of the smallest random numbers, so a smaller selection is the start of a larger one. A "
        "number depends on the seed and on where the point lies in the cloud. Even density comes from exponential "
        "random numbers divided by areas (Efraimidis and Spirakis 2006)."
    )
    source = "baseline"
    supports = {Feature.RANKING: RANKING, Feature.KEEP: "The others are random ones."}
    _bytes_per_point = 60

    seed: int = parameter(0, "Seed of the random numbers.", minimum=0)
    even: bool = parameter(
        False,
        "Whether points are likely in proportion to the area that each stands for, so that the kept points lie equally "
        "densely. A stray point stands for a large area: drop outliers first.",
    )

    def __call__(self, task: Task) -> Selection:
        import numpy as np

        from gppcs.spatial.kdtree import KdTree
        from gppcs.spatial.nearest import squared_radii
        from gppcs.spatial.samples import point_hashes

        with task.timer("random numbers"):
            numbers: Any = point_hashes(task.points, self.seed)
            if self.even:
                numbers = -np.log((numbers + 1.0) / 2.0**64) / squared_radii(KdTree.build(task.points))
            count = task.n_points - task.fixed
            chosen = np.argpartition(numbers[task.fixed :], max(0, count - 1))[:count] + task.fixed
            return Selection(np.concatenate([np.arange(task.fixed), chosen[np.argsort(numbers[chosen])]]))
