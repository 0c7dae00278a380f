"""Weighted locally optimal projection as a method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class WLOP(Method):
    """Random points, moved to the middle of the points around them and away from each other.

    Parameters
    ----------
    radius : float
        How far points act, in average spacings of the input; 8 as in CGAL. Larger ones smooth: with four spacings of
        the output, 21 to 26 of the input at ratios of 3 to 5 %, the mean distance to a kept point grows by a third.
    iterations : int
        How often all samples are moved.
    mu : float
        Weight of the repulsion, from 0 to 0.5.
    require_uniform : bool
        Even out the density of the input.
    snap : bool
        Keep the original point nearest each sample that none before it took; else the samples themselves, with the
        attributes of that point.
    seed : int
        Of the random points.
    """

    name = "wlop"
    summary = "weighted locally optimal projection: samples pulled onto the surface and apart, moved or snapped"
    source = "Huang, Li, Zhang, Ascher and Cohen-Or 2009"

    radius: float = 8.0
    iterations: int = 35
    mu: float = 0.45
    require_uniform: bool = False
    snap: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self.radius > 0, "radius", "above 0")
        self.require(self.iterations >= 1, "iterations", "at least 1")
        self.require(0 <= self.mu <= 0.5, "mu", "from 0 to 0.5")
        self.require(self.seed >= 0, "seed", "at least 0")

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        import numpy as np

        from gppcs.methods.wlop import projection
        from gppcs.spatial.kdtree import KdTree

        stages = stages or Stages()
        with stages("tree"):
            tree = KdTree.build(points)
            radius = self.radius * projection.average_spacing(tree)
        start = points[np.random.default_rng(self.seed).permutation(len(points))[:n_points]]
        with stages("projection", self.iterations) as advanced:
            samples = projection.project(
                points, start, radius, self.iterations, self.mu, self.require_uniform, tree, advanced
            )  # fmt: skip
        with stages("nearest points"):
            indices = projection.nearest_unused(samples, tree)
        return Selection(indices, {}, None if self.snap else samples)
