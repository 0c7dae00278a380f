"""Greedy selection by uncertainty plus error (paper, Algorithm 1) in a local field: each choice changes little."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.kdtree import (
    LEAF_SIZE,
    KdTree,
    first_leaf,
    greater_child,
    greatest_in_leaf,
    greatest_of_all,
    squared_distance_to_box,
)
from gppcs.local_field import Conditioning, LocalField, condition, keep_nearest, squared_distance
from gppcs.local_posterior import LANES, posterior, posteriors, workspace

TAKEN = -1.0  # in place of the score of a chosen point: below any


class _Nodes(NamedTuple):
    """The k-d tree above the points, and for each node what is needed to pass it by.

    `best` is the greatest score in the node and `holder` the point with it; `reach` the greatest distance in the field
    within which a point's conditioning would change, squared; `widest` the greatest spacing.
    """

    order: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    best: NDArray[np.float64]
    holder: NDArray[np.int64]
    reach: NDArray[np.float64]
    widest: NDArray[np.float64]


def extend(
    field: LocalField, tree: KdTree, chosen: NDArray[np.int64], n_points: int, neighbours: int, error_weight: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Choose one point after another, always that of the largest score, until `n_points` are chosen.

    With sigma^2 and mu the posterior's variance and mean at a point and nu its noise, an observation there has the
    gain g = sigma^2 / (sigma^2 + nu): it takes g sigma^2 from the variance and moves the mean by g (y - mu). The score
    is sqrt(g) sigma + w g |mu - y|. Without noise g is 1, and this is the paper's s = sqrt(diag Sigma) + |mu - y|.

    No choice is missed: a point's posterior changes only if the new point is among the nearest that it is conditioned
    on, and a node of the tree is passed by only if that can be so of none of its points.

    Parameters
    ----------
    field : LocalField
        In the tree's order.
    tree : KdTree
        Over the field's positions.
    chosen : (m,) array
        Positions in the tree's order of the points chosen already, in their order.
    n_points : int
        From m to n.
    neighbours : int
        K: how many chosen points a point is conditioned on.
    error_weight : float
        w.

    Returns
    -------
    chosen : (n_points,) array
        The same continued; of equal scores, that of the smallest index in the tree's input.
    scores, deviations : (n_points - m,) arrays
        Score and sigma of each added point when it was chosen.
    """
    conditioning = condition(field, tree, chosen, neighbours)
    means, variances = posterior(field, conditioning)
    scores = _score(means, variances, field.y, field.noise, error_weight)
    scores[chosen] = TAKEN
    nodes = _nodes(field, tree, conditioning, scores)
    position = np.empty(len(tree.order), dtype=np.int64)
    position[tree.order] = np.arange(len(tree.order))
    extended = np.concatenate([chosen, np.empty(n_points - len(chosen), dtype=np.int64)])
    added = np.empty((2, n_points - len(chosen)))
    _choose(field, conditioning, nodes, position, error_weight, variances, scores, extended[len(chosen) :], added)
    return extended, added[0], np.sqrt(added[1])


def _nodes(field: LocalField, tree: KdTree, conditioning: Conditioning, scores: NDArray[np.float64]) -> _Nodes:
    best, holder = np.empty(len(tree.low)), np.empty(len(tree.low), dtype=np.int64)
    greatest_of_all(tree.order, scores, best, holder)
    free = np.where(scores == TAKEN, 0.0, conditioning.squared[:, -1])
    reach, widest = _greatest(free, len(tree.low)), _greatest(field.spacings, len(tree.low))
    return _Nodes(tree.order, tree.low, tree.high, best, holder, reach, widest)


def _greatest(values: NDArray[np.float64], nodes: int) -> NDArray[np.float64]:
    """Return the greatest value in each node of the tree in whose order the values are."""
    leaves = nodes // 2
    greatest = np.empty(nodes)
    greatest[leaves:] = np.maximum.reduceat(values, np.arange(leaves) * len(values) // leaves)
    level = leaves
    while level > 1:
        level //= 2
        below = greatest[2 * level : 4 * level]
        greatest[level : 2 * level] = np.maximum(below[::2], below[1::2])
    return greatest


@nb.njit(cache=True, error_model="numpy", fastmath=False)
def _score(mean, variance, y, noise, error_weight):
    gain = variance / (variance + noise)
    return np.sqrt(gain * variance) + error_weight * gain * np.abs(mean - y)


@nb.njit(cache=True, nogil=True, fastmath=False)
def _choose(field, conditioning, nodes, position, error_weight, variances, scores, chosen, added):
    """Fill `chosen` and, of each, score and variance into the rows of `added`."""
    work = workspace(conditioning.nearest.shape[1])
    visited = np.empty(len(nodes.low), dtype=np.int64)
    changed = np.empty(len(scores), dtype=np.int64)
    gaps = np.empty(LEAF_SIZE, dtype=np.float64)
    for m in range(len(chosen)):
        new = position[nodes.holder[1]]
        chosen[m], added[0, m], added[1, m] = new, scores[new], variances[new]
        scores[new] = TAKEN
        nodes_visited, points_changed = _tell(new, field, conditioning, nodes, scores, visited, changed, gaps)
        for begin in range(0, points_changed, LANES):
            end = min(begin + LANES, points_changed)
            posteriors(field, conditioning.nearest, changed, begin, end, work)
            for p in range(end - begin):
                i = changed[begin + p]
                variances[i] = work.variance[p]
                scores[i] = _score(work.mean[p], work.variance[p], field.y[i], field.noise[i], error_weight)
        for v in range(nodes_visited - 1, -1, -1):  # children before their parents
            _renew(visited[v], conditioning, nodes, scores)


@nb.njit(cache=True, fastmath=False)
def _tell(new, field, conditioning, nodes, scores, visited, changed, gaps):
    """Condition on the new point what it is near to; return the numbers of nodes visited and of points changed."""
    n, leaves = len(scores), first_leaf(nodes.low)
    x, y, z = field.positions[:, new]
    stack = np.empty(64, dtype=np.int64)
    stack[0] = 1
    height, seen, count = 1, 0, 0
    while height:
        height -= 1
        node = stack[height]
        visited[seen] = node
        seen += 1
        if node < leaves:
            for child in (2 * node, 2 * node + 1):
                scale = 0.5 * (nodes.widest[child] ** 2 + field.spacings[new] ** 2)
                gap = squared_distance_to_box(nodes.low[child], nodes.high[child], x, y, z)
                if gap <= nodes.reach[child] * scale:
                    stack[height] = child
                    height += 1
            continue
        begin, end = n * (node - leaves) // leaves, n * (node - leaves + 1) // leaves
        for slot in range(end - begin):
            gaps[slot] = squared_distance(field, begin + slot, new)
        for slot in range(end - begin):
            i = begin + slot
            if gaps[slot] < conditioning.squared[i, -1] and scores[i] != TAKEN:
                keep_nearest(conditioning.nearest[i], conditioning.squared[i], new, gaps[slot])
                changed[count] = i
                count += 1
    return seen, count


@nb.njit(cache=True, fastmath=False)
def _renew(node, conditioning, nodes, scores):
    """Renew what is kept of a node, from its points or its children."""
    n, leaves = len(scores), first_leaf(nodes.low)
    if node < leaves:
        greater_child(node, nodes.best, nodes.holder)
        nodes.reach[node] = max(nodes.reach[2 * node], nodes.reach[2 * node + 1])
        return
    greatest_in_leaf(node, nodes.order, scores, nodes.best, nodes.holder)
    reach = 0.0
    for i in range(n * (node - leaves) // leaves, n * (node - leaves + 1) // leaves):
        if scores[i] != TAKEN:
            reach = max(reach, conditioning.squared[i, -1])
    nodes.reach[node] = reach
