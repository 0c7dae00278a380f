"""Parts of `choose` that other processes run on random points, to compile their kernels at a first run."""

import numpy as np

from gppcs.gp.local.candidates import Measured
from gppcs.gp.local.greedy import extend
from gppcs.gp.local.kernel import LocalField
from gppcs.gp.local.placement import place
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.local_surface import LocalSurface
from gppcs.surface.noise import Noise

NEIGHBOURS = 4  # points on which each is conditioned


def compile_choice(n: int) -> None:
    """Compile the kernels of the greedy choice among n candidates, in parts if these are many."""
    tree = KdTree.over(np.sort(np.random.default_rng(0).random((3, n))))  # near a line, so that boxes are small
    field = LocalField(
        tree.points, np.ones((3, n)), np.full(n, 0.01), np.zeros(n), np.full(n, 0.1), np.empty((0, n)), 1.5, 1.0
    )
    extend(field, tree, np.arange(min(n // 2, 2 * NEIGHBOURS)), 1, NEIGHBOURS, 0.0)


def compile_placement() -> None:
    """Compile the kernels of the placement, those of the surface of the kept points first."""
    points = np.random.default_rng(0).random((400, 3))
    LocalSurface.over(KdTree.over(points.T))
    noise = Noise(None, 0, False, 0.0, True, True, 0.1)
    place(points, np.arange(40), 0, Measured(1.0, noise, np.arange(400, dtype=np.uint32)))
