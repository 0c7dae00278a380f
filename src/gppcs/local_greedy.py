"""Greedy selection by uncertainty plus error (paper, Algorithm 1) in a local field: each choice changes little."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.kdtree import KdTree, first_leaf, greater_child, greatest_in_leaf, greatest_of_all, squared_distance_to_box
from gppcs.local_field import Conditioning, LocalField, condition, keep_nearest, posterior, squared_distance

TAKEN = -1.0  # in place of the score of a chosen point: below any
CHUNKS = 256  # of the points, in whatever number of threads


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
    conditioning = condition(field, chosen, neighbours)
    scores = np.zeros(len(field.y))
    scores[chosen] = TAKEN
    _score_all(field, conditioning, error_weight, scores)
    nodes = _nodes(field, tree, conditioning, scores)
    position = np.empty(len(tree.order), dtype=np.int64)
    position[tree.order] = np.arange(len(tree.order))
    extended = np.concatenate([chosen, np.empty(n_points - len(chosen), dtype=np.int64)])
    added = np.empty((2, n_points - len(chosen)))
    _choose(field, conditioning, nodes, position, error_weight, scores, extended[len(chosen) :], added)
    return extended, added[0], added[1]


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


@nb.njit(cache=True, fastmath=False)
def _score(field, conditioning, error_weight, i, work):
    """Return the score of a point and the posterior's standard deviation there."""
    mean, variance = posterior(field, i, conditioning.nearest[i], conditioning.squared[i], work)
    gain = variance / (variance + field.noise[i])
    return np.sqrt(gain * variance) + error_weight * gain * abs(mean - field.y[i]), np.sqrt(variance)


@nb.njit(cache=True, parallel=True, nogil=True, fastmath=False)
def _score_all(field, conditioning, error_weight, scores):
    n, k = conditioning.nearest.shape
    for chunk in nb.prange(CHUNKS):
        work = np.empty((k, k + 2), dtype=np.float64)
        for i in range(n * chunk // CHUNKS, n * (chunk + 1) // CHUNKS):
            if scores[i] != TAKEN:
                scores[i], _ = _score(field, conditioning, error_weight, i, work)


@nb.njit(cache=True, nogil=True, fastmath=False)
def _choose(field, conditioning, nodes, position, error_weight, scores, chosen, added):
    """Fill `chosen` and, of each, score and standard deviation into the rows of `added`."""
    k = conditioning.nearest.shape[1]
    leaves = first_leaf(nodes.low)
    work = np.empty((k, k + 2), dtype=np.float64)
    stack = np.empty(64, dtype=np.int64)
    visited = np.empty(leaves, dtype=np.int64)
    for m in range(len(chosen)):
        new = position[nodes.holder[1]]
        chosen[m] = new
        added[0, m], added[1, m] = _score(field, conditioning, error_weight, new, work)
        scores[new] = TAKEN
        x, y, z = field.positions[:, new]
        stack[0] = 1
        height, inner = 1, 0
        while height:
            height -= 1
            node = stack[height]
            if node >= leaves:
                _tell_leaf(node, new, field, conditioning, nodes, error_weight, scores, work)
                continue
            visited[inner] = node
            inner += 1
            for child in (2 * node, 2 * node + 1):
                scale = 0.5 * (nodes.widest[child] ** 2 + field.spacings[new] ** 2)
                gap = squared_distance_to_box(nodes.low[child], nodes.high[child], x, y, z)
                if gap <= nodes.reach[child] * scale:
                    stack[height] = child
                    height += 1
        for v in range(inner - 1, -1, -1):  # children before their parents
            node = visited[v]
            greater_child(node, nodes.best, nodes.holder)
            nodes.reach[node] = max(nodes.reach[2 * node], nodes.reach[2 * node + 1])


@nb.njit(cache=True, fastmath=False)
def _tell_leaf(node, new, field, conditioning, nodes, error_weight, scores, work):
    """Let the points of a leaf know of the new one, and score again those that are conditioned on it."""
    n, leaves = len(scores), first_leaf(nodes.low)
    reach = 0.0
    for i in range(n * (node - leaves) // leaves, n * (node - leaves + 1) // leaves):
        if scores[i] == TAKEN:
            continue
        farthest = conditioning.squared[i, -1]
        distance = squared_distance(field, i, new)
        if distance < farthest:
            keep_nearest(conditioning.nearest[i], conditioning.squared[i], new, distance)
            scores[i], _ = _score(field, conditioning, error_weight, i, work)
            farthest = conditioning.squared[i, -1]
        reach = max(reach, farthest)
    nodes.reach[node] = reach
    greatest_in_leaf(node, nodes.order, scores, nodes.best, nodes.holder)
