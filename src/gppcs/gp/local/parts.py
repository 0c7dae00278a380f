"""Parts of a cloud that choose at once: the subtrees below one level of the k-d tree.

A part chooses its best point, again and again, as long as no better point outside can be affected by it or affect it.
So all parts together choose what one after another would, wherever scores do not rise. Parts work in rounds. In a
round, a part sees the others as they were at its start; between rounds, parts tell their neighbours what they chose.
What is left in doubt after some rounds is chosen one after another.

The parts depend on the points only, so the result does not depend on the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.choice import (
    TAKEN,
    Choice,
    observe,
    renew,
    renew_upper,
    room_below,
    score_changed,
    set_score,
    tell,
    within_reach,
)
from gppcs.gp.local.kernel import LocalField, field_distance
from gppcs.spatial.kdtree import first_leaf, leaf_range, squared_distance_of_boxes

POINTS = 4096  # Points of a part at least: with fewer, most of them are near others.
CHOSEN_PER_NEIGHBOUR = 16  # Chosen points of a part at least, for each point that a posterior is conditioned on.


class Parts(NamedTuple):
    """The parts, and what each has chosen and knows of the others.

    Attributes
    ----------
    starts : (parts + 1,) array, int64
        Where the neighbours of each part start.
    neighbours : (sum,) array, int64
        The parts that a point of the part may affect, or be affected by, without gaps.
    positions : (n,) array, int64
        What each part has chosen, in its order, from the first of its points on.
    scores : (n,) array
        Of these, when they were chosen.
    counts : (parts,) array, int64
        Number of points that each part has chosen.
    told : (parts,) array, int64
        How many of these its neighbours know of.
    best, reach : (nodes,) arrays
        Largest score and reach of each node at the start of the round.
    seen : (n,) array
        Scores of the points at the start of the round.
    """

    starts: NDArray[np.int64]
    neighbours: NDArray[np.int64]
    positions: NDArray[np.int64]
    scores: NDArray[np.float64]
    counts: NDArray[np.int64]
    told: NDArray[np.int64]
    best: NDArray[np.float64]
    reach: NDArray[np.float64]
    seen: NDArray[np.float64]


def number_of_parts(n: int, chosen: int, leaves: int, neighbours: int) -> int:
    """Return the number of parts, a power of two."""
    parts = 1
    while 2 * parts <= leaves and n >= 2 * parts * POINTS and chosen >= 2 * parts * CHOSEN_PER_NEIGHBOUR * neighbours:
        parts *= 2
    return parts


def divide(choice: Choice, count: int) -> Parts:
    """Return parts that have chosen nothing."""
    n, nodes = len(choice.scores), len(choice.best)
    near = np.zeros((count, count), dtype=np.bool_)
    _find_neighbours(choice.boxes, near)
    starts = np.concatenate([[0], np.cumsum(near.sum(axis=1))])
    return Parts(
        starts, np.ascontiguousarray(np.nonzero(near)[1]), np.empty(n, dtype=np.int64), np.empty(n),
        np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64), np.empty(nodes), np.empty(nodes), np.empty(n),
    )  # fmt: skip


@kernel(allocates=False)
def _find_neighbours(boxes, near):
    """Mark the pairs of parts, (parts, parts), one of which may be within the reach of the other; boxes (nodes, 8)."""
    count = len(near)
    for a in range(count):
        for b in range(count):
            one, other = boxes[count + a], boxes[count + b]
            squared = squared_distance_of_boxes(one[:3], one[3:6], other[:3], other[3:6])
            near[a, b] = a != b and squared <= max(one[6], other[6]) * 0.5 * (one[7] + other[7])


def chosen_by(parts: Parts) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return what the parts have chosen, part by part.

    Shapes: returns positions, scores (m,).
    """
    n, count = len(parts.positions), len(parts.counts)
    slots = np.concatenate([n * part // count + np.arange(chosen) for part, chosen in enumerate(parts.counts)])
    return parts.positions[slots], parts.scores[slots]


def choose_all_above(
    level: float, field: LocalField, error_weight: float, choice: Choice, parts: Parts, rest: Parts
) -> None:
    """Choose all points with a score of at least `level`."""
    n, count = len(choice.scores), len(parts.counts)
    chosen = count
    while chosen >= count:  # with fewer, a round costs more than to choose one after another
        _exchange(field, error_weight, choice, parts)
        on_ranges(choose, count, level, n, field, error_weight, choice, parts)
        chosen = int((parts.counts - parts.told).sum())
    _exchange(field, error_weight, choice, parts)
    renew_upper(choice, count)
    choose(0, 1, level, n, field, error_weight, choice, rest)


def _exchange(field: LocalField, error_weight: float, choice: Choice, parts: Parts) -> None:
    """Let all parts hear what their neighbours have chosen since the last time."""
    on_ranges(_hear, len(parts.counts), field, error_weight, choice, parts)
    parts.told[:] = parts.counts


@kernel
def _hear(begin, end, field, error_weight, choice, parts):
    """Condition the points of some parts on what their neighbours have chosen; note their own scores."""
    room = room_below(choice, len(parts.counts))
    for part in range(begin, end):
        _hear_in_part(part, field, error_weight, choice, parts, room)


@kernel(allocates=False)
def _hear_in_part(part, field, error_weight, choice, parts, room):
    """Condition the points of a part on what its neighbours have chosen; note their scores."""
    n, count = len(choice.scores), len(parts.counts)
    root, changed = count + part, 0
    for other in parts.neighbours[parts.starts[part] : parts.starts[part + 1]]:
        first = n * other // count
        for slot in range(first + parts.told[other], first + parts.counts[other]):
            new = parts.positions[slot]
            x, y, z = field.positions[0, new], field.positions[1, new], field.positions[2, new]
            if within_reach(choice.boxes, root, x, y, z, field.spacings[new], choice.boxes[root, 6]):
                _, changed = tell(new, root, field, choice, room, changed)
    score_changed(changed, field, error_weight, choice, room)
    for i in range(n * part // count, n * (part + 1) // count):
        parts.seen[i] = choice.scores[i]
    width = first_leaf(choice.best) // count
    while width:  # children before their parents
        for node in range(root * width, (root + 1) * width):
            if changed:
                renew(node, choice)
            parts.best[node], parts.reach[node] = choice.best[node], choice.boxes[node, 6]
        width //= 2


@kernel
def choose(begin, end, level, most, field, error_weight, choice, parts):
    """Let some parts choose their points with a score of at least `level`. A single part chooses one after another."""
    count = len(parts.counts)
    room = room_below(choice, count)
    doubtful = np.empty(len(room.changed), dtype=np.int64)
    scores = np.empty(len(doubtful), dtype=np.float64)
    for part in range(begin, end):
        _choose_in_part(part, level, most, field, error_weight, choice, parts, room, doubtful, scores)


@kernel(allocates=False)
def _choose_in_part(part, level, most, field, error_weight, choice, parts, room, doubtful, scores):
    """Let a part choose; `doubtful` and `scores`, with an entry for each of its points, are room."""
    root, doubts = len(parts.counts) + part, 0
    while choice.best[root] >= level and choice.best[root] > TAKEN and parts.counts[part] < most:
        new = choice.holder[root]
        if _in_doubt(new, part, doubtful[:doubts], field, choice, parts, room.stack):
            doubtful[doubts], scores[doubts] = new, choice.scores[new]
            doubts += 1
            set_score(choice, root, new, TAKEN)
        else:
            _take(new, part, choice, parts)
            observe(new, root, field, error_weight, choice, room)
    for doubt in range(doubts):
        set_score(choice, root, doubtful[doubt], scores[doubt])


@kernel(allocates=False)
def _take(new, part, choice, parts):
    """Choose a point for a part."""
    slot = len(choice.scores) * part // len(parts.counts) + parts.counts[part]
    parts.positions[slot], parts.scores[slot] = new, choice.scores[new]
    parts.counts[part] += 1
    choice.scores[new] = choice.reach[new] = TAKEN


@kernel(allocates=False)
def _in_doubt(new, part, doubtful, field, choice, parts, stack):
    """Return whether a better point, outside or in doubt itself, may affect a point of a part or be affected by it."""
    for other in doubtful:
        if _gap(field, new, other) < max(choice.reach[new], choice.reach[other]):
            return True
    for other in parts.neighbours[parts.starts[part] : parts.starts[part + 1]]:
        if _affected(new, len(parts.counts) + other, field, choice, parts, stack):
            return True
    return False


@kernel(allocates=False)
def _affected(new, root, field, choice, parts, stack):
    """Return whether a better point below the node `root` may affect a point or be affected by it."""
    n, leaves = len(choice.scores), first_leaf(choice.best)
    score, reach, index = choice.scores[new], choice.reach[new], choice.order[new]
    x, y, z, spacing = field.positions[0, new], field.positions[1, new], field.positions[2, new], field.spacings[new]
    stack[0] = root
    height = 1
    while height:
        height -= 1
        node = stack[height]
        farther = max(reach, parts.reach[node])
        if parts.best[node] < score or not within_reach(choice.boxes, node, x, y, z, spacing, farther):
            continue
        if node < leaves:
            stack[height], stack[height + 1] = 2 * node, 2 * node + 1
            height += 2
            continue
        for other in range(*leaf_range(n, leaves, node)):
            better = parts.seen[other] > score or (parts.seen[other] == score and choice.order[other] < index)
            if better and _gap(field, new, other) < farther:
                return True
    return False


@kernel(fastmath=False, allocates=False)
def _gap(field, i, j):
    """Return the squared distance in the field between two points."""
    places, normals = field.positions, field.normals
    return field_distance(
        places[0, i] - places[0, j], places[1, i] - places[1, j], places[2, i] - places[2, j],
        normals[0, i] * normals[0, j] + normals[1, i] * normals[1, j] + normals[2, i] * normals[2, j],
        field.spacings[i], field.spacings[j], field.normal_weight,
    )  # fmt: skip
