"""Divides points among the levels and nodes of an octree: a ranking gives the levels, places give the nodes there.

So the points of the first levels, together, are the first of the ranking, whatever their number. Points that are not
ranked follow at random, as many on each level as its nodes have room for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.threads import on_ranges

MOST = 100_000  # Points of a node. Viewers load whole nodes.
ROOT = 1 << 16  # Points of the first level. With fewer, the nodes below would hold less than some 10,000.
GROWTH = 2  # Binary digits of the number of points from level to level: on a surface, the spacing halves.
DEEPEST = 20  # Level whose cells three numbers of 21 bits can name.
FINE = 8  # Cells at least that a full node is divided into, for counting.
SLACK = 4.0  # Standard deviations by which a node, of points taken at random, may be larger than expected.
NEVER = 255  # Stands for the level of a cell that takes no more than its share of points on any level.
_SPREAD = (  # Shifts and masks that put two zeros between the bits of a number.
    (32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F), (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)  # fmt: skip


class Cube(NamedTuple):
    """The cell of the first level: the corner (3,) and the length of its edges; and the highest corner to state (3,).

    Some last places may lie between that and the points: copclib takes the cube from the stated corners, and adds up
    the borders of its cells, which would sometimes fall short of the highest point.
    """

    low: NDArray[np.float64]
    side: float
    high: NDArray[np.float64]

    @classmethod
    def around(cls, low: NDArray[np.float64], high: NDArray[np.float64]) -> Cube:
        """Return the cube that begins at the lowest corner of the points, where copclib takes it to be."""
        stated, longest, cells = high.copy(), int((high - low).argmax()), 2.0 ** np.arange(DEEPEST + 1)[:, np.newaxis]
        last_place = np.spacing(np.abs([low[longest], high[longest]]).max())
        while (side := float((stated - low).max())) > 0.0:
            step = side / cells
            if (step * (cells - 1) + low + step >= high).all():
                break
            stated[longest] += last_place
        return cls(low, side or 1.0, stated)

    def codes(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the cell of each point on the deepest level; three bits less name that on the level above."""
        codes = np.zeros(len(points), np.int64)
        on_ranges(self._set_codes, len(points), points, codes, least=1 << 12)
        return codes

    def _set_codes(self, begin: int, end: int, points: NDArray[np.float64], codes: NDArray[np.int64]) -> None:
        step = self.side / 2**DEEPEST
        for axis in range(3):
            values, low = points[begin:end, axis], self.low[axis]
            cells = np.floor((values - low) / step)
            cells -= values < low + step * cells  # Readers round borders so: no point may lie beyond, by its last bit.
            cells += values >= low + step * (cells + 1)
            whole = np.clip(cells, 0, 2**DEEPEST - 1).astype(np.int64)
            for shift, mask in _SPREAD:
                whole = (whole | whole << shift) & mask
            codes[begin:end] |= whole << axis


class Cells(NamedTuple):
    """Cells of one level, in the order of their codes (c,); points in none of them count to the cell before."""

    level: int
    codes: NDArray[np.int64]

    @classmethod
    def around(cls, ranked: NDArray[np.int64], n: int) -> Cells:
        """Return cells around ranked points, given by codes (k,), each with a small part of the n points of a cloud."""
        for level in range(DEEPEST + 1):
            found, counts = np.unique(ranked >> 3 * (DEEPEST - level), return_counts=True)
            if FINE * counts.max() * n <= MOST * len(ranked):
                break
        return cls(level, found)

    def places(self, codes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return which of the cells each point is in, (n,)."""
        found = np.searchsorted(self.codes, codes >> 3 * (DEEPEST - self.level), side="right")
        return np.maximum(found - 1, 0)

    def nodes(self, level: int) -> NDArray[np.int64]:
        """Return the number of the node of a level that each cell lies in, (c,)."""
        codes = self.codes >> 3 * max(self.level - level, 0)
        return np.cumsum(np.diff(codes, prepend=codes[:1]) != 0)


class Levels(NamedTuple):
    """How points are divided among levels."""

    cells: Cells
    of_ranked: NDArray[np.uint8]  # (k,), the level of each point that is ranked
    ends: list[float]  # The share of the other points that is on each level and those above
    closing: NDArray[np.uint8]  # (c,), the level of each cell that takes all points that are left in it

    def of_others(self, places: NDArray[np.int64], seed: int) -> NDArray[np.uint8]:
        """Return the levels of points that are not ranked, by their cells (n,)."""
        level = np.searchsorted(self.ends, np.random.default_rng(seed).random(len(places)), side="right")
        return np.minimum(level, self.closing[places]).astype(np.uint8)


def levels_of(codes: NDArray[np.int64], ranking: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Return the levels of points, given the codes of all (n,) and the rows of those that are ranked, in order (k,)."""
    if not len(codes):
        return np.empty(0, np.uint8)
    ranked = codes[ranking]
    cells = Cells.around(ranked, len(codes))
    places = cells.places(codes)
    others = np.bincount(places, minlength=len(cells.codes))
    others -= np.bincount(places[ranking], minlength=len(others))
    levels = divided(cells, places[ranking], others)
    found = levels.of_others(places, 0)
    found[ranking] = levels.of_ranked
    return found


def divided(cells: Cells, ranked: NDArray[np.int64], others: NDArray[np.int64]) -> Levels:
    """Divide ranked points, by their cells in their order (k,), and the others, by their number in each cell (c,).

    A level takes the next points of the ranking, as many as wanted or as its nodes hold. Behind the ranking, it takes
    others, and a node in which no more points are left than it holds takes them all.
    """
    most = int(MOST - SLACK * np.sqrt(MOST) * others.any())
    levels = Levels(cells, np.zeros(len(ranked), np.uint8), [], np.full(len(others), NEVER, np.uint8))
    left, still, done, share = np.arange(len(ranked)), others.astype(np.float64), 0.0, 0.0
    for level in range(DEEPEST + 1):
        nodes = cells.nodes(level)
        of_others = np.bincount(nodes, still)
        here = nodes[ranked[left]]
        counts = np.bincount(here, minlength=len(of_others)) + of_others
        if counts.max() <= most or level == DEEPEST:
            break
        wanted = int((ROOT << GROWTH * level) - done)
        first = here[:wanted]
        filled = np.bincount(first, minlength=len(of_others))
        taken = min((int(np.flatnonzero(first == node)[most]) for node in np.flatnonzero(filled > most)),
                    default=len(first))  # fmt: skip
        part = 0.0
        if taken == len(left):
            room = (most - filled)[of_others > 0] / of_others[of_others > 0]
            part = min((wanted - taken) / of_others.sum(), room.min())
        closed = (counts <= most) & (ROOT << GROWTH * level > len(ranked))
        now = (np.arange(len(left)) < taken) | closed[here]
        levels.of_ranked[left[now]] = level
        levels.closing[closed[nodes] & (levels.closing == NEVER)] = level
        remaining = np.where(closed[nodes], 0.0, still * (1 - part))
        done += np.count_nonzero(now) + still.sum() - remaining.sum()
        left, still, share = left[~now], remaining, share + part * (1 - share)
        levels.ends.append(share)
    levels.of_ranked[left] = level
    levels.ends.append(1.0)
    return levels


def by_node(
    codes: NDArray[np.int64], level: NDArray[np.uint8]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Sort points by nodes: return the keys of the nodes (m,), the rows of the points (n,), and each node's first (m,).

    A key is a bit that tells the level, and behind it the code of the cell. Three bits less name the node above.
    """
    bits = 3 * level.astype(np.int64)
    keys = np.left_shift(1, bits) | codes >> 3 * DEEPEST - bits
    order = np.argsort(level, kind="stable")  # quick, and leaves neighbours together, which makes the next sort quick
    order = order[np.argsort(keys[order], kind="stable")]
    keys = keys[order]
    starts = np.flatnonzero(np.diff(keys, prepend=0))
    return keys[starts], order, starts


def level_and_cell(key: int) -> tuple[int, tuple[int, ...]]:
    """Return the level of a node, and the place of its cell along each axis."""
    level = (key.bit_length() - 1) // 3
    return level, tuple(sum((key >> 3 * bit + axis & 1) << bit for bit in range(level)) for axis in range(3))
