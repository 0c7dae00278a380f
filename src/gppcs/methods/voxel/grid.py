"""One point for each occupied cell of a cubic grid, with cells of the size that gives the number asked for."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.cells import first_occurrences

BISECTIONS = 30  # of the cell's edge: to a billionth, where counts of real clouds no longer change
EMPTIEST = 2.0**-12  # share of the points too many at which a finer edge is not worth its time
FINEST = 2.0**-40  # of the cloud's size: below it, cells are about as small as the rounding of coordinates


def cell_edge(points: NDArray[np.float64], n_points: int) -> float:
    """Return an edge for which no fewer cells than asked for are occupied, and hardly more.

    The number of occupied cells jumps as their edge shrinks, most where flat faces lie along the axes, and does not
    only grow. The edge is halved until there are cells enough, and the last step bisected.

    Parameters
    ----------
    points : (N, 3) array, float64
        Without repeats, in the first octant and not all at the origin.
    n_points : int
        From 1 to N.
    """
    edge = float(points.max())
    too_long = 2.0 * edge
    finest = FINEST * edge
    while (fewest := occupied(points, edge)) < n_points:
        too_long, edge = edge, edge / 2.0
        if edge < finest:  # a power of two: the division by it rounds nothing, and distinct points part at last
            edge = math.ldexp(0.5, math.frexp(edge)[1])
    best = edge
    for _ in range(BISECTIONS):
        if fewest - n_points <= EMPTIEST * n_points:
            break
        middle = (edge + too_long) / 2.0
        count = occupied(points, middle)
        if count < n_points:
            too_long = middle
        else:
            edge = middle
            if count < fewest:
                best, fewest = middle, count
    return best


def occupied(points: NDArray[np.float64], edge: float) -> int:
    """Return the number of cells with a point in them; cells begin at the origin."""
    return int(np.count_nonzero(first_occurrences(np.floor(points / edge))))


def representatives(points: NDArray[np.float64], edge: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the point of each occupied cell nearest the mean of its points, and that mean.

    Parameters
    ----------
    points : (N, 3) array, float64
    edge : float
        Of the cells.

    Returns
    -------
    indices : (cells,) array, int64
        Ascending; of several points as near, that of the smallest index.
    means : (cells, 3) array, float64
    """
    cells = np.floor(points / edge).T
    order = np.lexsort(cells)
    begins = np.flatnonzero(np.append(True, (np.diff(cells[:, order], axis=1) != 0).any(axis=0)))
    sizes = np.diff(np.append(begins, len(points)))
    means = np.add.reduceat(points[order], begins) / sizes[:, None]
    squared = ((points[order] - np.repeat(means, sizes, axis=0)) ** 2).sum(axis=1)
    # the two points of a pair are equally near their mean, but for rounding
    nearest = np.flatnonzero(squared <= np.repeat((1 + 1e-9) * np.minimum.reduceat(squared, begins), sizes))
    indices = order[nearest[np.searchsorted(nearest, begins)]]  # the first of each cell; the order is stable
    ascending = np.argsort(indices)
    return indices[ascending], means[ascending]
