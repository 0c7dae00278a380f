"""Farthest points box by box, apart from those of the boxes around: the isotropic form of AIVS (Lv et al. 2021)."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.farthest_points import approach, farthest_points

# how many boxes the longest axis has where there are fewer points than so many
BOXES_ALONG = ((10_000, 10), (50_000, 20), (100_000, 30), (500_000, 40), (1_000_000, 50))
ROUNDED_UP = 5  # a share is rounded up where its fraction is above a fifth
MARGIN = 0.75  # in edges: how far from a box's centre points of other boxes count, along each axis
LARGE = 1 << 20  # distances to compute in a box from which on a tree is worth its making
CLASSES = 8


@dataclass(frozen=True)
class Boxes:
    """The points sorted into the occupied boxes of a cubic grid; empty ones take no room.

    Attributes
    ----------
    order : (N,) array, int64
        The index that each point in this order had in the input: by box, in a box ascending.
    points : (3, N) array, float64
        Coordinates from the corner of the bounding box, in this order, an axis a row.
    cells : (boxes, 3) array, int64
        The number of each box along each axis; ascending.
    begins : (boxes + 1,) array, int64
        Where each box begins in this order.
    edge : float
        Of the boxes.
    along : int
        How many boxes the longest axis has.
    """

    order: NDArray[np.int64]
    points: NDArray[np.float64]
    cells: NDArray[np.int64]
    begins: NDArray[np.int64]
    edge: float
    along: int

    @classmethod
    def build(cls, points: NDArray[np.float64]) -> Boxes:
        """Sort `points`, (N, 3), not all at one place."""
        n = len(points)
        along = next((boxes for below, boxes in BOXES_ALONG if n < below), round(np.cbrt(n / 8)))
        local = points - points.min(axis=0)
        size = float(local.max())
        # multiplied first, so that borders fall alike in any unit
        cells = np.minimum((local * along / size).astype(np.int64), along - 1)
        keys = box_keys(cells, along)
        order = np.argsort(keys, kind="stable")
        begins = np.flatnonzero(np.diff(keys[order], prepend=-1, append=-1))
        return cls(order, local[order].T.copy(), cells[order[begins[:-1]]], begins, size / along, along)

    def quotas(self, n_points: int) -> NDArray[np.int64]:
        """Return how many points each box is to give: its share of M, up where the fraction is above a fifth."""
        whole, rest = np.divmod(np.diff(self.begins) * n_points, len(self.order))
        return whole + (ROUNDED_UP * rest > len(self.order))

    def parity(self) -> NDArray[np.int64]:
        """Return the class of each box, 0 to 7; no two boxes of a class touch."""
        return self.cells % 2 @ np.array([4, 2, 1])


def box_keys(cells: NDArray[np.int64], along: int) -> NDArray[np.int64]:
    """Return a number for each box, (boxes, 3), ascending with its cells; those next to the grid have one as well."""
    i, j, k = (cells + 1).T
    return (i * (along + 2) + j) * (along + 2) + k


def points_of_boxes(
    points: NDArray[np.float64], n_points: int, advanced: Callable[[int], None] | None = None
) -> NDArray[np.int64]:
    """Choose farthest points in each box of a grid, in number by its share of the points, and trim them to M.

    In a box, the first is the point nearest its centre, and each of the others is the farthest from those before it
    and from those that the boxes around had already, as far as these lie within 0.75 edges of the centre along each
    axis. The boxes come in eight classes, by whether their numbers along the axes are even; those of a class do not
    touch, and are filled at the same time. Where the quotas add up to more than M, see `trimmed`; where to less,
    the farthest points of the whole cloud are added.

    Parameters
    ----------
    points : (N, 3) array, float64
        Without repeats.
    n_points : int
        M, from 1 to N - 1.
    advanced : callable, optional
        Told of each class that is done, eight in all.

    Returns
    -------
    (M,) array, int64
        By class, in a class by box, in a box in the order chosen; then those added.
    """
    boxes = Boxes.build(points)
    quotas = boxes.quotas(n_points)
    chosen = _filled(boxes, quotas, advanced)
    box = np.repeat(np.arange(len(quotas)), quotas)
    rank = np.arange(len(box)) - np.repeat(np.cumsum(quotas) - quotas, quotas)
    kept = np.flatnonzero(rank < trimmed(quotas, n_points)[box])
    kept = kept[np.argsort(boxes.parity()[box[kept]], kind="stable")]
    indices = boxes.order[chosen[kept]]
    if len(indices) < n_points:
        rest = np.delete(np.arange(len(points)), indices)
        more, _ = farthest_points(points[rest], n_points - len(indices), others=points[indices])
        indices = np.concatenate([indices, rest[more]])
    return indices


def trimmed(counts: NDArray[np.int64], n_points: int) -> NDArray[np.int64]:
    """Return the points that boxes keep of `counts`, in sum at most `n_points`.

    Boxes take turns, first all even ones and then all odd ones, to give one point each if they have more than a
    threshold. It begins at a third of the range of the counts, and falls by one after a round in which no box gives.
    Here whole rounds are taken at once.
    """
    if counts.sum() <= n_points:
        return counts
    threshold = int(counts.max() - counts.min()) // 3
    if np.minimum(counts, threshold).sum() >= n_points:  # the threshold falls, and with it all that reach it
        threshold = _most_each(counts, n_points - 1)
        counts = np.minimum(counts, threshold + 1)
    else:
        above = np.maximum(counts - threshold, 0)
        counts = counts - np.minimum(above, _most_each(above, int(counts.sum()) - n_points))
    turns = np.flatnonzero(counts > threshold)
    turns = turns[np.argsort(turns % 2, kind="stable")]
    counts[turns[: counts.sum() - n_points]] -= 1
    return counts


def _most_each(counts: NDArray[np.int64], total: int) -> int:
    """Return the largest number that each may give, or all it has where that is less, for no more than the total."""
    most = int(counts.max())
    return bisect_right(range(most + 1), total, key=lambda each: int(np.minimum(counts, each).sum())) - 1


def _filled(boxes: Boxes, quotas: NDArray[np.int64], advanced: Callable[[int], None] | None) -> NDArray[np.int64]:
    """Return the positions of the points chosen in each box, as many as its quota, box after box."""
    keys = box_keys(boxes.cells, boxes.along)
    starts = np.append(0, np.cumsum(quotas))
    chosen = np.full(starts[-1], -1, dtype=np.int64)
    parity = boxes.parity()
    large = np.diff(boxes.begins) * quotas > LARGE
    for number in range(CLASSES):
        of_class = (parity == number) & (quotas > 0)
        _fill(
            boxes.points, boxes.begins, boxes.cells, keys, boxes.along, boxes.edge,
            np.flatnonzero(of_class & ~large), starts, chosen,
        )  # fmt: skip
        for box in np.flatnonzero(of_class & large):
            _fill_large(boxes, keys, int(box), starts, chosen)
        if advanced:
            advanced(1)
    return chosen


def _fill_large(
    boxes: Boxes, keys: NDArray[np.int64], box: int, starts: NDArray[np.int64], chosen: NDArray[np.int64]
) -> None:
    """Do for one box what `_fill` does, with a tree."""
    begin, end = boxes.begins[box], boxes.begins[box + 1]
    near = _chosen_near(boxes.points, boxes.cells, keys, boxes.along, boxes.edge, box, starts, chosen)
    first = _nearest_to_centre(boxes.points, begin, end, boxes.cells[box], boxes.edge)
    own = chosen[starts[box] : starts[box + 1]]
    members, others = boxes.points[:, begin:end].T, boxes.points[:, near].T
    own[:] = begin + farthest_points(members, len(own), first=first, others=others)[0]


@nb.njit(cache=True, parallel=True, nogil=True)
def _fill(points, begins, cells, keys, along, edge, some, starts, chosen):
    """Choose the points of some boxes that do not touch."""
    for s in nb.prange(len(some)):
        box = some[s]
        begin, end = begins[box], begins[box + 1]
        xs, ys, zs = points[0, begin:end], points[1, begin:end], points[2, begin:end]
        squared = np.full(end - begin, np.inf)
        for other in _chosen_near(points, cells, keys, along, edge, box, starts, chosen):
            approach(xs, ys, zs, squared, points[0, other], points[1, other], points[2, other])
        pick = _nearest_to_centre(points, begin, end, cells[box], edge)
        for slot in range(starts[box], starts[box + 1]):
            chosen[slot] = begin + pick
            approach(xs, ys, zs, squared, xs[pick], ys[pick], zs[pick])
            squared[pick] = -1.0
            pick = np.argmax(squared)


@nb.njit(cache=True)
def _nearest_to_centre(points, begin, end, cell, edge):
    """Return which of the points begin..end is nearest the centre of their box, the first of several."""
    best, nearest = 0, np.inf
    for i in range(begin, end):
        squared = 0.0
        for axis in range(3):
            squared += (points[axis, i] - (cell[axis] + 0.5) * edge) ** 2
        if squared < nearest:
            best, nearest = i - begin, squared
    return best


@nb.njit(cache=True)
def _chosen_near(points, cells, keys, along, edge, box, starts, chosen):
    """Return the positions of the points chosen in the boxes around that lie near enough to the centre of this one."""
    near = []
    for step in range(27):
        key = keys[box] + ((step // 9 - 1) * (along + 2) + step // 3 % 3 - 1) * (along + 2) + step % 3 - 1
        other = np.searchsorted(keys, key)
        if other == box or other == len(keys) or keys[other] != key:
            continue
        for i in chosen[starts[other] : starts[other + 1]]:
            apart = 0.0
            for axis in range(3):
                apart = max(apart, abs(points[axis, i] - (cells[box, axis] + 0.5) * edge))
            if i >= 0 and apart <= MARGIN * edge:
                near.append(i)
    return np.array(near, dtype=np.int64)
