"""The nearest triangle of each of many places, exactly: by a tree of boxes around triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range, measure_boxes, squared_distance_to_box
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
    low, high, unused = np.empty((3, 2 * leaves, 3))
    measure_boxes(np.ascontiguousarray(corners.min(axis=1).T), low, unused)
    measure_boxes(np.ascontiguousarray(corners.max(axis=1).T), unused, high)
    count = len(places)
    nearest, squared, weights = np.zeros(count, dtype=np.int64), np.empty(count), np.empty((count, 2))
    order = KdTree.build(places).order  # places after each other see the same triangles, in the cache
    on_ranges(
        _find_all, count, corners, low, high, places, order, nearest, squared, weights, least=PLACES_AT_ONCE
    )  # fmt: skip
    return sorted_ones[nearest], squared, weights


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
            if squared_distance_to_box(low[node], high[node], *place) >= least:
                continue
            if node < leaves:
                left, right = 2 * node, 2 * node + 1
                if squared_distance_to_box(low[right], high[right], *place) < squared_distance_to_box(
                    low[left], high[left], *place
                ):
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
