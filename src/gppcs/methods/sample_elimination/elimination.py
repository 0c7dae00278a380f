"""Weighted sample elimination for Poisson disc sets (Yuksel 2015): blue noise of exactly the size asked for."""

from __future__ import annotations

from collections.abc import Callable

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.kdtree import (
    KdTree,
    first_leaf,
    greater_child,
    greatest_in_leaf,
    greatest_of_all,
    leaf_range,
    squared_distance_to_box,
)
from gppcs.spatial.spacing import surface_area

BETA, GAMMA = 0.65, 1.5  # of the limit to weights, as Yuksel has them
WHOLE = 2.0**28  # units in the greatest term: sums of whole numbers are the same in whatever order they are added
REMOVED = -(2.0**60)  # in place of a weight: far below any, whatever is taken from it
LAST_RATIO = 40  # of points before to points after the last stage: a disc then holds some 145 of an even surface
EARLIER_RATIO = 10  # of the stages before it
REMOVALS_PER_CALL = 16384  # between two words of progress


def eliminate(
    points: NDArray[np.float64], n_points: int, advanced: Callable[[int], None] | None = None
) -> NDArray[np.int64]:
    """Remove points as `thin` does until `n_points` are left, and order these.

    For the order, the elimination goes on by halves, as Yuksel proposes for progressive sets.

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
    kept, area = thin(points, n_points, advanced)
    later: list[NDArray[np.int64]] = []
    while len(kept) > 1:
        removed, area = _stage(points[kept], len(kept) // 2, area)
        later.append(kept[removed[::-1]])
        kept = np.delete(kept, removed)
    return np.concatenate([kept, *later[::-1]])


def thin(
    points: NDArray[np.float64], n_points: int, advanced: Callable[[int], None] | None = None
) -> tuple[NDArray[np.int64], float]:
    """Remove the point whose neighbours are nearest, again and again, until `n_points` are left.

    A point weighs the sum of (1 - max(d, 2 r_min) / (2 r_max))^8 over the others at distances d below 2 r_max, with
    r_max = sqrt(A / (2 sqrt(3) M)) the radius of the densest packing of M discs on the surface's area A. The
    heaviest is removed, of several the one of smallest index, and the others lose what it added to them.

    The limit r_min = beta r_max (1 - (M / N)^gamma), with beta = 0.65 and gamma = 1.5, is Yuksel's weight limiting:
    without it, a pair that happens to be very near outweighs a crowd.

    Beyond a ratio of 40, stages of at most a factor 10 go before the last one, each with the N, M, r_max and r_min of
    its own: with those of a small M, discs would hold many points. Where the densest places hid most of the area,
    so that no point weighs anything any more, the area is estimated again.

    Parameters
    ----------
    points, n_points, advanced
        As of `eliminate`.

    Returns
    -------
    kept : (M,) array, int64
        Ascending.
    area : float
        A, as last estimated.
    """
    kept = np.arange(len(points))
    area = surface_area(KdTree.build(points))
    while len(kept) > n_points:
        last = len(kept) <= LAST_RATIO * n_points
        target = n_points if last else max(LAST_RATIO * n_points, len(kept) // EARLIER_RATIO)
        removed, area = _stage(points[kept], target, area, advanced)
        kept = np.delete(kept, removed)
    return kept, area


def _stage(
    points: NDArray[np.float64], n_points: int, area: float, advanced: Callable[[int], None] | None = None
) -> tuple[NDArray[np.int64], float]:
    """Return what one stage removes, in that order, N - `n_points` or all that weigh anything; and the area after it.

    The area is larger where nothing weighed anything.
    """
    reach = 2.0 * float(np.sqrt(area / (2.0 * np.sqrt(3.0) * n_points)))
    limit = reach * BETA * (1.0 - (n_points / len(points)) ** GAMMA)
    tree = KdTree.build(points)
    weights = np.empty(len(points), dtype=np.float64)
    _weigh(tree.points, tree.low, tree.high, reach, limit, weights)
    heaviest = np.empty(len(tree.low), dtype=np.float64)
    candidate = np.empty(len(tree.low), dtype=np.int64)
    greatest_of_all(tree.order, weights, heaviest, candidate)
    pending = np.zeros(len(tree.low), dtype=np.float64)
    position = tree.positions()
    removed = np.empty(len(points) - n_points, dtype=np.int64)
    for begin in range(0, len(removed), REMOVALS_PER_CALL):
        some = removed[begin : begin + REMOVALS_PER_CALL]
        count = _remove(
            tree.points, tree.order, tree.low, tree.high, position, reach, limit,
            weights, heaviest, candidate, pending, some,
        )  # fmt: skip
        if advanced:
            advanced(count)
        if count < len(some):
            removed = removed[: begin + count]
            return removed, max(4.0 * area, surface_area(KdTree.build(np.delete(points, removed, axis=0))))
    return removed, area


@nb.njit(cache=True, fastmath=False)
def _term(dx, dy, dz, reach, limit):
    """Return what two points add to each other's weight, in units, by their difference; the same both ways."""
    distance = max(np.sqrt(dx * dx + dy * dy + dz * dz), limit)
    term = max(1.0 - distance / reach, 0.0)
    term *= term
    term *= term
    term *= term
    return np.floor(WHOLE * term)


@nb.njit(cache=True, fastmath=False)
def _squared_distances(low, high, box_low, box_high):
    """Return the squares of the least and the greatest distance between points of two boxes."""
    least = greatest = 0.0
    for axis in range(3):
        least += max(low[axis] - box_high[axis], box_low[axis] - high[axis], 0.0) ** 2
        greatest += max(high[axis] - box_low[axis], box_high[axis] - low[axis]) ** 2
    return least, greatest


@nb.njit(cache=True, parallel=True, nogil=True, fastmath={"reassoc"})
def _weigh(points, low, high, reach, limit, weights):
    leaves = first_leaf(low)
    n = points.shape[1]
    of_near = _term(0.0, 0.0, 0.0, reach, limit)
    for own in nb.prange(leaves):
        around, near = _within_reach(low, high, n, leaves + own, reach, limit)
        for i in range(*leaf_range(n, leaves, leaves + own)):
            x, y, z = points[0, i], points[1, i], points[2, i]
            total = (near - 1) * of_near  # the point itself does not count
            for node in around:
                if squared_distance_to_box(low[node], high[node], x, y, z) > reach * reach:
                    continue
                begin, end = leaf_range(n, leaves, node)
                xs, ys, zs = points[0, begin:end], points[1, begin:end], points[2, begin:end]
                for j in range(end - begin):
                    total += _term(xs[j] - x, ys[j] - y, zs[j] - z, reach, limit)
            weights[i] = total


@nb.njit(cache=True)
def _within_reach(low, high, n, leaf, reach, limit):
    """Return the leaves within reach of one, and how many points are in other nodes, wholly within the limit of it."""
    around, near = [], 0
    remaining = [(1, 0, 1)]
    while remaining:
        node, j, nodes = remaining.pop()  # the j-th of the nodes of its level
        least, greatest = _squared_distances(low[node], high[node], low[leaf], high[leaf])
        if greatest < limit * limit:
            near += n * (j + 1) // nodes - n * j // nodes
        elif least <= reach * reach:
            if node >= first_leaf(low):
                around.append(node)
            else:
                remaining.append((2 * node, 2 * j, 2 * nodes))
                remaining.append((2 * node + 1, 2 * j + 1, 2 * nodes))
    return around, near


@nb.njit(cache=True, nogil=True)
def _remove(points, order, low, high, position, reach, limit, weights, heaviest, candidate, pending, removed):
    """Fill `removed` with the heaviest points, as long as any weighs something, and return how many there are.

    What a node wholly within the limit loses is left pending there: `heaviest` is less that of the node and of those
    below it, but not of those above, and the order within the node stays as it was.
    """
    leaves = first_leaf(low)
    of_near = _term(0.0, 0.0, 0.0, reach, limit)
    stack = np.empty(64, dtype=np.int64)
    visited = np.empty(leaves, dtype=np.int64)
    for m in range(len(removed)):
        if not heaviest[1] > 0.0:
            return m
        index = removed[m] = candidate[1]
        place = points[:, position[index]].copy()
        weights[position[index]] = REMOVED
        stack[0] = 1
        height = 1
        inner = 0
        while height:
            height -= 1
            node = stack[height]
            if node >= leaves:
                _lighten(node, points, leaves, weights, place, reach, limit)
                greatest_in_leaf(node, order, weights, heaviest, candidate)
                heaviest[node] -= pending[node]
                continue
            visited[inner] = node
            inner += 1
            for child in (2 * node, 2 * node + 1):
                least, greatest = _squared_distances(low[child], high[child], place, place)
                if greatest < limit * limit and candidate[child] != index:
                    pending[child] += of_near
                    heaviest[child] -= of_near
                elif least < reach * reach:
                    stack[height] = child
                    height += 1
        for v in range(inner - 1, -1, -1):  # children before their parents
            greater_child(visited[v], heaviest, candidate)
            heaviest[visited[v]] -= pending[visited[v]]
    return len(removed)


@nb.njit(cache=True)
def _lighten(node, points, leaves, weights, place, reach, limit):
    """Take from the weights of a leaf's points what the one at `place` added to them."""
    n = points.shape[1]
    begin, end = leaf_range(n, leaves, node)
    xs, ys, zs = points[0, begin:end], points[1, begin:end], points[2, begin:end]
    x, y, z = place
    of_leaf = weights[begin:end]
    for j in range(end - begin):
        of_leaf[j] -= _term(xs[j] - x, ys[j] - y, zs[j] - z, reach, limit)
