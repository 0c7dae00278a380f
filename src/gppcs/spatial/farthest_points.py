"""Farthest point sampling, exact and pruned by a k-d tree (Eldar et al. 1997; buckets: Han et al. 2023)."""

import math
from collections.abc import Callable

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.spatial.box_distances import squared_distance_to_box
from gppcs.spatial.greatest import greater_child, greatest_in_leaf, greatest_of_all
from gppcs.spatial.kdtree import KdTree, after, first_leaf, leaf_range

PICKS_PER_CALL = 4096  # progress is reported after each call of the kernel, so after this many points


def farthest_points(
    points: Floats,
    n_points: int,
    tree: KdTree | None = None,
    on_progress: Callable[[int], None] | None = None,
    *,
    first: int | None = None,
    before: Floats | None = None,
    minimum: float = 0.0,
) -> tuple[Ints, Floats]:
    """Choose points, (N, 3), each the farthest from all before it, (m, 3) of which are chosen already.

    Ties go to the first in the order of the tree. A step skips every box that lies farther from the new point than all
    points of the box lie from earlier ones. Returns the indices and the distances to the points before, down to a
    minimum.
    """
    tree = tree or KdTree.build(points)
    squared, start = np.full(len(points), np.inf), None
    if before is not None and len(before):
        squared = KdTree.build(before).nearest_of(np.ascontiguousarray(tree.points.T), 1)[1][:, 0]
    elif first is None:
        start = int(np.argmin(_squared_from(tree, tree.points.mean(axis=1))))
    if first is not None:
        start = int(np.flatnonzero(tree.order == first)[0])
    chosen = np.empty(n_points, dtype=np.int64)
    distances = np.empty(n_points, dtype=np.float64)
    if start is not None:
        chosen[0], distances[0] = start, squared[start]
        squared = np.minimum(squared, _squared_from(tree, tree.points[:, start]))
        squared[start] = -1.0
    farthest = np.empty(len(tree.lower), dtype=np.float64)
    candidate = np.empty(len(tree.lower), dtype=np.int64)
    greatest_of_all(squared, farthest, candidate)
    for begin in range(0, n_points, PICKS_PER_CALL):
        end = min(begin + PICKS_PER_CALL, n_points)
        of_choice = squared, farthest, candidate, chosen, distances
        _choose(*tree.arrays, *of_choice, max(begin, int(start is not None)), end)
        if on_progress:
            on_progress(end - begin)
        if distances[end - 1] < minimum * minimum:
            n_points = int(np.argmax(distances[:end] < minimum * minimum))
            break
    return tree.order[chosen[:n_points]], np.sqrt(distances[:n_points])


def _squared_from(tree: KdTree, place: Floats) -> Floats:
    """Return the squared distances of the points of a tree from a place, (3,), in tree order. Shapes: returns (N,)."""
    x, y, z = (tree.points - place[:, np.newaxis]) ** 2
    return np.asarray(x + y + z)


def fill_gaps(points: Floats, kept: Floats, gap: float) -> tuple[Ints, float]:
    """Add the farthest points, (N, 3), until none is beyond a gap; return indices and the largest distance."""
    minimum = float(np.nextafter(gap, math.inf))
    squared = KdTree.build(kept).nearest_of(points, 1)[1][:, 0]
    far = np.flatnonzero(squared >= minimum * minimum)
    if not len(far):
        return far, math.sqrt(squared.max())
    candidates = points[far]
    chosen, _ = farthest_points(candidates, len(far), before=kept, minimum=minimum)
    if len(chosen):
        squared = np.minimum(squared, KdTree.build(candidates[chosen]).nearest_of(points, 1)[1][:, 0])
    return far[chosen], math.sqrt(squared.max())


@kernel
def _choose(points, lower, upper, squared, farthest, candidate, chosen, distances, begin, end):
    """Fill `chosen`, positions in tree order, and `distances`, (M,), from `begin` to `end`; `squared` is (N,)."""
    leaves = first_leaf(lower)
    n = points.shape[1]
    visited = np.empty(leaves, dtype=np.int64)
    for m in range(begin, end):
        new = candidate[1]
        chosen[m] = new
        distances[m] = farthest[1]
        x, y, z = points[:, new]
        squared[new] = -1.0  # below every distance, so that a chosen point is no candidate again
        node, inner = 1, 0
        while node:
            if squared_distance_to_box(lower[node], upper[node], x, y, z) < farthest[node] or candidate[node] == new:
                if node < leaves:
                    visited[inner] = node
                    inner += 1
                    node *= 2
                    continue
                run = slice(*leaf_range(n, leaves, node))
                approach(points[0, run], points[1, run], points[2, run], squared[run], x, y, z)
                greatest_in_leaf(node, squared, farthest, candidate)
            node = after(node, 1)
        for v in range(inner - 1, -1, -1):  # children before their parents
            greater_child(visited[v], farthest, candidate)


@kernel
def approach(xs, ys, zs, squared, x, y, z):
    """Lower the squared distances of n points where (x, y, z) is nearer. Shapes: xs, ys, zs (n,), squared (n,)."""
    for j in range(len(squared)):
        squared[j] = min(squared[j], (xs[j] - x) ** 2 + (ys[j] - y) ** 2 + (zs[j] - z) ** 2)
