"""The method `wlop`: weighted locally optimal projection."""

from dataclasses import dataclass

from gppcs.methods.method import Method, Selection, Task
from gppcs.methods.parameters import parameter


@dataclass(frozen=True)
class WLOP(Method):
    """Weighted locally optimal projection (WLOP)."""

    name = "wlop"
    summary = "weighted locally optimal projection: samples pulled onto the surface and pushed apart"
    description = (
        "Starts with random points as samples. Each iteration moves them to the weighted mean of the points around "
        "them, and away from each other."
    )
    source = "Huang, Li, Zhang, Ascher and Cohen-Or 2009"
    _bytes_per_point = 130

    radius: float = parameter(
        8.0,
        "Radius within which points attract and samples repel each other, in average spacings of the input; 8 as in "
        "CGAL. Larger values smooth more: with four spacings of the output, which are 21 to 26 of the input at ratios "
        "of 3 to 5 %, the mean distance to a kept point grows by a third.",
        minimum=0.001,
        maximum=1e6,
    )
    iterations: int = parameter(35, "Number of iterations.", minimum=1)
    mu: float = parameter(0.45, "Weight of the repulsion, from 0 to 0.5.", minimum=0, maximum=0.5)
    require_uniform: bool = parameter(
        False, "Weight the points so that dense parts of the input attract no more than others."
    )
    snap: bool = parameter(
        True,
        "Replace each sample by the nearest original point that no earlier sample took. Otherwise keep the samples, "
        "with the attributes of these points.",
    )
    seed: int = parameter(0, "Seed of the random points.", minimum=0)

    @property
    def moves_points(self) -> bool:
        return not self.snap

    def __call__(self, task: Task) -> Selection:
        import numpy as np

        from gppcs.methods.wlop.projection import project
        from gppcs.spatial.kdtree import KdTree
        from gppcs.spatial.queries import nearest_unused
        from gppcs.spatial.spacing import nearest_distances

        points, n_points, timer = task.points, task.n_points, task.timer
        with timer("tree"):
            tree = KdTree.build(points)
            # The median (CGAL: the mean) of the points' mean distance to the seven nearest, itself included.
            spacing = np.median(np.mean([nearest_distances(tree, k) for k in range(7)], axis=0))
        start = points[np.random.default_rng(self.seed).permutation(len(points))[:n_points]]
        with timer("projection", self.iterations) as on_progress:
            samples = project(
                tree, start, self.radius * float(spacing), self.iterations, self.mu, self.require_uniform, on_progress
            )
        with timer("nearest points"):
            indices = nearest_unused(samples, tree)
        return Selection(indices, {}, None if self.snap else samples)
