"""Choose every k-th point of a cloud, counted cell by cell, so that the density stays even: in O(N), without a tree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.spatial.scaling import bounds

POINTS_PER_CELL = 32  # of a surface, about, at least: as many as a leaf of a tree has
MOST_CELLS = 1 << 24  # of the grid: their counts take 128 MiB


def even_sample(points: NDArray[np.float64], usable: NDArray[np.bool_], step: int) -> NDArray[np.int64]:
    """Choose every k-th of the usable points, (N,); cell by cell of a grid, so that each keeps its share."""
    low, high = bounds(points)
    extents = high - low
    edge = float(extents.max()) or 1.0
    counts = np.ones(3, dtype=np.int64)
    wanted = len(points) // max(POINTS_PER_CELL, step)  # a surface with k cells along its box meets about k^2 of them
    while extents.any() and counts.max() ** 2 < wanted:
        finer = np.floor(extents / (0.5 * edge)).astype(np.int64) + 1
        if np.prod(finer, dtype=np.float64) > MOST_CELLS:
            break
        edge, counts = 0.5 * edge, finer
    taken = np.zeros(len(points), dtype=np.bool_)
    ranks = np.zeros(np.prod(counts), dtype=np.int64)
    _count(points, usable, low, 1.0 / edge, counts, ranks)
    ranks = np.cumsum(ranks) - ranks
    _take(points, usable, low, 1.0 / edge, counts, ranks, step, taken)
    return np.flatnonzero(taken)


@kernel(allocates=False)
def _cell(points, i, low, scale, counts):
    """Return the number of the cell of a point; a point on the far side of the box is in the last cell."""
    number = 0
    for axis in range(3):
        place = int((points[i, axis] - low[axis]) * scale)
        number = number * counts[axis] + min(place, counts[axis] - 1)
    return number


@kernel(allocates=False)
def _count(points, usable, low, scale, counts, ranks):
    """Count the usable points of each cell in `ranks`, (cells,), zero at first."""
    for i in range(len(points)):
        if usable[i]:
            ranks[_cell(points, i, low, scale, counts)] += 1


@kernel(allocates=False)
def _take(points, usable, low, scale, counts, ranks, step, taken):
    """Mark every `step`-th point in `taken`, (N,); `ranks`, (cells,), is the rank of the first point of each cell."""
    for i in range(len(points)):
        if usable[i]:
            cell = _cell(points, i, low, scale, counts)
            taken[i] = ranks[cell] % step == 0
            ranks[cell] += 1
