"""The nearest points of places, no point twice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range, squared_distance_to_box


def nearest_unused(positions: NDArray[np.float64], tree: KdTree) -> NDArray[np.int64]:
    """Assign to each position, (M, 3), one after the other, the nearest point that is not assigned yet; (M,)."""
    taken = np.zeros(len(tree.order), dtype=np.bool_)
    leaves = tree.leaves
    unused = np.zeros(2 * leaves, dtype=np.int64)
    unused[leaves:] = np.diff(np.arange(leaves + 1) * len(taken) // leaves)
    for node in range(leaves - 1, 0, -1):
        unused[node] = unused[2 * node] + unused[2 * node + 1]
    indices = np.empty(len(positions), dtype=np.int64)
    _take_nearest(positions, tree.points, tree.order, tree.low, tree.high, taken, unused, indices)
    return indices


@kernel
def _take_nearest(positions, points, order, low, high, taken, unused, indices):
    """Fill `indices`, (M,), for `positions`, (M, 3); `taken`, (N,), and `unused`, (nodes,), are updated."""
    leaves = first_leaf(low)
    for p in range(len(positions)):
        x, y, z = positions[p]
        best = _nearest_untaken(points, order, low, high, taken, unused, x, y, z)
        indices[p] = order[best]
        taken[best] = True
        # The leaf that holds the position `best`: the inverse of the formula in `leaf_range`.
        node = leaves + ((best + 1) * leaves - 1) // points.shape[1]
        while node:
            unused[node] -= 1
            node //= 2


@kernel
def _nearest_untaken(points, order, low, high, taken, unused, x, y, z):
    """Return the position of the point nearest (x, y, z) that is not `taken`, (N,); ties go to the smallest index."""
    leaves = first_leaf(low)
    n = points.shape[1]
    best, nearest = -1, np.inf
    stack = np.empty(64, dtype=np.int64)
    stack[0] = 1
    height = 1
    while height:
        height -= 1
        node = stack[height]
        if not unused[node] or squared_distance_to_box(low[node], high[node], x, y, z) > nearest:
            continue
        if node < leaves:
            near, far = 2 * node, 2 * node + 1
            if squared_distance_to_box(low[far], high[far], x, y, z) < squared_distance_to_box(
                low[near], high[near], x, y, z
            ):
                near, far = far, near
            stack[height], stack[height + 1] = far, near
            height += 2
        else:
            for j in range(*leaf_range(n, leaves, node)):
                squared = (points[0, j] - x) ** 2 + (points[1, j] - y) ** 2 + (points[2, j] - z) ** 2
                if not taken[j] and (squared < nearest or (squared == nearest and order[j] < order[best])):
                    best, nearest = j, squared
    return best
