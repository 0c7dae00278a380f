"""How near points are: the radius of a neighbourhood, the spacing and the area of a cloud, and its cells."""

from __future__ import annotations

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
