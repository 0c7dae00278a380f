"""Choose one point per grid cell, or the first point at each position, in O(N) by hashing."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import RANGES, on_ranges
from gppcs.spatial.samples import hash_of_place
from gppcs.spatial.scaling import bounds

POINTS_PER_PART = 1 << 14  # hashes are looked up in parts of this size, so that a part's table stays in the CPU cache
EMPTY = np.uint64(2**64 - 1)  # an empty slot; entries end in a point's index, which is never all ones


class Numbering(NamedTuple):
    """The cells of a box, which are numbered row by row."""

    lowest: tuple[float, float, float]
    along: tuple[float, float]  # cells along y and z; 0 if they are too many to have numbers


class Grid(NamedTuple):
    """What tells places apart: the cells of a cubic grid, or positions."""

    scale: float  # one over the edge of a cell; 0 if positions count
    numbering: Numbering


UNNUMBERED = Numbering((0.0, 0.0, 0.0), (0.0, 0.0))
POSITIONS = Grid(0.0, UNNUMBERED)


def first_occurrences(points: Floats) -> Flags:
    """Mark the points that do not repeat an earlier point, in O(N) by hashing. Shapes: points (N, 3); returns (N,)."""
    marks = np.ones(len(points), dtype=np.bool_)
    if len(points):
        _mark(np.ascontiguousarray(points), POSITIONS, np.empty(0, dtype=np.uint32), marks)
    return marks


def distinct_in_single(points: Floats) -> Ints:
    """Choose the first point, (N, 3), at each position that float32 tells apart in a cloud of that extent.

    Two grids, half a cell apart, leave hardly any points that differ by less, such as by rounding.
    """
    sample = points[:: max(1, len(points) // 10_000)]
    extent = np.ptp(np.quantile(sample, (0.01, 0.99), axis=0), axis=0).max()  # without strays, such as at the origin
    if not extent:
        return np.flatnonzero(first_occurrences(points))
    scale = 2.0**24 / extent
    distinct = np.flatnonzero(first_occurrences(np.rint(points * scale)))
    return distinct[first_occurrences(np.floor(points[distinct] * scale))]


def greatest_in_cells(points: Floats, edge: float, values: NDArray[np.uint32]) -> Ints:
    """Choose the point of greatest value, (N,), in each cell of a cubic grid by hashing; ties go by coordinates."""
    marks = np.zeros(len(points), dtype=np.bool_)
    if len(points):
        points, scale = np.ascontiguousarray(points), 1.0 / edge
        lower, upper = np.floor(np.multiply(bounds(points), scale)).tolist()
        x, y, z = (min(last - first + 1.0, 2.0**64) for first, last in zip(lower, upper, strict=True))  # no overflow
        numbered = x * y * z <= 2.0 ** min(64 - len(points).bit_length(), 53)  # a float64 holds 53 bits exactly
        numbering = Numbering(tuple(lower), (y, z)) if numbered else UNNUMBERED
        _mark(points, Grid(scale, numbering), np.ascontiguousarray(values), marks)
    return np.flatnonzero(marks)


def _mark(points: Floats, grid: Grid, values: NDArray[np.uint32], marks: Flags) -> None:
    """Fill `marks`, (N,): the greatest of each cell becomes true or, without values, all but the first false."""
    # Entries are hashes whose last bits are the point's index. They are sorted by their first bits into parts, each
    # small enough for a small hash table.
    n = len(points)
    bits, spare = (n // POINTS_PER_PART).bit_length(), 64 - n.bit_length()  # beside the index of a point
    chunks = min(RANGES, n // POINTS_PER_PART + 1)
    slots = np.zeros((chunks, 1 << bits), dtype=np.int64)  # where each chunk writes its first entry of each part
    starts = np.array([0, n])
    if bits:
        counts = slots.copy()
        on_ranges(_count_hashes, chunks, points, grid, spare, bits, counts)
        starts = np.concatenate([[0], np.cumsum(counts.sum(axis=0))])
        slots += starts[:-1] + np.cumsum(counts, axis=0) - counts
    entries = np.empty(n, dtype=np.uint64)
    on_ranges(_write_hashes, chunks, points, grid, spare, bits, slots, entries)
    on_ranges(_mark_parts, 1 << bits, points, grid, values, spare, entries, starts, marks)


@kernel
def _count_hashes(begin, end, points, grid, spare, bits, counts):
    """Count the points of each part in some chunks: fill `counts`, (chunks, 2^bits); `points` is (N, 3)."""
    n, chunks = len(points), len(counts)
    for c in range(begin, end):
        for i in range(n * c // chunks, n * (c + 1) // chunks):
            counts[c, _part(_hash(points, i, grid, spare), bits)] += 1


@kernel
def _write_hashes(begin, end, points, grid, spare, bits, slots, entries):
    """Write the entries of some chunks into `entries`, (N,), from `slots`, (chunks, 2^bits), on."""
    n, chunks = len(points), len(slots)
    indices = np.uint64((1 << (64 - spare)) - 1)
    for c in range(begin, end):
        for i in range(n * c // chunks, n * (c + 1) // chunks):
            h = _hash(points, i, grid, spare)
            part = _part(h, bits)
            entries[slots[c, part]] = (h & ~indices) | np.uint64(i)
            slots[c, part] += 1


@kernel(inline="always")
def _part(h, bits):
    """Return the first `bits` bits of a hash as a number."""
    return (h >> np.uint64(1)) >> np.uint64(63 - bits)


@kernel
def _mark_parts(begin, end, points, grid, values, spare, entries, starts, marks):
    """Fill `marks`, (N,), for some parts; `values` is (N,) or empty, `entries` (N,), `starts` (parts + 1,)."""
    table = np.empty(1 << 10, dtype=np.uint64)  # which doubles when it is half full
    for part in range(begin, end):
        table = _mark_part(points, grid, values, spare, entries[starts[part] : starts[part + 1]], table, marks)


@kernel(inline="always")
def _mark_part(points, grid, values, spare, entries, table, marks):
    """Fill `marks`, (N,), for the entries of one part; return the table, which grows when it is half full."""
    indices, shift = np.uint64((1 << (64 - spare)) - 1), np.uint64(64 - spare)
    numbered = grid.numbering.along[0] > 0.0
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
        elif _is_greater(points, values, entry & indices, other & indices):
            table[slot] = entry
    if len(values):
        for entry in table:
            if entry != EMPTY:
                marks[entry & indices] = True
    return table


@kernel(inline="always")
def _is_greater(points, values, i, j):
    """Return whether the value of one of the points, (N, 3), is greater, or the same and the point comes before."""
    if values[i] != values[j]:
        return values[i] > values[j]
    for axis in range(3):
        if points[i, axis] != points[j, axis]:
            return points[i, axis] < points[j, axis]
    return False


@kernel(inline="always")
def _grown(table, shift):
    """Return a table, (2 slots,), with the same entries as `table`, (slots,)."""
    larger = np.empty(2 * len(table), dtype=np.uint64)
    larger[:] = EMPTY
    mask = np.uint64(len(larger) - 1)
    for entry in table:
        if entry != EMPTY:
            slot = (entry >> shift) & mask
            while larger[slot] != EMPTY:
                slot = (slot + np.uint64(1)) & mask
            larger[slot] = entry
    return larger


@kernel(inline="always")
def _same(points, i, j, grid):
    """Return whether two of the points, (N, 3), are in the same cell or, without a grid, at the same position."""
    for axis in range(3):
        a, b = points[i, axis], points[j, axis]
        if grid.scale > 0.0:
            a, b = np.floor(a * grid.scale), np.floor(b * grid.scale)
        if a != b:
            return False
    return True


@kernel(allocates=False)
def _hash(points, i, grid, spare):
    """Return a 64-bit hash of one of the points, (N, 3); only its first `spare` bits are used."""
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    if grid.scale > 0.0:
        x, y, z = np.floor(x * grid.scale), np.floor(y * grid.scale), np.floor(z * grid.scale)
    (u, v, w), (along_y, along_z) = grid.numbering
    if along_y == 0.0:
        return hash_of_place(x, y, z, np.uint64(0))
    number = ((x - u) * along_y + (y - v)) * along_z + (z - w)
    return _scrambled(np.uint64(number), np.uint64(spare)) << np.uint64(64 - spare)


@kernel(inline="always")
def _scrambled(number, bits):
    """Permute the numbers of `bits` bits: distinct numbers have distinct results."""
    mask, half = (np.uint64(1) << bits) - np.uint64(1), bits >> np.uint64(1)
    h = (number * np.uint64(0x9E3779B97F4A7C15)) & mask
    h = ((h ^ (h >> half)) * np.uint64(0xBF58476D1CE4E5B9)) & mask
    return h ^ (h >> half)
