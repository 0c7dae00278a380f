"""Find the k nearest points of many queries, leaf by leaf of a tree of these."""

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.spatial.kdtree import KdTree, nearest_in_tree
from gppcs.spatial.leaves import (
    leaves_of_runs,
    look_around_leaf,
    on_leaves,
    radius_of_nearest,
    search_for,
    sort_nearest,
)

AREA_NEIGHBOURS = 8  # whose distance tells the area of a point


def nearest_others(tree: KdTree, k: int) -> tuple[Ints, Floats]:
    """Find the k other points nearest to each: positions and squared distances, (N, k), in tree order."""
    n = len(tree.order)
    positions, squared = np.empty((n, k), dtype=np.int64), np.empty((n, k))
    on_leaves(_find_others, tree, tree, positions, squared)
    return positions, squared


@kernel
def _find_others(first, last, runs, tree, queries, positions, squared):
    """Fill `positions` and `squared`, (N, k), in a range of runs."""
    points, lower, upper = tree
    search, mean = search_for(positions.shape[1] + 1, tree), 0.0
    for leaf in range(*leaves_of_runs(first, last, runs, queries)):
        begin, end, count, squared_radius = look_around_leaf(tree, queries, leaf, runs, mean, search)
        total = 0.0
        for i in range(begin, end):
            x, y, z = points[0, i], points[1, i], points[2, i]
            if not sort_nearest(x, y, z, count, squared_radius, search):
                nearest_in_tree(points, lower, upper, x, y, z, search.positions, search.gaps)
            for rank in range(len(search.gaps) - 1):  # the first is the point itself; slices compile twice as long
                positions[i, rank], squared[i, rank] = search.positions[rank + 1], search.gaps[rank + 1]
            total += search.gaps[-1]
        mean = total / (end - begin)


def squared_radii(tree: KdTree) -> Floats:
    """Return the squared distance of each point to its 8th neighbour, (N,), in proportion to the area of the point."""
    n = len(tree.order)
    squared = np.ones(n)
    if n > 1:
        on_leaves(_squared_radii, tree, tree, tree.order, min(AREA_NEIGHBOURS, n - 1) + 1, squared)
    return squared


@kernel
def _squared_radii(first, last, runs, tree, queries, order, k, squared):
    """Fill `squared`, (N,), with the squared distance to the k-th nearest, itself included, in a range of runs."""
    points, lower, upper = tree
    search, mean = search_for(k, tree), 0.0
    for leaf in range(*leaves_of_runs(first, last, runs, queries)):
        begin, end, count, squared_radius = look_around_leaf(tree, queries, leaf, runs, mean, search)
        total = 0.0
        for i in range(begin, end):
            x, y, z = points[0, i], points[1, i], points[2, i]
            limit = radius_of_nearest(search.buffer.packed, count, x, y, z, k, squared_radius, search.squared)
            if limit >= 0.0:
                squared[order[i]] = _largest_within(search.squared[:count], limit)
            else:
                nearest_in_tree(points, lower, upper, x, y, z, search.positions, search.gaps)
                squared[order[i]] = search.gaps[-1]
            total += squared[order[i]]
        mean = total / (end - begin)


@kernel(allocates=False)
def _largest_within(squared, limit):
    """Return the largest of the squared distances, (m,), that is at most `limit`."""
    largest, bits = 0, squared.view(np.int64)  # whose order is that of floats: the loop over integers is vectorised
    for j in range(len(squared)):
        largest = max(largest, bits[j] if squared[j] <= limit else 0)
    return np.int64(largest).view(np.float64)


def nearest_of_each(tree: KdTree, queries: KdTree) -> tuple[NDArray[np.int32], Floats]:
    """Return the position of the point nearest to each query, and its squared distance, (Q,) both, in tree order."""
    n = len(queries.order)
    positions, squared = np.empty(n, dtype=np.int32), np.empty(n)
    on_leaves(_nearest_of_each, tree, queries, positions, squared)
    return positions, squared


@kernel
def _nearest_of_each(first, last, runs, tree, queries, positions, squared):
    """Fill `positions` and `squared`, (Q,), in a range of runs."""
    points, lower, upper = tree
    of_queries, search, mean = queries[0], search_for(1, tree), 0.0
    for leaf in range(*leaves_of_runs(first, last, runs, queries)):
        begin, end, count, squared_radius = look_around_leaf(tree, queries, leaf, runs, mean, search, True)
        total = 0.0
        for q in range(begin, end):
            x, y, z = of_queries[0, q], of_queries[1, q], of_queries[2, q]
            slot = _nearest_packed(search.buffer.packed, count, x, y, z, squared_radius, search.squared)
            positions[q] = search.buffer.positions[slot]
            squared[q] = search.squared[slot]
            if slot < 0:
                nearest_in_tree(points, lower, upper, x, y, z, search.positions, search.gaps)
                positions[q], squared[q] = search.positions[0], search.gaps[0]
            total += squared[q]
        mean = total / (end - begin)


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def _nearest_packed(packed, count, x, y, z, radius, squared):
    """Return the slot of the packed point nearest to (x, y, z), -1 if none is within the radius."""
    along_x, along_y, along_z = packed[0][:count], packed[1][:count], packed[2][:count]
    squared, smallest = squared[:count], np.inf
    for j in range(len(along_x)):
        dx, dy, dz = along_x[j] - x, along_y[j] - y, along_z[j] - z
        squared[j] = dx * dx + dy * dy + dz * dz
        smallest = min(smallest, squared[j])
    if not smallest <= radius:
        return -1
    slot = 0
    while squared[slot] > smallest:
        slot += 1
    return slot
