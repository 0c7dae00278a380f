"""Searches of single queries: all points within a distance, and the nearest points, no point twice."""

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.box_distances import squared_distance_to_box
from gppcs.spatial.kdtree import QUERIES_AT_ONCE, KdTree, after, first_leaf, leaf_range, nearer_child, unvisited_sibling


def others_within(tree: KdTree, queries: Floats, squared: Floats) -> tuple[Ints, Ints]:
    """Find all points within a squared distance, (m,), of each query, (m, 3), but not at it; and their starts."""
    starts = np.arange(0, 32 * len(queries) + 1, 32)  # at first there is room for so many points of each
    while True:
        counts, positions = _within(tree, queries, squared, starts)
        exact = np.concatenate([[0], np.cumsum(counts)])
        if (counts <= np.diff(starts)).all():
            filled = np.arange(exact[-1]) + np.repeat(starts[:-1] - exact[:-1], counts)
            return exact, positions[filled]
        starts = exact


def has_others(tree: KdTree, queries: Floats, squared: Floats) -> Flags:
    """Tell whether, (m,), there is another point of a tree within a squared distance of each query, (m, 3)."""
    return _within(tree, queries, squared, np.zeros(len(queries) + 1, dtype=np.int64))[0] > 0


def _within(tree: KdTree, queries: Floats, squared: Floats, starts: Ints) -> tuple[Ints, Ints]:
    """Return how many others each query has, and those of them for which there is room between `starts`."""
    counts, positions = np.empty(len(queries), dtype=np.int64), np.empty(starts[-1], dtype=np.int64)
    outputs = positions, counts
    on_ranges(_others_within, len(queries), *tree.arrays, queries, squared, starts, *outputs, minimum=QUERIES_AT_ONCE)
    return counts, positions


def medians(starts: Ints, values: Floats) -> Floats:
    """Return the median of each group of values. Shapes: starts (m + 1,), values (n,); returns (m,)."""
    result = np.empty(len(starts) - 1)
    on_ranges(_medians, len(result), starts, values, result, minimum=QUERIES_AT_ONCE)
    return result


@kernel
def _others_within(begin, end, points, lower, upper, queries, squared, starts, positions, counts):
    """Fill `counts`, (m,), and as many positions in tree order as there is room for between `starts`."""
    leaves, n = first_leaf(lower), points.shape[1]
    for q in range(begin, end):
        x, y, z = queries[q]
        free, room = starts[q], starts[q + 1] - starts[q]
        node, count = 1, 0
        while node:
            if squared_distance_to_box(lower[node], upper[node], x, y, z) <= squared[q]:
                if node < leaves:
                    node *= 2
                    continue
                for j in range(*leaf_range(n, leaves, node)):
                    d = (points[0, j] - x) ** 2 + (points[1, j] - y) ** 2 + (points[2, j] - z) ** 2
                    if 0.0 < d <= squared[q]:
                        if count < room:
                            positions[free + count] = j
                        count += 1
            node = after(node, 1)
        counts[q] = count


@kernel
def _medians(begin, end, starts, values, result):
    """Fill `result`, (m,), with the medians of `values` between `starts`, (m + 1,)."""
    for i in range(begin, end):
        ascending = np.sort(values[starts[i] : starts[i + 1]])  # NaN comes last
        n = len(ascending)
        middle = 0.5 * (ascending[(n - 1) // 2] + ascending[n // 2]) if n else np.nan
        result[i] = np.nan if n == 0 or np.isnan(ascending[-1]) else middle


def nearest_unused(positions: Floats, tree: KdTree) -> Ints:
    """Assign to each position, (M, 3), one after the other, the nearest point that is not assigned yet; (M,)."""
    taken = np.zeros(len(tree.order), dtype=np.bool_)
    leaves = tree.leaves
    unused = np.zeros(2 * leaves, dtype=np.int64)
    unused[leaves:] = np.diff(np.arange(leaves + 1) * len(taken) // leaves)
    for node in range(leaves - 1, 0, -1):
        unused[node] = unused[2 * node] + unused[2 * node + 1]
    indices = np.empty(len(positions), dtype=np.int64)
    _take_nearest(positions, tree.points, tree.order, tree.lower, tree.upper, taken, unused, indices)
    return indices


@kernel
def _take_nearest(positions, points, order, lower, upper, taken, unused, indices):
    """Fill `indices`, (M,), for `positions`, (M, 3); `taken`, (N,), and `unused`, (nodes,), are updated."""
    leaves = first_leaf(lower)
    for p in range(len(positions)):
        x, y, z = positions[p]
        best = _nearest_untaken(points, order, lower, upper, taken, unused, x, y, z)
        indices[p] = order[best]
        taken[best] = True
        # The leaf that holds the position `best`: the inverse of the formula in `leaf_range`.
        node = leaves + ((best + 1) * leaves - 1) // points.shape[1]
        while node:
            unused[node] -= 1
            node //= 2


@kernel
def _nearest_untaken(points, order, lower, upper, taken, unused, x, y, z):
    """Return the position of the point nearest (x, y, z) that is not `taken`, (N,); ties go to the smallest index."""
    leaves = first_leaf(lower)
    n = points.shape[1]
    best, nearest = -1, np.inf
    node, visited = 1, 0
    while node:
        if unused[node] and squared_distance_to_box(lower[node], upper[node], x, y, z) <= nearest:
            if node < leaves:
                node, visited = nearer_child(node, lower, upper, x, y, z), 2 * visited
                continue
            for j in range(*leaf_range(n, leaves, node)):
                squared = (points[0, j] - x) ** 2 + (points[1, j] - y) ** 2 + (points[2, j] - z) ** 2
                if not taken[j] and (squared < nearest or (squared == nearest and order[j] < order[best])):
                    best, nearest = j, squared
        node, visited = unvisited_sibling(node, visited)
    return best
