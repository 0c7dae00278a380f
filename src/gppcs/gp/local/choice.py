"""The state of a choice: the scores in the nodes of the tree, and what a newly chosen point changes.

The choice is exact although each new point changes few posteriors. A posterior changes only if the new point is among
the nearest on which the point is conditioned, and a node is skipped only if this holds for none of its points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.conditioning import Conditioning
from gppcs.gp.local.kernel import LANES, LocalField, field_distance
from gppcs.gp.local.posterior import Work, posteriors, workspace
from gppcs.spatial.kdtree import LEAF_SIZE, KdTree, greater_child, leaf_range

LEAVES_AT_ONCE = 32  # Leaves that a thread takes at once, at least.
TAKEN = -1.0  # Score and reach of a chosen point: below those of all others.
SPACING, SCORE, REACH, INDEX, ROWS = 6, 7, 8, 9, 10  # Rows of a leaf. The first six are position and normal.


class Choice(NamedTuple):
    """The state of a choice among n points.

    The *reach* of a point is the squared distance in the field to the last of the chosen points that it is conditioned
    on. Only a nearer new point changes its posterior.

    Attributes
    ----------
    sites : (n, 9) array
        As returned by `sites_of`.
    conditioning : Conditioning
    variances : (n,) array
        Posterior variances.
    position : (n,) array, int64
        Position in tree order of each point of the tree's input.
    boxes : (nodes, 8) array
        Low and high corner of each node's box, largest reach of its points, square of their largest desired spacing.
        These eight numbers fill one line of memory.
    best : (nodes,) array
        The largest score in the node.
    holder : (nodes,) array, int64
        Index in the tree's input of the point with this score; of several the smallest.
    leaves : (leaves, ROWS, LEAF_SIZE) array
        The points of each leaf, in columns: position, normal, desired spacing, score, reach and index. Columns that are
        left over count as taken.
    """

    sites: NDArray[np.float64]
    conditioning: Conditioning
    variances: NDArray[np.float64]
    position: NDArray[np.int64]
    boxes: NDArray[np.float64]
    best: NDArray[np.float64]
    holder: NDArray[np.int64]
    leaves: NDArray[np.float64]


def begin_choice(
    field: LocalField,
    tree: KdTree,
    sites: NDArray[np.float64],
    conditioning: Conditioning,
    variances: NDArray[np.float64],
    scores: NDArray[np.float64],
) -> Choice:
    """Return the state in which points with score `TAKEN` are chosen.

    Parameters
    ----------
    field : LocalField
        In the tree's order.
    tree : KdTree
        Over the field's positions.
    sites : (n, 9) array
        As returned by `sites_of`.
    conditioning : Conditioning
    variances, scores : (n,) arrays

    Returns
    -------
    Choice
    """
    count = len(tree.low)
    choice = Choice(
        sites, conditioning, variances, tree.positions(),
        np.concatenate([tree.low, tree.high, np.empty((count, 2))], axis=1),
        np.empty(count), np.empty(count, dtype=np.int64), np.empty((count // 2, ROWS, LEAF_SIZE)),
    )  # fmt: skip
    reach = np.where(scores == TAKEN, TAKEN, conditioning.squared[:, -1])
    on_ranges(_fill_leaves, tree.leaves, field, tree.order, scores, reach, choice, least=LEAVES_AT_ONCE)
    renew_upper(choice, tree.leaves)
    return choice


@kernel
def _fill_leaves(begin, end, field, order, scores, reach, choice):
    """Fill a range of leaves and their nodes, given order, scores and reaches of the points, (n,) each."""
    leaves = len(choice.leaves)
    for leaf in range(begin, end):
        rows = choice.leaves[leaf]
        rows[:] = 0.0
        rows[SPACING], rows[SCORE], rows[REACH], rows[INDEX] = 1.0, TAKEN, TAKEN, len(order)
        widest = 0.0
        first, last = leaf_range(len(order), leaves, leaves + leaf)
        for i in range(first, last):
            p = i - first
            for axis in range(3):
                rows[axis, p], rows[3 + axis, p] = field.positions[axis, i], field.normals[axis, i]
            rows[SPACING, p], rows[SCORE, p] = field.spacings[i], scores[i]
            rows[REACH, p], rows[INDEX, p] = reach[i], order[i]
            widest = max(widest, field.spacings[i])
        choice.boxes[leaves + leaf, 7] = widest**2
        _renew_leaf(leaves + leaf, choice)


@kernel
def renew_upper(choice, count):
    """Update the nodes above a level of `count` nodes from the nodes of that level."""
    for node in range(count - 1, 0, -1):
        choice.boxes[node, 7] = max(choice.boxes[2 * node, 7], choice.boxes[2 * node + 1, 7])
        _renew_inner(node, choice)


class Room(NamedTuple):
    """Memory for what one new point changes.

    Attributes
    ----------
    visited : (nodes,) array, int64
        Nodes that the new point may change.
    changed : (n,) array, int64
        Points whose posteriors it changes.
    gaps : (LEAF_SIZE,) array
        Squared distances in the field between the new point and the points of a leaf.
    work : Work
    """

    visited: NDArray[np.int64]
    changed: NDArray[np.int64]
    gaps: NDArray[np.float64]
    work: Work


@kernel
def room_below(choice, count):
    """Return room for the points below one of `count` nodes of a level."""
    return Room(
        np.empty(len(choice.best) // count, dtype=np.int64),
        np.empty(len(choice.sites) // count + 1, dtype=np.int64),
        np.empty(LEAF_SIZE, dtype=np.float64),
        workspace(choice.conditioning.nearest.shape[1]),
    )


@kernel
def leaf_and_column(choice, i):
    """Return the leaf that holds a point, from 0, and its column there."""
    n, leaves = len(choice.sites), len(choice.leaves)
    leaf = ((i + 1) * leaves - 1) // n
    return leaf, i - n * leaf // leaves


@kernel(fastmath=False)
def observe(new, root, field, error_weight, choice, room):
    """Condition the points below the node `root` on a new chosen point, and update their scores and nodes."""
    nodes, points = _tell(new, root, field.normal_weight, choice, room)
    for begin in range(0, points, LANES):
        end = min(begin + LANES, points)
        posteriors(field, choice.sites, choice.conditioning.nearest, room.changed, begin, end, error_weight, room.work)
        for p in range(end - begin):
            i = room.changed[begin + p]
            leaf, column = leaf_and_column(choice, i)
            choice.variances[i], choice.leaves[leaf, SCORE, column] = room.work.variance[p], room.work.score[p]
    for v in range(nodes - 1, -1, -1):  # children before their parents
        if room.visited[v] < len(choice.leaves):
            _renew_inner(room.visited[v], choice)
        else:
            _renew_leaf(room.visited[v], choice)


@kernel(fastmath=False)
def _tell(new, root, normal_weight, choice, room):
    """Condition the points around a new point on it.

    Fill `visited` and `changed` of the room, and return how many entries of each are valid.
    """
    boxes, rows, sites = choice.boxes, choice.leaves, choice.sites
    n, leaves = len(sites), len(rows)
    x, y, z, u, v, w = sites[new, 0], sites[new, 1], sites[new, 2], sites[new, 3], sites[new, 4], sites[new, 5]
    spacing = sites[new, SPACING]
    stack = np.empty(64, dtype=np.int64)
    stack[0] = root
    height, seen, count = 1, 0, 0
    while height:
        height -= 1
        node = stack[height]
        room.visited[seen] = node
        seen += 1
        if node < leaves:
            for child in (2 * node, 2 * node + 1):
                if within_reach(boxes, child, x, y, z, spacing, boxes[child, 6]):
                    stack[height] = child
                    height += 1
            continue
        leaf = node - leaves
        begin, last = n * leaf // leaves, choice.conditioning.nearest.shape[1] - 1
        for p in range(LEAF_SIZE):
            cosine = rows[leaf, 3, p] * u + rows[leaf, 4, p] * v + rows[leaf, 5, p] * w
            room.gaps[p] = field_distance(
                rows[leaf, 0, p] - x, rows[leaf, 1, p] - y, rows[leaf, 2, p] - z, cosine, rows[leaf, SPACING, p],
                spacing, normal_weight,
            )  # fmt: skip
        for p in range(LEAF_SIZE):
            if room.gaps[p] < rows[leaf, REACH, p]:
                _keep_nearest(choice.conditioning, begin + p, new, room.gaps[p])
                rows[leaf, REACH, p] = choice.conditioning.squared[begin + p, last]
                room.changed[count] = begin + p
                count += 1
    return seen, count


@kernel(fastmath=False)
def within_reach(boxes, node, x, y, z, spacing, reach):
    """Return whether a point may be within a reach of a point of the node; `boxes` is (nodes, 8)."""
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz <= reach * (0.5 * (boxes[node, 7] + spacing**2))


@kernel(fastmath=False)
def _keep_nearest(conditioning, i, new, gap):
    """Insert a chosen point among those that point i is conditioned on, and drop the last."""
    slot = conditioning.nearest.shape[1] - 1
    while slot > 0 and conditioning.squared[i, slot - 1] > gap:
        conditioning.squared[i, slot] = conditioning.squared[i, slot - 1]
        conditioning.nearest[i, slot] = conditioning.nearest[i, slot - 1]
        slot -= 1
    conditioning.squared[i, slot], conditioning.nearest[i, slot] = gap, new


@kernel
def set_score(choice, root, i, score):
    """Set the score of a point, and update the nodes from its leaf up to the node `root`."""
    leaf, column = leaf_and_column(choice, i)
    choice.leaves[leaf, SCORE, column] = score
    node = len(choice.leaves) + leaf
    _renew_leaf(node, choice)
    while node > root:
        node //= 2
        _renew_inner(node, choice)


@kernel(fastmath=False)
def _renew_inner(node, choice):
    """Update score, holder and reach of a node from its children."""
    greater_child(node, choice.best, choice.holder)
    choice.boxes[node, 6] = max(choice.boxes[2 * node, 6], choice.boxes[2 * node + 1, 6])


@kernel(fastmath={"nnan", "nsz"})
def _renew_leaf(node, choice):
    """Update score, holder and reach of a leaf's node from its points."""
    rows = choice.leaves[node - len(choice.leaves)]
    best, reach, index = TAKEN, TAKEN, np.inf
    for p in range(LEAF_SIZE):
        best = max(best, rows[SCORE, p])
        reach = max(reach, rows[REACH, p])
    for p in range(LEAF_SIZE):
        index = min(index, rows[INDEX, p] if rows[SCORE, p] == best else np.inf)
    choice.best[node], choice.boxes[node, 6], choice.holder[node] = best, reach, np.int64(index)
