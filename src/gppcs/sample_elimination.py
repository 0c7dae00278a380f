"""Weighted sample elimination for Poisson disc sets (Yuksel 2015): blue noise of exactly the size asked for."""

from __future__ import annotations

from collections.abc import Callable

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.kdtree import (
    KdTree,
    first_leaf,
    greater_child,
    greatest_in_leaf,
    greatest_of_all,
    leaves_near,
    squared_distance_to_box,
)
from gppcs.neighbourhood import surface_area

WHOLE = 2.0**28  # units in the greatest term: sums of whole numbers are the same in whatever order they are added
REMOVED = -(2.0**60)  # in place of a weight: far below any, whatever is taken from it
GREATEST_RATIO = 10  # of points before to points after a stage: a disc then holds some 36 of an even surface
REMOVALS_PER_CALL = 16384  # between two words of progress


def eliminate(
    points: NDArray[np.float64], n_points: int, advanced: Callable[[int], None] | None = None
) -> NDArray[np.int64]:
    """Remove the point whose neighbours are nearest, again and again, until `n_points` are left.

    A point weighs the sum of (1 - d / (2 r_max))^8 over the others at distances d below 2 r_max, with
    r_max = sqrt(A / (2 sqrt(3) M)) the radius of the densest packing of M discs on the surface's area A. The
    heaviest is removed, of several the one of smallest index, and the others lose what it added to them.

    The elimination goes in stages of at most a factor 10, each with the r_max of its own target: with that of a
    small M, discs would hold many points. Where the densest places hid most of the area, so that no point weighs
    anything any more, the area is estimated again. From M on, the elimination goes on by halves, as Yuksel
    proposes for progressive sets, only to order the points.

    Parameters
    ----------
    points : (N, 3) array
        Without repeats.
    n_points : int
        M, from 1 to N.
    advanced : callable, optional
        Told of the number of points removed since the last call, N - M in all.

    Returns
    -------
    (M,) array, int64
        The first M/2, M/4, ... of them are well spread as well.
    """
    area = surface_area(KdTree.build(points))
    kept = np.arange(len(points))
    later: list[NDArray[np.int64]] = []
    while len(kept) > 1:
        ordering = len(kept) <= n_points
        target = len(kept) // 2 if ordering else max(n_points, len(kept) // GREATEST_RATIO)
        removed = _removed(points[kept], target, area, None if ordering else advanced)
        if ordering:
            later.append(kept[removed[::-1]])
        kept = np.delete(kept, removed)
        if len(kept) > target:
            area = max(4.0 * area, surface_area(KdTree.build(points[kept])))
    return np.concatenate([kept, *later[::-1]])


def _removed(
    points: NDArray[np.float64], n_points: int, area: float, advanced: Callable[[int], None] | None = None
) -> NDArray[np.int64]:
    """Return the points that one stage removes, in the order removed: N - `n_points`, or all that weigh anything."""
    reach = 2.0 * float(np.sqrt(area / (2.0 * np.sqrt(3.0) * n_points)))
    tree = KdTree.build(points)
    weights = np.empty(len(points), dtype=np.float64)
    _weigh(tree.points, tree.low, tree.high, reach, weights)
    heaviest = np.empty(len(tree.low), dtype=np.float64)
    candidate = np.empty(len(tree.low), dtype=np.int64)
    greatest_of_all(tree.order, weights, heaviest, candidate)
    position = np.empty(len(points), dtype=np.int64)
    position[tree.order] = np.arange(len(points))
    removed = np.empty(len(points) - n_points, dtype=np.int64)
    for begin in range(0, len(removed), REMOVALS_PER_CALL):
        some = removed[begin : begin + REMOVALS_PER_CALL]
        count = _remove(
            tree.points, tree.order, tree.low, tree.high, position, reach, weights, heaviest, candidate, some
        )  # fmt: skip
        if advanced:
            advanced(count)
        if count < len(some):
            return removed[: begin + count]
    return removed


@nb.njit(cache=True, fastmath=False)
def _term(dx, dy, dz, reach):
    """Return what two points add to each other's weight, in units, by their difference; the same both ways."""
    term = max(1.0 - np.sqrt(dx * dx + dy * dy + dz * dz) / reach, 0.0)
    term *= term
    term *= term
    term *= term
    return np.floor(WHOLE * term)


@nb.njit(cache=True, parallel=True, nogil=True, fastmath={"reassoc"})
def _weigh(points, low, high, reach, weights):
    leaves = first_leaf(low)
    n = points.shape[1]
    for own in nb.prange(leaves):
        near = leaves_near(low, high, low[leaves + own], high[leaves + own], reach * reach)
        for i in range(n * own // leaves, n * (own + 1) // leaves):
            x, y, z = points[0, i], points[1, i], points[2, i]
            total = -WHOLE  # the point itself does not count
            for node in near:
                if squared_distance_to_box(low[node], high[node], x, y, z) > reach * reach:
                    continue
                begin, end = n * (node - leaves) // leaves, n * (node - leaves + 1) // leaves
                xs, ys, zs = points[0, begin:end], points[1, begin:end], points[2, begin:end]
                for j in range(end - begin):
                    total += _term(xs[j] - x, ys[j] - y, zs[j] - z, reach)
            weights[i] = total


@nb.njit(cache=True, nogil=True)
def _remove(points, order, low, high, position, reach, weights, heaviest, candidate, removed):
    """Fill `removed` with the heaviest points, as long as any weighs something, and return how many there are."""
    leaves = first_leaf(low)
    stack = np.empty(64, dtype=np.int64)
    visited = np.empty(leaves, dtype=np.int64)
    for m in range(len(removed)):
        if not heaviest[1] > 0.0:
            return m
        removed[m] = candidate[1]
        x, y, z = points[:, position[removed[m]]]
        weights[position[removed[m]]] = REMOVED
        stack[0] = 1
        height = 1
        inner = 0
        while height:
            height -= 1
            node = stack[height]
            if node >= leaves:
                _lighten(node, points, leaves, weights, x, y, z, reach)
                greatest_in_leaf(node, order, weights, heaviest, candidate)
                continue
            visited[inner] = node
            inner += 1
            for child in (2 * node, 2 * node + 1):
                if squared_distance_to_box(low[child], high[child], x, y, z) < reach * reach:
                    stack[height] = child
                    height += 1
        for v in range(inner - 1, -1, -1):  # children before their parents
            greater_child(visited[v], heaviest, candidate)
    return len(removed)


@nb.njit(cache=True)
def _lighten(node, points, leaves, weights, x, y, z, reach):
    """Take from the weights of a leaf's points what (x, y, z) added to them."""
    n = points.shape[1]
    begin, end = n * (node - leaves) // leaves, n * (node - leaves + 1) // leaves
    xs, ys, zs = points[0, begin:end], points[1, begin:end], points[2, begin:end]
    of_leaf = weights[begin:end]
    for j in range(end - begin):
        of_leaf[j] -= _term(xs[j] - x, ys[j] - y, zs[j] - z, reach)
