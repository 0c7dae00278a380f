"""One point of each cell of a grid, and the first at each place: one pass over all points, by hashing."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.scaling import bounds

EXACT = 53  # bits of a whole number that a float can hold
PART = 1 << 14  # points whose hashes are looked up at a time: few enough for their table to stay in the cache
FEW = 1 << 10  # slots of a table at first
EMPTY = np.uint64(2**64 - 1)  # no hash with an index: no cloud has an index of ones alone
NO_GRID = np.zeros(6)
NO_VALUES = np.empty(0, dtype=np.float32)


def first_occurrences(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell of each point, (N, 3), whether no earlier one has exactly its coordinates; O(N) by hashing."""
    marks = np.ones(len(points), dtype=np.bool_)
    if len(points):
        _mark(np.ascontiguousarray(points), NO_GRID, NO_VALUES, marks)
    return marks


def greatest_in_cells(points: NDArray[np.float64], edge: float, values: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the ascending indices of the points, (N, 3), of the greatest value in their cell of a grid of that edge.

    Of several the first counts. The grid begins at the origin. By hashing, in O(N); memory, 9 bytes a point and 8 a
    cell that holds points, does not grow with the grid's extent.
    """
    marks = np.zeros(len(points), dtype=np.bool_)
    if len(points):
        points = np.ascontiguousarray(points)
        _mark(points, _grid(points, 1.0 / edge), values, marks)
    return np.flatnonzero(marks)


def _spare_bits(n: int) -> int:
    """Return how many bits of 64 an index of n points leaves."""
    return 64 - n.bit_length()


def _grid(points: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """Return what the number of a point's cell is computed by.

    One over the edge; the least number of a cell along each axis; and how many cells there are along the second and
    the third, or zeros where the bits of a hash that are looked at cannot number all.
    """
    low, high = (np.floor(bound * scale) for bound in bounds(points))
    counts = np.minimum(high - low + 1.0, 2.0**64)  # lest their product overflow
    numbered = np.prod(counts) <= 2.0 ** min(_spare_bits(len(points)), EXACT)
    return np.array([scale, *low, *(counts[1:] if numbered else (0.0, 0.0))])


def _mark(
    points: NDArray[np.float64], grid: NDArray[np.float64], values: NDArray[np.float32], marks: NDArray[np.bool_]
) -> None:
    """Mark one of each kind, that of the greatest value; without values, unmark all but the first.

    Hashes, their last bits replaced by the point's index, are sorted by their first bits into parts, of which each
    fits a small table; within a part, points stay in their order.
    """
    n = len(points)
    bits = (n // PART).bit_length()
    chunks = 4 * nb.get_num_threads() if bits else 1
    entries = np.empty(n, dtype=np.uint64)
    starts = _sort_by_hash(points, grid, _spare_bits(n), bits, chunks, entries)
    _mark_parts(points, grid, values, _spare_bits(n), entries, starts, chunks, marks)


@nb.njit(cache=True, parallel=True, nogil=True)
def _sort_by_hash(points, grid, spare, bits, chunks, entries):
    """Fill `entries` by parts, each in input order, and return where the parts begin."""
    n, parts = len(points), 1 << bits
    places = np.zeros((chunks, parts), dtype=np.int64)
    for c in nb.prange(chunks):
        _count_hashes(points, n * c // chunks, n * (c + 1) // chunks, grid, spare, bits, places[c])
    starts = np.zeros(parts + 1, dtype=np.int64)
    for part in range(parts):
        starts[part + 1] = starts[part]
        for c in range(chunks):
            starts[part + 1], places[c, part] = starts[part + 1] + places[c, part], starts[part + 1]
    for c in nb.prange(chunks):
        _place_hashes(points, n * c // chunks, n * (c + 1) // chunks, grid, spare, bits, places[c], entries)
    return starts


@nb.njit(cache=True)
def _count_hashes(points, begin, end, grid, spare, bits, counts):
    for i in range(begin, end):
        counts[_part(_hash(points, i, grid, spare), bits)] += 1


@nb.njit(cache=True)
def _place_hashes(points, begin, end, grid, spare, bits, places, entries):
    indices = np.uint64((1 << (64 - spare)) - 1)
    for i in range(begin, end):
        h = _hash(points, i, grid, spare)
        part = _part(h, bits)
        entries[places[part]] = (h & ~indices) | np.uint64(i)
        places[part] += 1


@nb.njit(cache=True, inline="always")
def _part(h, bits):
    """Return the number that the first bits of a hash are."""
    return (h >> np.uint64(1)) >> np.uint64(63 - bits)


@nb.njit(cache=True, parallel=True, nogil=True)
def _mark_parts(points, grid, values, spare, entries, starts, chunks, marks):
    parts = len(starts) - 1
    for c in nb.prange(chunks):
        table = np.empty(FEW, dtype=np.uint64)
        for part in range(parts * c // chunks, parts * (c + 1) // chunks):
            table = _mark_part(points, grid, values, spare, entries[starts[part] : starts[part + 1]], table, marks)


@nb.njit(cache=True, nogil=True)
def _mark_part(points, grid, values, spare, entries, table, marks):
    """Mark or unmark points of a part; return the table, which had to grow if more than half of it were taken."""
    indices, shift = np.uint64((1 << (64 - spare)) - 1), np.uint64(64 - spare)
    numbered = grid[4] > 0.0
    table[:] = EMPTY
    count = 0
    for entry in entries:
        slot = (entry >> shift) & np.uint64(len(table) - 1)
        other = table[slot]
        while other != EMPTY:
            if (other ^ entry) <= indices and (numbered or _same(points, other & indices, entry & indices, grid)):
                break
            slot = (slot + np.uint64(1)) & np.uint64(len(table) - 1)
            other = table[slot]
        if other == EMPTY:
            table[slot] = entry
            count += 1
            if 2 * count > len(table):
                table = _grown(table, shift)
        elif not len(values):
            marks[entry & indices] = False
        elif values[entry & indices] > values[other & indices]:
            table[slot] = entry
    if len(values):
        for entry in table:
            if entry != EMPTY:
                marks[entry & indices] = True
    return table


@nb.njit(cache=True, nogil=True)
def _grown(table, shift):
    """Return a table twice as large with the same entries."""
    larger = np.full(2 * len(table), EMPTY)
    mask = np.uint64(len(larger) - 1)
    for entry in table:
        if entry != EMPTY:
            slot = (entry >> shift) & mask
            while larger[slot] != EMPTY:
                slot = (slot + np.uint64(1)) & mask
            larger[slot] = entry
    return larger


@nb.njit(cache=True, inline="always")
def _same(points, i, j, grid):
    """Tell whether two points are in the same cell, or have the same coordinates."""
    for axis in range(3):
        a, b = points[i, axis], points[j, axis]
        if grid[0] > 0.0:
            a, b = np.floor(a * grid[0]), np.floor(b * grid[0])
        if a != b:
            return False
    return True


@nb.njit(cache=True, inline="always")
def _hash(points, i, grid, spare):
    """Return a hash of 64 bits, of which the first `spare` are told apart."""
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    if grid[0] > 0.0:
        x, y, z = np.floor(x * grid[0]), np.floor(y * grid[0]), np.floor(z * grid[0])
    if grid[4] == 0.0:
        return _mixed(x, y, z)
    number = ((x - grid[1]) * grid[4] + (y - grid[2])) * grid[5] + (z - grid[3])
    return _scrambled(np.uint64(number), np.uint64(spare)) << np.uint64(64 - spare)


@nb.njit(cache=True)
def _scrambled(number, bits):
    """Return another number of so many bits for each number of so many bits."""
    mask, half = (np.uint64(1) << bits) - np.uint64(1), bits >> np.uint64(1)
    h = (number * np.uint64(0x9E3779B97F4A7C15)) & mask
    h = ((h ^ (h >> half)) * np.uint64(0xBF58476D1CE4E5B9)) & mask
    return h ^ (h >> half)


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
    h ^= c ^ ((h ^ c) >> np.uint64(32))  # what whole numbers differ in lies in their first bits
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0x94D049BB133111EB)
    h = (h ^ (h >> np.uint64(29))) * np.uint64(0x9E3779B97F4A7C15)
    return h ^ (h >> np.uint64(32))
