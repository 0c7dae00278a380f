"""Greedy selection in a local field (paper, Algorithm 1), exact although each choice updates only few points.

The score is the uncertainty, plus the error if that has a weight. By default it has none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.gp.local.conditioning import Conditioning, condition
from gppcs.gp.local.kernel import LANES, LocalField, field_distance
from gppcs.gp.local.posterior import posterior, posteriors, sites_of, workspace
from gppcs.spatial.kdtree import LEAF_SIZE, KdTree, greater_child, leaf_range

TAKEN = -1.0  # Score and reach of a chosen point: below those of all others.
SPACING, SCORE, REACH, INDEX, ROWS = 6, 7, 8, 9, 10  # Rows of a leaf. The first six are position and normal.


class _Nodes(NamedTuple):
    """The nodes of the k-d tree, with what decides whether a node can be skipped.

    The *reach* of a point is the squared distance in the field to the last of the chosen points that it is conditioned
    on. Only a nearer new point changes its posterior.

    Attributes
    ----------
    boxes : (nodes, 8) array
        Low and high corner of the box, largest reach of its points, square of their largest desired spacing. These
        eight numbers fill one line of memory.
    best : (nodes,) array
        The largest score in the node.
    holder : (nodes,) array, int64
        Index in the tree's input of the point with this score; of several the smallest.
    leaves : (leaves, ROWS, LEAF_SIZE) array
        The points of each leaf, in columns: position, normal, desired spacing, score, reach and index. Columns that are
        left over count as taken.
    """

    boxes: NDArray[np.float64]
    best: NDArray[np.float64]
    holder: NDArray[np.int64]
    leaves: NDArray[np.float64]


def extend(
    field: LocalField, tree: KdTree, chosen: NDArray[np.int64], n_points: int, neighbours: int, error_weight: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Choose the point with the largest score, again and again, until `n_points` are chosen.

    Let a point have the posterior mean mu and variance sigma^2, and an observation there the variance nu. It has the
    gain g = sigma^2 / (sigma^2 + nu): it lowers the variance by g sigma^2 and moves the mean by g (y - mu). The score
    is sqrt(g) sigma + w g |mu - y|. Without noise and with w = 1 this is the paper's s = sqrt(diag Sigma) + |mu - y|.

    The choice is exact. A posterior changes only if the new point is among the nearest on which the point is
    conditioned, and a node of the tree is skipped only if this holds for none of its points.

    Parameters
    ----------
    field : LocalField
        In the tree's order.
    tree : KdTree
        Over the field's positions.
    chosen : (m,) array
        Columns in the tree's order of the points chosen so far, in the order of choice.
    n_points : int
        From m to n.
    neighbours : int
        K: the number of chosen points on which a point is conditioned.
    error_weight : float
        w, the weight of the error.

    Returns
    -------
    chosen : (n_points,) array
        `chosen`, continued. Of equal scores the smallest index in the tree's input wins.
    scores, deviations : (n_points - m,) arrays
        Score and sigma of each new point when it was chosen.
    """
    sites = sites_of(field)
    conditioning = condition(field, tree, chosen, neighbours)
    variances, scores = posterior(field, sites, conditioning, error_weight)[1:]
    scores[chosen] = TAKEN
    nodes = _nodes(field, tree, conditioning, scores)
    extended = np.concatenate([chosen, np.empty(n_points - len(chosen), dtype=np.int64)])
    added = np.empty((2, n_points - len(chosen)))
    _choose(
        field, sites, conditioning, nodes, tree.positions(), error_weight, variances, extended[len(chosen) :], added
    )
    return extended, added[0], np.sqrt(added[1])


def _nodes(field: LocalField, tree: KdTree, conditioning: Conditioning, scores: NDArray[np.float64]) -> _Nodes:
    """Return the nodes, given the scores, (n,), of all points."""
    count = len(tree.low)
    nodes = _Nodes(
        np.concatenate([tree.low, tree.high, np.empty((count, 2))], axis=1),
        np.empty(count), np.empty(count, dtype=np.int64), np.empty((count // 2, ROWS, LEAF_SIZE)),
    )  # fmt: skip
    reach = np.where(scores == TAKEN, TAKEN, conditioning.squared[:, -1])
    _fill(field, tree.order, scores, reach, nodes)
    return nodes


@kernel
def _fill(field, order, scores, reach, nodes):
    """Fill leaves and nodes, given order, scores and reaches of the points, (n,) each."""
    leaves = len(nodes.leaves)
    for leaf in range(leaves):
        _fill_leaf(field, order, scores, reach, leaf, nodes)
    for node in range(leaves - 1, 0, -1):
        nodes.boxes[node, 7] = max(nodes.boxes[2 * node, 7], nodes.boxes[2 * node + 1, 7])
        _renew_inner(node, nodes)


@kernel
def _fill_leaf(field, order, scores, reach, leaf, nodes):
    """Fill one leaf and its node."""
    n, leaves = len(order), len(nodes.leaves)
    rows = nodes.leaves[leaf]
    rows[:] = 0.0
    rows[SPACING], rows[SCORE], rows[REACH], rows[INDEX] = 1.0, TAKEN, TAKEN, n
    widest = 0.0
    begin, end = leaf_range(n, leaves, leaves + leaf)
    for i in range(begin, end):
        p = i - begin
        for axis in range(3):
            rows[axis, p], rows[3 + axis, p] = field.positions[axis, i], field.normals[axis, i]
        rows[SPACING, p], rows[SCORE, p] = field.spacings[i], scores[i]
        rows[REACH, p], rows[INDEX, p] = reach[i], order[i]
        widest = max(widest, field.spacings[i])
    nodes.boxes[leaves + leaf, 7] = widest**2
    _renew_leaf(leaves + leaf, nodes)


@kernel(fastmath=False)
def _choose(field, sites, conditioning, nodes, position, error_weight, variances, chosen, added):
    """Fill `chosen`, (m,), one choice after another, and `added`, (2, m), with score and variance of each.

    `sites` is (n, 9); `position`, the inverse of the tree's order, and `variances` are (n,).
    """
    n, leaves = len(sites), len(nodes.leaves)
    work = workspace(conditioning.nearest.shape[1])
    visited = np.empty(len(nodes.best), dtype=np.int64)
    changed = np.empty(n, dtype=np.int64)
    gaps = np.empty(LEAF_SIZE, dtype=np.float64)
    for m in range(len(chosen)):
        new = position[nodes.holder[1]]  # node 1 is the root: it holds the largest score of all
        leaf = ((new + 1) * leaves - 1) // n
        column = new - n * leaf // leaves
        chosen[m], added[0, m], added[1, m] = new, nodes.leaves[leaf, SCORE, column], variances[new]
        nodes.leaves[leaf, SCORE, column] = nodes.leaves[leaf, REACH, column] = TAKEN
        nodes_visited, points_changed = _tell(new, field, sites, conditioning, nodes, visited, changed, gaps)
        for begin in range(0, points_changed, LANES):
            end = min(begin + LANES, points_changed)
            posteriors(field, sites, conditioning.nearest, changed, begin, end, error_weight, work)
            for p in range(end - begin):
                i = changed[begin + p]
                leaf = ((i + 1) * leaves - 1) // n
                variances[i], nodes.leaves[leaf, SCORE, i - n * leaf // leaves] = work.variance[p], work.score[p]
        for v in range(nodes_visited - 1, -1, -1):  # children before their parents
            if visited[v] < leaves:
                _renew_inner(visited[v], nodes)
            else:
                _renew_leaf(visited[v], nodes)


@kernel(error_model="numpy", fastmath=False)
def _tell(new, field, sites, conditioning, nodes, visited, changed, gaps):
    """Condition the points around a new point on it.

    Fill `visited`, (nodes,), and `changed`, (n,); return how many entries of each are valid. `gaps` is (LEAF_SIZE,).
    """
    n, leaves = len(sites), len(nodes.leaves)
    x, y, z, u, v, w = sites[new, 0], sites[new, 1], sites[new, 2], sites[new, 3], sites[new, 4], sites[new, 5]
    spacing = sites[new, SPACING]
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
                if _comes_within_reach(nodes.boxes, child, x, y, z, spacing):
                    stack[height] = child
                    height += 1
            continue
        leaf = node - leaves
        begin, last = n * leaf // leaves, conditioning.nearest.shape[1] - 1
        for p in range(LEAF_SIZE):
            rows = nodes.leaves
            cosine = rows[leaf, 3, p] * u + rows[leaf, 4, p] * v + rows[leaf, 5, p] * w
            gaps[p] = field_distance(
                rows[leaf, 0, p] - x, rows[leaf, 1, p] - y, rows[leaf, 2, p] - z, cosine, rows[leaf, SPACING, p],
                spacing, field.normal_weight,
            )  # fmt: skip
        for p in range(LEAF_SIZE):
            if gaps[p] < nodes.leaves[leaf, REACH, p]:
                _keep_nearest(conditioning, begin + p, new, gaps[p])
                nodes.leaves[leaf, REACH, p] = conditioning.squared[begin + p, last]
                changed[count] = begin + p
                count += 1
    return seen, count


@kernel(fastmath=False)
def _comes_within_reach(boxes, node, x, y, z, spacing):
    """Return whether a new point may be within the reach of a point of the node; `boxes` is (nodes, 8)."""
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz <= boxes[node, 6] * (0.5 * (boxes[node, 7] + spacing**2))


@kernel(fastmath=False)
def _keep_nearest(conditioning, i, new, gap):
    """Insert a chosen point among those that point i is conditioned on, and drop the last."""
    slot = conditioning.nearest.shape[1] - 1
    while slot > 0 and conditioning.squared[i, slot - 1] > gap:
        conditioning.squared[i, slot] = conditioning.squared[i, slot - 1]
        conditioning.nearest[i, slot] = conditioning.nearest[i, slot - 1]
        slot -= 1
    conditioning.squared[i, slot], conditioning.nearest[i, slot] = gap, new


@kernel(fastmath=False)
def _renew_inner(node, nodes):
    """Update score, holder and reach of a node from its children."""
    greater_child(node, nodes.best, nodes.holder)
    nodes.boxes[node, 6] = max(nodes.boxes[2 * node, 6], nodes.boxes[2 * node + 1, 6])


@kernel(fastmath={"nnan", "nsz"})
def _renew_leaf(node, nodes):
    """Update score, holder and reach of a leaf's node from its points."""
    leaf = node - len(nodes.leaves)
    best, reach, index = TAKEN, TAKEN, np.inf
    for p in range(LEAF_SIZE):
        best = max(best, nodes.leaves[leaf, SCORE, p])
        reach = max(reach, nodes.leaves[leaf, REACH, p])
    for p in range(LEAF_SIZE):
        index = min(index, nodes.leaves[leaf, INDEX, p] if nodes.leaves[leaf, SCORE, p] == best else np.inf)
    nodes.best[node], nodes.boxes[node, 6], nodes.holder[node] = best, reach, np.int64(index)
