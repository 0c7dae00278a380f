"""The area of the surface that each point of a cloud stands for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range
from gppcs.spatial.nearest import WIDER, look_around, search_for, steps_to_nearest

NEIGHBOURS = 8  # as in `gppcs.spatial.spacing.surface_area`
AREA_QUANTILE = 0.99  # quantile to which larger areas are cut
TASKS = 256  # runs of leaves; within a run, each search starts from the radius of the one before


def areas_of_points(tree: KdTree) -> NDArray[np.float64]:
    """Estimate the area, (N,), that each point stands for, of which the largest 1 % are cut, for outliers."""
    areas = squared_reaches(tree) * (np.pi / max(1, min(NEIGHBOURS, len(tree.order) - 1)))
    largest = np.quantile(areas, AREA_QUANTILE)
    return np.minimum(areas, largest) if largest > 0.0 else np.ones(len(areas))


def squared_reaches(tree: KdTree) -> NDArray[np.float64]:
    """Return the squared distance of each point to its 8th neighbour, (N,), in proportion to the area of the point."""
    n, tasks = len(tree.order), min(tree.leaves, TASKS)
    squared = np.ones(n)
    if n > 1:
        k = min(NEIGHBOURS, n - 1) + 1
        on_ranges(_squared_reaches, tasks, tasks, tree.points, tree.order, tree.low, tree.high, k, squared)
    return squared


@kernel
def _squared_reaches(first, last, tasks, points, order, low, high, k, squared):
    """Fill `squared`, (N,), with the squared distance to the k-th nearest, itself included, in a range of tasks."""
    n, leaves = points.shape[1], first_leaf(low)
    search = search_for(k, leaves)
    for task in range(first, last):
        squared_radius = 0.0  # in the first leaf, each point searches by itself; later leaves use the last one's radius
        for leaf in range(leaves + leaves * task // tasks, leaves + leaves * (task + 1) // tasks):
            begin, end = leaf_range(n, leaves, leaf)
            count = look_around(points, low, high, low[leaf], high[leaf], squared_radius, search)
            reached = 0.0
            for i in range(begin, end):
                x, y, z = points[0, i], points[1, i], points[2, i]
                reach = steps_to_nearest(points, low, high, x, y, z, count, squared_radius, search)
                squared[order[i]] = reach
                reached += reach
            squared_radius = WIDER * reached / (end - begin)
