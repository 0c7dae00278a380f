"""Samples of points: even ones, and random ones by where points lie."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.scaling import bounds

HASHES = 2.0**64


def point_hashes(points: Floats, seed: int = 0, size: float | None = None) -> NDArray[np.uint64]:
    """Return a random number for each point, (n, 3), whatever the order of the points.

    It depends on where points lie in units of a size: by default that of their largest coordinate.
    """
    result = np.empty(len(points), dtype=np.uint64)
    _fill_hashes(points, seed, 64, size, result)
    return result


def short_hashes(points: Floats, bits: int) -> NDArray[np.uint32]:
    """Return the first bits, 32 at most, of `point_hashes`."""
    result = np.empty(len(points), dtype=np.uint32)
    _fill_hashes(points, 0, bits, None, result)
    return result


def _fill_hashes(
    points: Floats, seed: int, bits: int, size: float | None, result: NDArray[np.unsignedinteger[Any]]
) -> None:
    """Fill `result`, (n,), with the first bits of random numbers of points, (n, 3)."""
    if size is None:
        size = float(np.abs(bounds(points)).max()) if len(points) else 1.0
    start, shift = _state_of(seed), np.uint64(64 - bits)
    on_ranges(_hash_all, len(points), points, size or 1.0, start, shift, result, minimum=1 << 14)


@cache
def _state_of(seed: int) -> np.uint64:
    """Return the random bits with which the hashes of a seed start."""
    return np.random.SeedSequence(seed).generate_state(1, np.uint64)[0]


@kernel(allocates=False)
def _hash_all(begin, end, points, size, start, shift, result):
    """Fill a range of `result`, (n,), with the first bits of the hashes of points, (n, 3), in units of a size."""
    for i in range(begin, end):
        result[i] = hash_of_place(points[i, 0] / size, points[i, 1] / size, points[i, 2] / size, start) >> shift


@kernel(allocates=False)
def hash_of_place(x, y, z, seed):
    """Return a 64-bit hash of three floats and a seed; zero and minus zero have the same hash."""
    h = seed
    for part in (x, y, z):
        h ^= np.float64(part + 0.0).view(np.uint64)
        h = (h ^ (h >> np.uint64(32))) * np.uint64(0x9E3779B97F4A7C15)  # whole numbers differ in the first bits only
        h ^= h >> np.uint64(29)
    h *= np.uint64(0xBF58476D1CE4E5B9)
    return h ^ (h >> np.uint64(32))


def even_sample(points: Floats, usable: Flags, step: int) -> Ints:
    """Choose every k-th of the usable points, (N,), counted cell by cell, so that the density stays even: in O(N)."""
    lower, upper = bounds(points)
    extents = upper - lower
    edge = float(extents.max()) or 1.0
    counts = np.ones(3, dtype=np.int64)
    # Of a surface, a cell has at least 32 points, about. With k cells along its box it meets about k^2 of them.
    n_cells = len(points) // max(32, step)
    while extents.any() and counts.max() ** 2 < n_cells:
        finer = np.floor(extents / (0.5 * edge)).astype(np.int64) + 1
        if np.prod(finer, dtype=np.float64) > 1 << 24:  # whose counts take 128 MiB
            break
        edge, counts = 0.5 * edge, finer
    taken = np.zeros(len(points), dtype=np.bool_)
    ranks = np.zeros(np.prod(counts), dtype=np.int64)
    _count(points, usable, lower, 1.0 / edge, counts, ranks)
    ranks = np.cumsum(ranks) - ranks
    _take(points, usable, lower, 1.0 / edge, counts, ranks, step, taken)
    return np.flatnonzero(taken)


@kernel(allocates=False)
def _cell(points, i, lower, scale, counts):
    """Return the number of the cell of a point; a point on the far side of the box is in the last cell."""
    number = 0
    for axis in range(3):
        cell = int((points[i, axis] - lower[axis]) * scale)
        number = number * counts[axis] + min(cell, counts[axis] - 1)
    return number


@kernel(allocates=False)
def _count(points, usable, lower, scale, counts, ranks):
    """Count the usable points of each cell in `ranks`, (cells,), zero at first."""
    for i in range(len(points)):
        if usable[i]:
            ranks[_cell(points, i, lower, scale, counts)] += 1


@kernel(allocates=False)
def _take(points, usable, lower, scale, counts, ranks, step, taken):
    """Mark every `step`-th point in `taken`, (N,); `ranks`, (cells,), is the rank of the first point of each cell."""
    for i in range(len(points)):
        if usable[i]:
            cell = _cell(points, i, lower, scale, counts)
            taken[i] = ranks[cell] % step == 0
            ranks[cell] += 1
