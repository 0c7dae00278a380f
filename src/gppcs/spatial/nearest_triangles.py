"""The nearest triangle of each of many places, exactly: by a tree of boxes around triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range
from gppcs.spatial.triangles import has_area, minus, nearest_in_triangle, row, squared_distance

TRIANGLES_IN_LEAF = 4
PLACES_AT_ONCE = 256  # places that a thread takes at once, at least
DEEPEST = 64  # nodes that wait in a search; a tree of fewer than 2^62 leaves has no more

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def nearest_triangles(vertices: Floats, faces: Ints, places: Floats) -> tuple[Ints, Floats, Floats]:
    """Return the nearest of triangles, (F, 3), to each place, (N, 3).

    Returns its number, (N,), the squared distance, (N,), and the barycentric coordinates of the nearest place on it for
    its second and its third corner, (N, 2).
    """
    sorted_ones = KdTree.build(vertices[faces].mean(axis=1)).order
    corners, leaves = vertices[faces[sorted_ones]], 1
    while len(faces) > TRIANGLES_IN_LEAF * leaves:
        leaves *= 2
    low, high = np.empty((2 * leaves, 3)), np.empty((2 * leaves, 3))
    _fill_boxes(corners, low, high)
    count = len(places)
    nearest, squared, weights = np.zeros(count, dtype=np.int64), np.empty(count), np.empty((count, 2))
    order = KdTree.build(places).order  # places after each other see the same triangles, in the cache
    on_ranges(
        _find_all, count, corners, low, high, places, order, nearest, squared, weights, least=PLACES_AT_ONCE
    )  # fmt: skip
    return sorted_ones[nearest], squared, weights


@kernel(allocates=False)
def _fill_boxes(corners, low, high):
    """Fill the boxes, (nodes, 3), of a tree over triangles, (F, 3, 3), as those of a `KdTree`."""
    leaves = first_leaf(low)
    for node in range(2 * leaves - 1, 0, -1):
        for axis in range(3):
            low[node, axis], high[node, axis] = np.inf, -np.inf
            if node < leaves:
                low[node, axis] = min(low[2 * node, axis], low[2 * node + 1, axis])
                high[node, axis] = max(high[2 * node, axis], high[2 * node + 1, axis])
                continue
            begin, end = leaf_range(len(corners), leaves, node)
            for f in range(begin, end):
                for k in range(3):
                    low[node, axis] = min(low[node, axis], corners[f, k, axis])
                    high[node, axis] = max(high[node, axis], corners[f, k, axis])


@kernel
def _find_all(first, last, corners, low, high, places, order, nearest, squared, weights):
    """Find the nearest triangles of a range of the places in their order."""
    waiting, leaves = np.empty(DEEPEST, dtype=np.int64), first_leaf(low)
    for i in order[first:last]:
        place, least, height = row(places, i), np.inf, 1
        waiting[0] = 1
        while height:
            height -= 1
            node = waiting[height]
            if _squared_to_box(place, low, high, node) >= least:
                continue
            if node < leaves:
                left, right = 2 * node, 2 * node + 1
                if _squared_to_box(place, low, high, right) < _squared_to_box(place, low, high, left):
                    left, right = right, left
                waiting[height], waiting[height + 1] = right, left
                height += 2
                continue
            begin, end = leaf_range(len(corners), leaves, node)
            for f in range(begin, end):
                a, b, c = (
                    minus(row(corners[f], 0), place),
                    minus(row(corners[f], 1), place),
                    minus(row(corners[f], 2), place),
                )
                found, s, t = _nearest_of_one(a, b, c)
                if found < least:
                    least = found
                    nearest[i], weights[i, 0], weights[i, 1] = f, s, t
        squared[i] = least


@kernel(allocates=False)
def _squared_to_box(place, low, high, node):
    """Return the squared distance of a place to the box of a node."""
    total = 0.0
    for axis in range(3):
        beside = max(low[node, axis] - place[axis], place[axis] - high[node, axis], 0.0)
        total += beside * beside
    return total


@kernel(allocates=False)
def _nearest_of_one(a, b, c):
    """Return the squared distance of a triangle to the origin, and where it is nearest; without area, of its edges."""
    if has_area(a, b, c):
        s, t = nearest_in_triangle(a, b, c)
        return squared_distance(a, b, c, s, t), s, t
    ab, _ = nearest_in_triangle(a, b, b)
    ac, _ = nearest_in_triangle(a, c, c)
    bc, _ = nearest_in_triangle(b, c, c)
    best = squared_distance(a, b, c, ab, 0.0), ab, 0.0
    for s, t in ((0.0, ac), (1.0 - bc, bc)):
        found = squared_distance(a, b, c, s, t)
        if found < best[0]:
            best = found, s, t
    return best
