"""The rounds in which outliers are taken away, in a cloud that is divided into parts.

In the first round all points are looked at, in each part by itself. After that, only points that have lost a neighbour,
and points one of whose neighbours has lost one: nothing has changed for the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.boxes import Each
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.near_points import has_within, medians, others_within
from gppcs.surface.outliers.definition import NEIGHBOURS, SURE, are_outside, mean_distances

BATCH = 1 << 14  # Points that are judged at once. Each has at least 16 neighbours, which have 16 each.
GONE = 1e150  # Coordinate of a point that was taken away: its squared distance is finite.
FARTHEST = 1e100  # Squared distances above this are those of such points.


class Content(NamedTuple):
    """The different places of a part.

    Attributes
    ----------
    tree : KdTree
        Its arrays may be changed.
    reach : (n,) array
        Squared distance of each point, in tree order, to its 16th nearest other in the whole cloud, or more.
    """

    tree: KdTree
    reach: NDArray[np.float64]

    def places(self, positions: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the places, (n, 3), at some positions in tree order."""
        return np.ascontiguousarray(self.tree.points[:, positions].T)


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a cloud.

    Attributes
    ----------
    load : callable() -> Content
    low, high : (3,) arrays
        Corners of a box around its points; infinite where it has none.
    count : int
        Number of its different places.
    gone : (k,) array, int64
        Positions in tree order of the points that were taken away.
    changed : (m,) array, int64
        Positions of the points whose `reach` has changed.
    reach : (m,) array
        What it is now.
    """

    load: Callable[[], Content]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    count: int
    gone: NDArray[np.int64]
    changed: NDArray[np.int64]
    reach: NDArray[np.float64]

    @classmethod
    def of(cls, load: Callable[[], Content], low: NDArray[np.float64], high: NDArray[np.float64], count: int) -> Part:
        """Return a part of which nothing was taken away."""
        none = np.empty(0, dtype=np.int64)
        return cls(load, low, high, count, none, none, np.empty(0))

    def open(self) -> Content:
        """Return what it holds now."""
        content = self.load()
        content.tree.points[:, self.gone] = GONE  # the boxes of the tree hold more than they need, which does no harm
        content.reach[self.changed] = self.reach
        return content

    def without(self, gone: NDArray[np.int64]) -> Part:
        """Return the part without some more points."""
        return replace(self, gone=np.concatenate([self.gone, gone]))

    def with_reach(self, positions: NDArray[np.int64], reach: NDArray[np.float64]) -> Part:
        """Return the part with other squared distances; of several of one point the last counts."""
        both = np.concatenate([self.changed, positions]), np.concatenate([self.reach, reach])
        last = len(both[0]) - 1 - np.unique(both[0][::-1], return_index=True)[1]
        return replace(self, changed=both[0][last], reach=both[1][last])


class Points(NamedTuple):
    """Some points.

    Attributes
    ----------
    parts, positions : (n,) arrays, int64
        Number of the part of each, and its position in tree order.
    places : (n, 3) array
    bounds : (n,) array
        The squared distance to the 16th nearest other is at most this.
    """

    parts: NDArray[np.int64]
    positions: NDArray[np.int64]
    places: NDArray[np.float64]
    bounds: NDArray[np.float64]

    def take(self, some: NDArray[np.int64] | NDArray[np.bool_]) -> Points:
        """Return some of them."""
        return Points(self.parts[some], self.positions[some], self.places[some], self.bounds[some])


NO_POINTS = Points(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3)), np.empty(0))


def joined(points: Sequence[Points]) -> Points:
    """Return the points of several sequences, in their order."""
    return Points(*map(np.concatenate, zip(*points, strict=True))) if points else NO_POINTS


def all_outliers(parts: Sequence[Part], found: Points, undecided: Points, each: Each) -> list[NDArray[np.int64]]:
    """Return the outliers of all rounds.

    Shapes: returns (k,).
    """
    parts, left = list(parts), sum(part.count for part in parts)
    while True:
        outside, reach = _judged(parts, undecided, each)
        found = joined([found, undecided.take(outside)])
        for number, own in _by_part(undecided.parts):
            parts[number] = parts[number].with_reach(undecided.positions[own], reach[own])
        for number, own in _by_part(found.parts):
            parts[number] = parts[number].without(found.positions[own])
        left -= len(found.places)
        if not len(found.places) or left <= NEIGHBOURS + 1:
            return [part.gone for part in parts]
        losing = joined(list(each(_Losing(found.places), [*enumerate(parts)])))
        beside = [(number, part, losing.positions[losing.parts == number]) for number, part in enumerate(parts)]
        undecided = joined([losing, *each(_Beside(losing.places), beside)])
        found = NO_POINTS


def _by_part(parts: NDArray[np.int64]) -> list[tuple[int, NDArray[np.int64]]]:
    """Return the indices of the points of each part that has any."""
    if not len(parts):
        return []
    order = np.argsort(parts, kind="stable")
    numbers, firsts = np.unique(parts[order], return_index=True)
    return list(zip(numbers.tolist(), np.split(order, firsts[1:]), strict=True))


@dataclass(frozen=True)
class _Losing:
    """Finds the points of a part one of whose neighbours was taken away from places, (n, 3)."""

    places: NDArray[np.float64]

    def __call__(self, asked: tuple[int, Part]) -> Points:
        number, part = asked
        content = part.open()
        positions = _near(content, self.places, part.gone)
        own = content.places(positions)
        bounds = np.full(len(positions), np.inf)
        if len(positions) and part.count > NEIGHBOURS:
            bounds = _squared(content.tree.nearest_of(own, NEIGHBOURS + 1)[1])[:, -1]
        return Points(np.full(len(positions), number), positions, own, bounds)


@dataclass(frozen=True)
class _Beside:
    """Finds the points of a part that have one of some places, (n, 3), as a neighbour, but for some of the part."""

    places: NDArray[np.float64]

    def __call__(self, asked: tuple[int, Part, NDArray[np.int64]]) -> Points:
        number, part, others = asked
        content = part.open()
        positions = _near(content, self.places, np.concatenate([part.gone, others]))
        own = content.places(positions)
        return Points(np.full(len(positions), number), positions, own, content.reach[positions])


def _near(content: Content, places: NDArray[np.float64], others: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return which points of a part reach one of some places, but for `others`."""
    if not len(places):
        return np.empty(0, dtype=np.int64)
    near = has_within(KdTree.build(places), np.ascontiguousarray(content.tree.points.T), content.reach)
    near[others] = False
    return np.flatnonzero(near)


def _squared(found: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the 16 smallest squared distances of each row to others, infinite where there are less."""
    return np.sort(np.where((found > 0.0) & (found < FARTHEST), found, np.inf), axis=1)[:, :NEIGHBOURS]


def _judged(parts: Sequence[Part], points: Points, each: Each) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Tell which points are outliers, and how far it is to the 16th nearest other of each, squared."""
    outside, reach = np.zeros(len(points.places), dtype=np.bool_), np.empty(len(points.places))
    for begin in range(0, len(outside), BATCH):
        some = slice(begin, begin + BATCH)
        outside[some], reach[some] = _judged_batch(parts, points.places[some], points.bounds[some], each)
    return outside, reach


def _judged_batch(
    parts: Sequence[Part], places: NDArray[np.float64], bounds: NDArray[np.float64], each: Each
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    squared = _nearest(parts, places, bounds, each)
    reach = squared[:, -1]
    starts, neighbours = _neighbours(parts, places, reach, each)
    different, first, back = _different(neighbours)
    owners = np.repeat(np.arange(len(places)), np.diff(starts))
    # All neighbours of a point and the point itself are at most twice its reach from each of them.
    squared_of_these = _nearest(parts, different, 4.0 * SURE * reach[owners[first]], each)
    around = medians(starts, mean_distances(squared_of_these)[back])
    return are_outside(places, mean_distances(squared), around, starts, neighbours), reach


def _different(
    places: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the different places, the index of one of each, and for each of all places which of these it is."""
    order = np.lexsort([*places.T])
    new = np.concatenate([[True], (np.diff(places[order], axis=0) != 0.0).any(axis=1)])[: len(order)]
    back = np.empty(len(places), dtype=np.int64)
    back[order] = np.cumsum(new) - 1
    return places[order[new]], order[new], back


def _asked(
    parts: Sequence[Part], places: NDArray[np.float64], bounds: NDArray[np.float64]
) -> tuple[list[tuple[Part, NDArray[np.float64], NDArray[np.float64]]], list[NDArray[np.int64]]]:
    """Return what to ask each part that is within the squared `bounds` of any of the places, and of which places."""
    asked, of = [], []
    for part in parts:
        away = np.maximum(np.maximum(part.low - places, places - part.high), 0.0) ** 2
        near = np.flatnonzero(away[:, 0] + away[:, 1] + away[:, 2] <= bounds)
        if len(near):
            asked.append((part, places[near], bounds[near]))
            of.append(near)
    return asked, of


def _nearest(
    parts: Sequence[Part], places: NDArray[np.float64], bounds: NDArray[np.float64], each: Each
) -> NDArray[np.float64]:
    """Return the squared distances of places to their 16 nearest others, (n, 16), ascending."""
    nearest = np.full((len(places), NEIGHBOURS), np.inf)
    asked, of = _asked(parts, places, bounds)
    for some, found in zip(of, each(_nearest_in_part, asked), strict=True):
        nearest[some] = np.sort(np.concatenate([nearest[some], found], axis=1), axis=1)[:, :NEIGHBOURS]
    return nearest


def _nearest_in_part(asked: tuple[Part, NDArray[np.float64], NDArray[np.float64]]) -> NDArray[np.float64]:
    part, places, _ = asked
    return _squared(part.open().tree.nearest_of(places, min(NEIGHBOURS + 1, part.count))[1])


def _neighbours(
    parts: Sequence[Part], places: NDArray[np.float64], reach: NDArray[np.float64], each: Each
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the others within the squared distances `reach` of places, and where those of each start."""
    asked, of = _asked(parts, places, reach)
    owners, found = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    for some, (counts, others) in zip(of, each(_neighbours_in_part, asked), strict=True):
        owners.append(np.repeat(some, counts))
        found.append(others)
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=len(places)))])
    return starts, np.concatenate(found)[order]


def _neighbours_in_part(
    asked: tuple[Part, NDArray[np.float64], NDArray[np.float64]],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    part, places, reach = asked
    content = part.open()
    starts, found = others_within(content.tree, places, reach)
    return np.diff(starts), content.places(found)


def repeating(points: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points lie at some places.

    Shapes: points (N, 3), places (n, 3); returns (N,).
    """
    if not len(places):
        return np.zeros(len(points), dtype=np.bool_)
    at_one: NDArray[np.bool_] = KdTree.build(places).nearest_of(points, 1)[1][:, 0] == 0.0
    return at_one
