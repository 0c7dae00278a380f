"""Find a cubic grid with the right number of occupied cells, and one point for each cell."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.cells import first_occurrences

BISECTIONS = 30  # bisections of the edge length, to a billionth: there, the counts of real clouds no longer change
SURPLUS = 2.0**-12  # the search stops when the surplus of cells is at most this share of the number wanted
FINEST = 2.0**-40  # edge length as a share of the cloud's size, below which cells approach the rounding of coordinates


def cell_edge(points: NDArray[np.float64], n_points: int) -> float:
    """Return an edge length for which at least M cells are occupied, and few more; see `searched_edge`.

    Shapes: points (N, 3).
    """
    return searched_edge(float(points.max()), n_points, lambda edge: occupied(points, edge))


def searched_edge(size: float, n_points: int, occupied: Callable[[float], int]) -> float:
    """Return an edge length for which at least M cells are occupied, and few more.

    As the edge length decreases, the number of occupied cells does not grow steadily: it jumps, most of all for flat
    faces parallel to the axes, and it can fall. The edge length is halved until there are enough cells; then the last
    step is bisected.
    """
    edge = size
    too_long = 2.0 * edge
    finest = FINEST * edge
    while (fewest := occupied(edge)) < n_points:
        too_long, edge = edge, edge / 2.0
        if edge < finest:  # division by a power of two does not round, so distinct points end in distinct cells
            edge = math.ldexp(0.5, math.frexp(edge)[1])
    best = edge
    for _ in range(BISECTIONS):
        if fewest - n_points <= SURPLUS * n_points:
            break
        middle = (edge + too_long) / 2.0
        count = occupied(middle)
        if count < n_points:
            too_long = middle
        else:
            edge = middle
            if count < fewest:
                best, fewest = middle, count
    return best


def occupied(points: NDArray[np.float64], edge: float) -> int:
    """Return the number of occupied cells of a grid that starts at the origin.

    Shapes: points (N, 3).
    """
    return int(np.count_nonzero(first_occurrences(np.floor(points / edge))))


def representatives(points: NDArray[np.float64], edge: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the mean of the points in each occupied cell, and the point nearest to it.

    Shapes: points (N, 3); returns indices (cells,), means (cells, 3).
    """
    cells = np.floor(points / edge).T
    order = np.lexsort(cells)
    begins = np.flatnonzero(np.append(True, (np.diff(cells[:, order], axis=1) != 0).any(axis=0)))
    sizes = np.diff(np.append(begins, len(points)))
    means = np.add.reduceat(points[order], begins) / sizes[:, None]
    squared = ((points[order] - np.repeat(means, sizes, axis=0)) ** 2).sum(axis=1)
    # Two points are equally near their mean; the factor makes up for rounding.
    nearest = np.flatnonzero(squared <= np.repeat((1 + 1e-9) * np.minimum.reduceat(squared, begins), sizes))
    indices = order[nearest[np.searchsorted(nearest, begins)]]  # the first in each cell, since the sort is stable
    ascending = np.argsort(indices)
    return indices[ascending], means[ascending]
