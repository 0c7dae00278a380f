"""The state of a greedy choice: the scores in the nodes of the tree, and what a newly chosen point changes.

Each new point changes few posteriors: a posterior changes only if the new point is among the nearest on which the point
is conditioned. A node is skipped only if this holds for none of its points. Where parts choose down to a threshold,
scores far below it wait until a lower threshold: a variance hardly ever rises.
"""

from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.gp.local.kernel import LANES, field_distance
from gppcs.gp.local.posterior import Conditioning, Work, compute_posteriors, work_for
from gppcs.spatial.kdtree import LEAF_SIZE, after, first_leaf, leaf_range

TAKEN = -1.0  # Score and squared range of a chosen point: below those of all others.
UNSCORED = -2.0  # Score of a point that a new point has changed, until it is computed.


class GreedyState(NamedTuple):
    """The state of a choice among n points, in tree order."""

    conditioning: Conditioning
    variances: Floats  # (n,), posterior variance; of a chosen point, that before its choice
    scores: Floats  # (n,)
    ranges: Floats  # (n,), squared distance in the field to the last of the points that it is conditioned on
    # (n,), whether the score is that before the last points came, as it is too low to matter yet.
    outdated: Flags
    # (nodes, 8), one line of memory each: lower and upper corner, largest squared range, largest squared spacing.
    boxes: Floats
    best: Floats  # (nodes,), the largest score in the node
    holder: Ints  # (nodes,), the point with this score, of several the first


class Workspace(NamedTuple):
    """Memory for what one new point changes."""

    visited: Ints  # (nodes,), nodes that the new point may change
    changed: Ints  # (n,), points whose posteriors it changes
    gaps: Floats  # (LEAF_SIZE,), squared distances in the field between the new point and the points of a leaf
    work: Work


@kernel(inline="always")
def workspace_below(field, state, count):
    """Return memory for the points below one of `count` nodes of a depth."""
    return Workspace(
        np.empty(len(state.best) // count, dtype=np.int64),
        np.empty(len(state.scores) // count + 1, dtype=np.int64),
        np.empty(LEAF_SIZE, dtype=np.float64),
        work_for(state.conditioning.nearest.shape[1], len(field.detail)),
    )


def computed_from(threshold: float, error_weight: float) -> float:
    """Return from which score on scores are kept up to date while points are chosen down to a threshold.

    A variance hardly ever rises, so a score far below the threshold will not reach it. An error may rise.
    """
    return 0.9 * threshold if error_weight == 0.0 else 0.0


@kernel(fastmath=False, allocates=False)
def condition_on(new, root, computed, field, state, workspace, count):
    """Condition the points below a node on a new one; return the numbers of visited nodes and of changed points.

    A point whose score is below `computed` is not changed but outdated.
    """
    boxes, ranges, last = state.boxes, state.ranges, state.conditioning.nearest.shape[1] - 1
    n, leaves = len(ranges), first_leaf(boxes)
    x, y, z = field.positions[0, new], field.positions[1, new], field.positions[2, new]
    u, v, w = field.normals[0, new], field.normals[1, new], field.normals[2, new]
    spacing = field.spacings[new]
    node, seen = root, 0
    while node:
        if node != root and not is_in_range(boxes, node, x, y, z, spacing, boxes[node, 6]):
            node = after(node, root)
            continue
        workspace.visited[seen] = node
        seen += 1
        if node < leaves:
            node *= 2
            continue
        begin, end = leaf_range(n, leaves, node)
        for i in range(begin, end):
            cosine = field.normals[0, i] * u + field.normals[1, i] * v + field.normals[2, i] * w
            workspace.gaps[i - begin] = field_distance(
                field.positions[0, i] - x, field.positions[1, i] - y, field.positions[2, i] - z, cosine,
                field.spacings[i], spacing, field.normal_weight,
            )  # fmt: skip
        for c in range(len(field.detail)):  # Eq. (18), in loops that vectorise
            for i in range(begin, end):
                workspace.gaps[i - begin] += (field.detail[c, i] - field.detail[c, new]) ** 2
        for i in range(begin, end):
            if workspace.gaps[i - begin] < ranges[i]:
                _keep_nearest(state.conditioning, i, new, workspace.gaps[i - begin])
                ranges[i] = state.conditioning.squared[i, last]
                if state.scores[i] >= computed:
                    state.outdated[i], state.scores[i] = False, UNSCORED
                    workspace.changed[count] = i
                    count += 1
                elif state.scores[i] != UNSCORED:
                    state.outdated[i] = True
        node = after(node, root)
    return seen, count


@kernel(fastmath=False, allocates=False)
def is_in_range(boxes, node, x, y, z, spacing, squared):
    """Return whether a point may be within a squared distance in the field of one in the node; boxes (nodes, 8)."""
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz <= squared * (0.5 * (boxes[node, 7] + spacing**2))


@kernel(inline="always")
def _keep_nearest(conditioning, i, new, gap):
    """Insert a chosen point among those that point i is conditioned on, and drop the last."""
    slot = conditioning.nearest.shape[1] - 1
    while slot > 0 and conditioning.squared[i, slot - 1] > gap:
        conditioning.squared[i, slot] = conditioning.squared[i, slot - 1]
        conditioning.nearest[i, slot] = conditioning.nearest[i, slot - 1]
        slot -= 1
    conditioning.squared[i, slot], conditioning.nearest[i, slot] = gap, new


@kernel(allocates=False)
def rescore(count, field, error_weight, state, workspace):
    """Compute the posteriors of the first `count` points in `changed` of `workspace`."""
    for begin in range(0, count, LANES):
        end = min(begin + LANES, count)
        compute_posteriors(
            field, state.conditioning.nearest, workspace.changed, begin, end, error_weight, workspace.work
        )
        for p in range(end - begin):
            i = workspace.changed[begin + p]
            state.variances[i], state.scores[i] = workspace.work.variance[p], workspace.work.score[p]


@kernel(allocates=False)
def set_score(state, root, i, score):
    """Set the score of a point, and update the nodes from its leaf up to the node `root`."""
    leaves = first_leaf(state.best)
    state.scores[i] = score
    node = leaves + ((i + 1) * leaves - 1) // len(state.scores)
    renew_leaf(node, state)
    while node > root:
        node //= 2
        renew_inner(node, state)


@kernel(inline="always")
def renew(node, state):
    """Update score, holder and range of a node, from its children or from its points."""
    if node < first_leaf(state.best):
        renew_inner(node, state)
    else:
        renew_leaf(node, state)


@kernel(fastmath=False, allocates=False)
def renew_inner(node, state):
    """Update score, holder and range of a node from its children."""
    best, holder, a, b = state.best, state.holder, 2 * node, 2 * node + 1
    if best[b] > best[a]:
        best[node], holder[node] = best[b], holder[b]
    else:
        best[node], holder[node] = best[a], holder[a]
    state.boxes[node, 6] = max(state.boxes[a, 6], state.boxes[b, 6])


@kernel(fastmath={"nnan", "nsz"}, allocates=False)
def renew_leaf(node, state):
    """Update score, holder and range of a leaf's node from its points."""
    begin, end = leaf_range(len(state.scores), first_leaf(state.best), node)
    best, squared, holder = TAKEN, TAKEN, begin
    for i in range(begin, end):
        best = max(best, state.scores[i])
        squared = max(squared, state.ranges[i])
    while state.scores[holder] < best:
        holder += 1
    state.best[node], state.boxes[node, 6], state.holder[node] = best, squared, holder
