"""All points within a distance of each position, whose number is not known before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import QUERIES_AT_ONCE, KdTree, first_leaf, leaf_range, squared_distance_to_box

ROOM = 32  # Points of a position for which there is room at first.


def others_within(
    tree: KdTree, queries: NDArray[np.float64], squared: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find all points within a squared distance, (m,), of each query, (m, 3), but at other places; and their starts."""
    starts = np.arange(0, ROOM * len(queries) + 1, ROOM)
    while True:
        counts, found = _within(tree, queries, squared, starts)
        exact = np.concatenate([[0], np.cumsum(counts)])
        if (counts <= np.diff(starts)).all():
            filled = np.arange(exact[-1]) + np.repeat(starts[:-1] - exact[:-1], counts)
            return exact, found[filled]
        starts = exact


def has_others(tree: KdTree, queries: NDArray[np.float64], squared: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell whether, (m,), there is another point of a tree within a squared distance of each query, (m, 3)."""
    return _within(tree, queries, squared, np.zeros(len(queries) + 1, dtype=np.int64))[0] > 0


def _within(
    tree: KdTree, queries: NDArray[np.float64], squared: NDArray[np.float64], starts: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return how many others each query has, and those of them for which there is room between `starts`."""
    counts, found = np.empty(len(queries), dtype=np.int64), np.empty(starts[-1], dtype=np.int64)
    on_ranges(
        _others_within, len(queries), tree.points, tree.low, tree.high, queries, squared, starts, found, counts,
        least=QUERIES_AT_ONCE,
    )  # fmt: skip
    return counts, found


def medians(starts: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median of each group of values. Shapes: starts (m + 1,), values (n,); returns (m,)."""
    found = np.empty(len(starts) - 1)
    on_ranges(_medians, len(found), starts, values, found, least=QUERIES_AT_ONCE)
    return found


@kernel
def _others_within(begin, end, points, low, high, queries, squared, starts, found, counts):
    """Fill `counts`, (m,), and as many positions in tree order as there is room for between `starts` in `found`."""
    leaves, n = first_leaf(low), points.shape[1]
    stack = np.empty(64, dtype=np.int64)
    for q in range(begin, end):
        x, y, z = queries[q]
        free, room, count, height = starts[q], starts[q + 1] - starts[q], 0, 1
        stack[0] = 1
        while height:
            height -= 1
            node = stack[height]
            if squared_distance_to_box(low[node], high[node], x, y, z) > squared[q]:
                continue
            if node < leaves:
                stack[height], stack[height + 1] = 2 * node + 1, 2 * node
                height += 2
                continue
            for j in range(*leaf_range(n, leaves, node)):
                d = (points[0, j] - x) ** 2 + (points[1, j] - y) ** 2 + (points[2, j] - z) ** 2
                if 0.0 < d <= squared[q]:
                    if count < room:
                        found[free + count] = j
                    count += 1
        counts[q] = count


@kernel
def _medians(begin, end, starts, values, found):
    """Fill `found`, (m,), with the medians of `values` between `starts`, (m + 1,)."""
    for i in range(begin, end):
        some = np.sort(values[starts[i] : starts[i + 1]])  # NaN comes last
        n = len(some)
        found[i] = np.nan if n == 0 or np.isnan(some[-1]) else 0.5 * (some[(n - 1) // 2] + some[n // 2])
