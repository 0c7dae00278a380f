"""Greedy choice in a local field (Eq. (9); paper, Algorithm 1), with updates of few posteriors for each chosen point.

In a large cloud, parts choose at once: the subtrees below one depth of the k-d tree. A part chooses its best point,
again and again, as long as no better point outside can be affected by it or affect it. Parts work in rounds. In a
round, a part sees the others as they were at its start; between rounds, parts exchange what they chose near their
boundaries. What is deferred after some rounds is chosen one after another. The parts depend on the points only, so the
result does not depend on the number of threads.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.greedy_state import (
    TAKEN,
    UNSCORED,
    GreedyState,
    computed_from,
    condition_on,
    is_in_range,
    renew,
    renew_inner,
    renew_leaf,
    rescore,
    set_score,
    workspace_below,
)
from gppcs.gp.local.kernel import LocalField, field_distance
from gppcs.gp.local.posterior import condition, posterior_of_all
from gppcs.spatial.box_distances import squared_distance_of_boxes
from gppcs.spatial.kdtree import KdTree, after, first_leaf, leaf_range

PART_POINTS = 4096  # Points of a part at least: with fewer, most of them are near others.


class Parts(NamedTuple):
    """The parts, what each has chosen, and the state of the others as far as it sees it."""

    starts: Ints  # (parts + 1,), where the neighbours of each part start
    neighbours: Ints  # (sum,), the parts that a point of the part may affect, or be affected by
    positions: Ints  # (n,), what each part has chosen, in its order, from the first of its points on
    scores: Floats  # (n,), of these, when they were chosen
    counts: Ints  # (parts,), number of points that each part has chosen
    sent: Ints  # (parts,), how many of these its neighbours know of
    best: Floats  # (nodes,), largest score of each node at the start of the round
    ranges: Floats  # (nodes,), its largest squared range then
    seen: Floats  # (n,), scores of the points at the start of the round


def extend(
    field: LocalField,
    tree: KdTree,
    chosen: Ints,
    n_added: int,
    neighbours: int,
    error_weight: float,
    settled: Ints | None = None,
    on_progress: Callable[[int], None] = lambda steps: None,
) -> tuple[Ints, Floats, Floats]:
    """Choose the point with the largest score (Eq. (9)), again and again: `n_added` points.

    Where parts choose at once, the order is that of falling scores, and the result is not exactly that of one choice
    after another: a new point may raise a score, since posteriors are conditioned only on the nearest points. Shapes:
    chosen (m,), in any order, settled (k,), which are never chosen; returns added, scores, deviations (n_added,).
    """
    state = _begin_state(field, tree, chosen, settled, neighbours, error_weight)
    cloud, count = _divide(state, 1), 1
    while 2 * count <= min(tree.leaves, len(field.y) // PART_POINTS, len(chosen) // neighbours):
        count *= 2
    if count > 1:
        parts = _divide(state, count)
        added, scores = _choose_in_levels(n_added, len(chosen), field, error_weight, state, parts, cloud, on_progress)
    else:
        step, computed = 4096, computed_from(0.0, error_weight)  # from one report of progress to the next
        for begin in range(0, n_added, step):
            choose_in_parts(0, 1, 0.0, computed, min(begin + step, n_added), field, error_weight, state, cloud)
            on_progress(min(step, n_added - begin))
        added, scores = _chosen_by(cloud)
    return added, scores, np.sqrt(state.variances[added])


def _begin_state(
    field: LocalField, tree: KdTree, chosen: Ints, settled: Ints | None, neighbours: int, error_weight: float
) -> GreedyState:
    """Return the state in which some points are chosen. Shapes: chosen (m,)."""
    conditioning = condition(field, tree, chosen, neighbours)
    _, variances, scores = posterior_of_all(field, conditioning, error_weight)
    count = len(tree.lower)
    state = GreedyState(
        conditioning, variances, scores, conditioning.squared[:, -1].copy(),
        np.zeros(len(scores), dtype=bool), np.concatenate([tree.lower, tree.upper, np.empty((count, 2))], axis=1),
        np.empty(count), np.empty(count, dtype=np.int64),
    )  # fmt: skip
    for taken in (chosen,) if settled is None else (chosen, settled):
        state.scores[taken] = state.ranges[taken] = TAKEN
    on_ranges(_begin_leaves, tree.leaves, field.spacings, state, minimum=256)
    _renew_upper(state, tree.leaves)
    return state


@kernel(allocates=False)
def _begin_leaves(begin, end, spacings, state):
    """Fill the nodes of a range of leaves, by the desired spacings, (n,)."""
    leaves = first_leaf(state.best)
    for leaf in range(leaves + begin, leaves + end):
        widest = 0.0
        for i in range(*leaf_range(len(spacings), leaves, leaf)):
            widest = max(widest, spacings[i])
        state.boxes[leaf, 7] = widest**2
        renew_leaf(leaf, state)


@kernel(allocates=False)
def _renew_upper(state, count):
    """Update the nodes above a depth of `count` nodes from the nodes of that depth."""
    for node in range(count - 1, 0, -1):
        state.boxes[node, 7] = max(state.boxes[2 * node, 7], state.boxes[2 * node + 1, 7])
        renew_inner(node, state)


def _choose_in_levels(
    n_added: int,
    n_chosen: int,
    field: LocalField,
    error_weight: float,
    state: GreedyState,
    parts: Parts,
    rest: Parts,
    on_progress: Callable[[int], None],
) -> tuple[Ints, Floats]:
    """Choose the `n_added` best points, by ever lower thresholds, after others; parts as in `choose_down`."""
    threshold, taken = np.inf, 0
    while taken < n_added and threshold > 0.0:
        # Scores fall about as the spacing of the chosen points, or faster. A little too low, so that 1 % more are
        # chosen than are needed.
        step = math.sqrt((n_chosen + taken) / (1.01 * (n_chosen + n_added)))
        threshold = min(threshold, float(state.best[1])) * step
        threshold = threshold if threshold > 1e-6 else 0.0
        choose_down(threshold, field, error_weight, state, parts, rest)
        before, taken = taken, min(int(parts.counts.sum() + rest.counts.sum()), n_added)
        on_progress(taken - before)
    added, scores = (np.concatenate(both) for both in zip(_chosen_by(parts), _chosen_by(rest), strict=True))
    best = np.argsort(-scores, kind="stable")[:n_added]
    return added[best], scores[best]


def _divide(state: GreedyState, count: int) -> Parts:
    """Return parts that have chosen nothing."""
    n, nodes = len(state.scores), len(state.best)
    near = np.zeros((count, count), dtype=np.bool_)
    if count > 1:
        _find_neighbours(state.boxes, near)
    starts = np.zeros(count + 1, dtype=np.int64)
    np.cumsum(near.sum(axis=1), out=starts[1:])
    return Parts(
        starts, np.ascontiguousarray(np.nonzero(near)[1]), np.empty(n, dtype=np.int64), np.empty(n),
        np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64), np.empty(nodes), np.empty(nodes), np.empty(n),
    )  # fmt: skip


@kernel(allocates=False)
def _find_neighbours(boxes, near):
    """Mark the pairs of parts, (parts, parts), one of which may be in the range of the other; boxes (nodes, 8)."""
    count = len(near)
    for a in range(count):
        for b in range(count):
            one, other = boxes[count + a], boxes[count + b]
            squared = squared_distance_of_boxes(one[:3], one[3:6], other[:3], other[3:6])
            near[a, b] = a != b and squared <= max(one[6], other[6]) * 0.5 * (one[7] + other[7])


def _chosen_by(parts: Parts) -> tuple[Ints, Floats]:
    """Return what the parts have chosen, part by part. Shapes: returns positions, scores (m,)."""
    n, count = len(parts.positions), len(parts.counts)
    slots = np.concatenate([np.arange(parts.counts[part]) + n * part // count for part in range(count)])
    return parts.positions[slots], parts.scores[slots]


def choose_down(
    threshold: float, field: LocalField, error_weight: float, state: GreedyState, parts: Parts, rest: Parts
) -> None:
    """Choose all points with a score of at least a threshold."""
    n, count, computed = len(state.scores), len(parts.counts), computed_from(threshold, error_weight)
    chosen = count
    while chosen >= count:  # with fewer, a round costs more than to choose one after another
        _exchange_boundaries(computed, field, error_weight, state, parts)
        on_ranges(choose_in_parts, count, threshold, computed, n, field, error_weight, state, parts)
        chosen = int((parts.counts - parts.sent).sum())
    _exchange_boundaries(computed, field, error_weight, state, parts)
    _renew_upper(state, count)
    choose_in_parts(0, 1, threshold, computed, n, field, error_weight, state, rest)


def _exchange_boundaries(
    computed: float, field: LocalField, error_weight: float, state: GreedyState, parts: Parts
) -> None:
    """Condition all parts on what their neighbours have chosen since the last exchange."""
    on_ranges(_receive, len(parts.counts), computed, field, error_weight, state, parts)
    parts.sent[:] = parts.counts


@kernel
def _receive(begin, end, computed, field, error_weight, state, parts):
    """Condition the points of some parts on what their neighbours have chosen; note their own scores."""
    workspace = workspace_below(field, state, len(parts.counts))
    for part in range(begin, end):
        _receive_in_part(part, computed, field, error_weight, state, parts, workspace)


@kernel(allocates=False)
def _receive_in_part(part, computed, field, error_weight, state, parts, workspace):
    """Condition the points of a part on what its neighbours have chosen; note their scores."""
    n, count = len(state.scores), len(parts.counts)
    root, changed = count + part, 0
    for other in parts.neighbours[parts.starts[part] : parts.starts[part + 1]]:
        first = n * other // count
        for slot in range(first + parts.sent[other], first + parts.counts[other]):
            new = parts.positions[slot]
            x, y, z = field.positions[0, new], field.positions[1, new], field.positions[2, new]
            if is_in_range(state.boxes, root, x, y, z, field.spacings[new], state.boxes[root, 6]):
                _, changed = condition_on(new, root, computed, field, state, workspace, changed)
    for i in range(n * part // count, n * (part + 1) // count):
        if state.outdated[i] and state.scores[i] >= computed:
            state.outdated[i], state.scores[i], workspace.changed[changed] = False, UNSCORED, i
            changed += 1
    rescore(changed, field, error_weight, state, workspace)
    for i in range(n * part // count, n * (part + 1) // count):
        parts.seen[i] = state.scores[i]
    width = first_leaf(state.best) // count
    while width:  # children before their parents
        for node in range(root * width, (root + 1) * width):
            if changed:
                renew(node, state)
            parts.best[node], parts.ranges[node] = state.best[node], state.boxes[node, 6]
        width //= 2


@kernel
def choose_in_parts(begin, end, threshold, computed, maximum, field, error_weight, state, parts):
    """Let some parts choose their points down to a threshold. A single part chooses one after another."""
    count = len(parts.counts)
    workspace = workspace_below(field, state, count)
    deferred = np.empty(len(workspace.changed), dtype=np.int64)
    scores = np.empty(len(deferred), dtype=np.float64)
    for part in range(begin, end):
        _choose_in_part(
            part, threshold, computed, maximum, field, error_weight, state, parts, workspace, deferred, scores
        )


@kernel(allocates=False)
def _choose_in_part(part, threshold, computed, maximum, field, error_weight, state, parts, workspace, deferred, scores):
    """Let a part choose; `deferred` and `scores`, with an entry for each of its points, are scratch memory."""
    root, waiting = len(parts.counts) + part, 0
    while state.best[root] >= threshold and state.best[root] > TAKEN and parts.counts[part] < maximum:
        new = state.holder[root]
        if _is_deferred(new, part, deferred[:waiting], field, state, parts):
            deferred[waiting], scores[waiting] = new, state.scores[new]
            waiting += 1
            set_score(state, root, new, TAKEN)
        else:
            slot = len(state.scores) * part // len(parts.counts) + parts.counts[part]
            parts.positions[slot], parts.scores[slot] = new, state.scores[new]
            parts.counts[part] += 1
            state.scores[new] = state.ranges[new] = TAKEN
            nodes, changed = condition_on(new, root, computed, field, state, workspace, 0)
            rescore(changed, field, error_weight, state, workspace)
            for v in range(nodes - 1, -1, -1):  # children before their parents
                renew(workspace.visited[v], state)
    for which in range(waiting):
        set_score(state, root, deferred[which], scores[which])


@kernel(inline="always")
def _is_deferred(new, part, deferred, field, state, parts):
    """Return whether a better point, outside or deferred itself, may affect a point of a part or be affected by it."""
    for other in deferred:
        if _gap(field, new, other) < max(state.ranges[new], state.ranges[other]):
            return True
    for other in parts.neighbours[parts.starts[part] : parts.starts[part + 1]]:
        if _affected(new, len(parts.counts) + other, field, state, parts):
            return True
    return False


@kernel(inline="always")
def _affected(new, root, field, state, parts):
    """Return whether a better point below the node `root` may affect a point or be affected by it."""
    n, leaves = len(state.scores), first_leaf(state.best)
    score = state.scores[new]
    x, y, z, spacing = field.positions[0, new], field.positions[1, new], field.positions[2, new], field.spacings[new]
    node = root
    while node:
        squared = max(state.ranges[new], parts.ranges[node])
        if parts.best[node] < score or not is_in_range(state.boxes, node, x, y, z, spacing, squared):
            node = after(node, root)
            continue
        if node < leaves:
            node *= 2
            continue
        for other in range(*leaf_range(n, leaves, node)):
            better = parts.seen[other] > score or (parts.seen[other] == score and other < new)
            if better and _gap(field, new, other) < squared:
                return True
        node = after(node, root)
    return False


@kernel(inline="always")
def _gap(field, i, j):
    """Return the squared distance in the field between two points."""
    positions, normals = field.positions, field.normals
    of_detail = 0.0
    for c in range(len(field.detail)):  # Eq. (18)
        of_detail += (field.detail[c, i] - field.detail[c, j]) ** 2
    return of_detail + field_distance(
        positions[0, i] - positions[0, j], positions[1, i] - positions[1, j], positions[2, i] - positions[2, j],
        normals[0, i] * normals[0, j] + normals[1, i] * normals[1, j] + normals[2, i] * normals[2, j],
        field.spacings[i], field.spacings[j], field.normal_weight,
    )  # fmt: skip
