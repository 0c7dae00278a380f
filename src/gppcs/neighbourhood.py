"""Who is near whom: the radius of a neighbourhood, the spacing of a cloud, and a grid for searches of one radius."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.kdtree import KdTree


def paper_radius(points: NDArray[np.float64], k: int = 25) -> float:
    """Return CloudCompare's radius for about k neighbours, the paper's choice (its section 3.1).

    r = sqrt(k V^(2/3) / N), with V the volume of the bounding box: the surface is taken to be as large as a side
    of the cube of that volume. A box of no volume gives zero.
    """
    volume = np.prod(np.ptp(points, axis=0))
    return float(np.sqrt(k * np.cbrt(volume) ** 2 / len(points)))


@dataclass(frozen=True)
class ColumnGrid:
    """Points sorted into columns of a square grid, and along each column.

    Two axes are cut into cells at least as wide as the radius; along the third, the longest of the box, the
    points of a column are sorted. The neighbours of a point then lie in nine runs, one in its own column and
    each of the eight around it, whose ends only move forward as one goes up the column.

    Attributes
    ----------
    radius : float
        The largest radius that a search may use.
    order : (N,) array, int64
        The index that each point in grid order had in the input.
    points : (3, N) array, float64
        Coordinates in grid order, an axis a row, the axis along the columns last.
    axes : (3,) array, int64
        The input's axis that each of those rows is.
    starts : (cells[0] * cells[1] + 1,) array, int64
        Where each column begins in grid order.
    cells : tuple of two int
        The number of columns along the first two rows.
    """

    radius: float
    order: NDArray[np.int64]
    points: NDArray[np.float64]
    axes: NDArray[np.int64]
    starts: NDArray[np.int64]
    cells: tuple[int, int]

    @classmethod
    def build(cls, points: NDArray[np.float64], radius: float) -> ColumnGrid:
        """Sort `points`, (N, 3), for searches of up to `radius`, in O(N log N) time and O(N) memory."""
        axes = np.argsort(np.ptp(points, axis=0), kind="stable")
        rows = np.ascontiguousarray(points.T[axes])
        (u, first), (v, second) = (_cells(row, radius, np.sqrt(len(points))) for row in rows[:2])
        order, starts = _count_sort(u * second + v, first * second)
        rows = np.take(rows, order, axis=1)
        _sort_columns(rows, order, starts)
        return cls(radius, order, rows, axes, starts, (first, second))


def _cells(row: NDArray[np.float64], width: float, most: float) -> tuple[NDArray[np.int64], int]:
    """Return the number of each coordinate's cell, and how many cells there are, about 4 `most` at most.

    Where the range holds more, numbers begin again at zero: points within a cell's width of each other have numbers
    that follow each other round, whatever far points stretch the range.
    """
    low, high = row.min(), row.max()
    if not width > 0.0:
        return np.zeros(len(row), dtype=np.int64), 1
    count = int(min((high - low) / width, 4 * most)) + 1
    return np.mod(np.floor((row - low) / width), count).astype(np.int64), count


@nb.njit(cache=True)
def _count_sort(column, columns):
    """Return the stable order by column, and where each column begins."""
    starts = np.zeros(columns + 1, dtype=np.int64)
    for c in column:
        starts[c + 1] += 1
    starts = np.cumsum(starts)
    free = starts[:-1].copy()
    order = np.empty(len(column), dtype=np.int64)
    for i in range(len(column)):
        order[free[column[i]]] = i
        free[column[i]] += 1
    return order, starts


@nb.njit(cache=True, parallel=True)
def _sort_columns(rows, order, starts):
    """Sort the points of each column along it."""
    for c in nb.prange(len(starts) - 1):
        if starts[c + 1] - starts[c] > 1:
            _sort_run(rows[:, starts[c] : starts[c + 1]], order[starts[c] : starts[c + 1]])


@nb.njit(cache=True)
def _sort_run(rows, order):
    ascending = np.argsort(rows[2], kind="mergesort")  # stable, so that repeats stay in input order
    for row in rows:
        row[:] = row[ascending]
    order[:] = order[ascending]


def nearest_distances(tree: KdTree, k: int, most: int = 4096) -> NDArray[np.float64]:
    """Return the distance of up to `most` points of the tree to their k-th nearest neighbour, in tree order.

    They are evenly spread over the order of the tree, so that each part of the cloud has its share of them; that of a
    file can have a rhythm, as where several scanners take turns. The point itself does not count; where fewer than k
    others exist, the farthest takes the k-th's place.
    """
    n = tree.points.shape[1]
    chosen = np.ascontiguousarray(tree.points.T[:: max(1, -(-n // most))])
    _, squared = tree.nearest_of(chosen, min(k + 1, n))
    return np.sqrt(squared[:, -1])


def spacing(tree: KdTree) -> float:
    """Return the median distance of a point to its nearest neighbour; there must be no repeats."""
    return float(np.median(nearest_distances(tree, 1)))


def surface_area(tree: KdTree, k: int = 8) -> float:
    """Return an estimate of the area of the surface that the points lie on, whatever their density.

    A disc around a point to its k-th neighbour holds k others, so the point stands for a k-th of it. The hundredth of
    the points with the largest discs stand for no more than the next, lest a few strays count as much as all others.
    There must be no repeats; a single point has no area.
    """
    n = tree.points.shape[1]
    k = min(k, n - 1)
    if k == 0:
        return 0.0
    squared = nearest_distances(tree, k, most=65_536) ** 2
    return float(np.pi / k * n * np.minimum(squared, np.quantile(squared, 0.99)).mean())


def neighbourhood_radius(points: NDArray[np.float64], tree: KdTree, k: int = 25) -> float:
    """Return the radius that holds about k points, the point itself counted: the paper's, where it can be used.

    The paper's rule sees only the bounding box. Where that is flat, or stretched by far points, it can be off
    without bound, so a radius more than three times the median distance to the k-th point, or less than a
    third of it, is replaced by that distance.
    """
    radius, robust = paper_radius(points, k), float(np.median(nearest_distances(tree, k - 1)))
    return radius if robust / 3 <= radius <= 3 * robust else robust


def first_occurrences(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell of each point, (N, 3), whether no earlier one has exactly its coordinates; O(N) by hashing."""
    room = 1 << max(4, int(2 * len(points)).bit_length())
    return _mark_first(points, np.full(room, -1, dtype=np.int32 if len(points) < 2**31 else np.int64))


@nb.njit(cache=True)
def _mark_first(points, table):
    mask = np.uint64(len(table) - 1)
    first = np.ones(len(points), dtype=np.bool_)
    for i in range(len(points)):
        slot = _mixed(points[i, 0], points[i, 1], points[i, 2]) & mask
        while table[slot] >= 0:
            other = points[table[slot]]
            if other[0] == points[i, 0] and other[1] == points[i, 1] and other[2] == points[i, 2]:
                first[i] = False
                break
            slot = (slot + np.uint64(1)) & mask
        if first[i]:
            table[slot] = i
    return first


def first_in_cells(points: NDArray[np.float64], edge: float, among: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return those of the indices `among` whose points, (N, 3), are the first in their cell of a grid of that edge.

    The grid begins at the origin. By hashing; memory grows with the number of cells that hold points, not with the
    grid's extent or the number of points.
    """
    return among[_first_in_cells(points, 1.0 / edge, among)]


@nb.njit(cache=True, nogil=True)
def _first_in_cells(points, scale, among):
    table = np.full(1 << 10, -1, dtype=np.int64)
    kept = np.empty(len(table) // 2, dtype=np.int64)
    cells = np.empty((len(kept), 3), dtype=np.float64)
    count = 0
    for c in range(len(among)):
        i = among[c]
        u, v, w = np.floor(points[i, 0] * scale), np.floor(points[i, 1] * scale), np.floor(points[i, 2] * scale)
        slot = _slot(table, cells, u, v, w)
        if table[slot] >= 0:
            continue
        if count == len(kept):
            table = np.full(2 * len(table), -1, dtype=np.int64)
            kept, cells = np.append(kept, kept), np.append(cells, cells, axis=0)
            for known in range(count):
                table[_slot(table, cells, cells[known, 0], cells[known, 1], cells[known, 2])] = known
            slot = _slot(table, cells, u, v, w)
        table[slot] = count
        kept[count] = c
        cells[count, 0], cells[count, 1], cells[count, 2] = u, v, w
        count += 1
    return kept[:count]


@nb.njit(cache=True)
def _slot(table, cells, u, v, w):
    """Return the slot of the table that holds a cell, or that it is to be put into."""
    mask = np.uint64(len(table) - 1)
    h = _mixed(u, v, w)
    while True:
        slot = h & mask
        known = table[slot]
        if known < 0 or (cells[known, 0] == u and cells[known, 1] == v and cells[known, 2] == w):
            return slot
        h += np.uint64(1)


@nb.njit(cache=True)
def _mixed(x, y, z):
    """Return a hash of three numbers; zero and minus zero are the same."""
    a, b, c = (
        np.float64(x + 0.0).view(np.uint64),
        np.float64(y + 0.0).view(np.uint64),
        np.float64(z + 0.0).view(np.uint64),
    )
    h = a * np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ (h >> np.uint64(29)) ^ b) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(32)) ^ c) * np.uint64(0x94D049BB133111EB)
    return h ^ (h >> np.uint64(31))
