"""Samples of points: even ones, and random ones of points that come in chunks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.scaling import bounds

HASHES = float(2**64)


def point_hashes(points: Floats, seed: int = 0) -> NDArray[np.uint64]:
    """Return a random number for each point, which depends on its coordinates only. Shapes: points (n, 3)."""
    mixed = np.full(len(points), np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])
    for bits in np.ascontiguousarray(points.T).view(np.uint64):
        mixed = hashes(mixed ^ bits)
    return mixed


def hashes(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return a random number for each value, (n,) (SplitMix64; Steele, Lea and Flood 2014)."""
    result = np.empty_like(values)
    on_ranges(_hash_all, len(values), values, result, minimum=1 << 14)
    return result


@kernel(allocates=False)
def _hash_all(begin, end, values, result):
    """Fill `result`, (n,), with the random numbers of a range of values."""
    for i in range(begin, end):
        result[i] = _hash(values[i])


@kernel(allocates=False)
def _hash(value):
    """Return the random number of a value."""
    mixed = (value + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mixed ^ (mixed >> np.uint64(31))


def is_drawn(indices: Ints, fraction: float) -> Flags:
    """Mark the points of a random sample, which depends on their indices only. Shapes: indices (n,); returns (n,)."""
    drawn = np.ones(len(indices), dtype=np.bool_)
    if fraction < 1.0:
        limit = fraction * HASHES
        on_ranges(_mark_drawn, len(indices), np.ascontiguousarray(indices), limit, drawn, minimum=1 << 14)
    return drawn


@kernel(allocates=False)
def _mark_drawn(begin, end, indices, limit, drawn):
    """Fill `drawn`, (n,), for a range of indices: whether their random numbers are below a limit."""
    for i in range(begin, end):
        drawn[i] = _hash(np.uint64(indices[i])) < limit


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
