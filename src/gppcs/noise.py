"""How far points lie off the surface that their neighbours make out."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.kdtree import KdTree
from gppcs.local_quadric import fit_quadric

FEWEST, MOST = 12, 40  # points that a quadric is fitted to: with fewer it goes through them, noise and all
SAMPLES = 4096  # points by which the level of the noise is judged
TOLERATED = 0.5  # of the target spacing: noise of that size makes an observation as uncertain as the field's prior
QUIET = 0.04  # of the target spacing: a level of noise that changes no choice worth the time


def variances(tree: KdTree, n_points: int, spacing: float) -> tuple[NDArray[np.float64] | None, float]:
    """Return the variance of each point's observation across the surface, and the level of the noise.

    A point's residual is its distance from the quadric fitted to its nearest points, as many as there are on average
    within the target spacing: beyond, detail that is to be kept would pass for noise. The level is the root of the mean
    squared residual of some points. Where it is small, or too few points lie so near, there is no noise to speak of.

    Parameters
    ----------
    tree : KdTree
        Over points without repeats.
    n_points : int
        M, the number of points to be chosen.
    spacing : float
        The target spacing, in the unit of the points.

    Returns
    -------
    variances : (N,) array or None
        In the order of the tree's input; times 1 / h^2, in units of the field's prior at spacing h. At most one at the
        target spacing: an observation is worth at least half of one without noise, lest lone points be left out.
    level : float
        In the unit of the points.
    """
    count = len(tree.order)
    neighbours = min(MOST, int(np.pi * count / n_points))
    if neighbours < FEWEST:
        return None, 0.0
    some = residuals(tree, np.arange(0, count, -(-count // SAMPLES)), neighbours)
    level = float(np.sqrt(np.mean(some**2)))
    if level <= QUIET * spacing:
        return None, level
    result = np.empty(count)
    result[tree.order] = residuals(tree, np.arange(count), neighbours) / TOLERATED
    return np.minimum(result, spacing) ** 2, level


def residuals(tree: KdTree, positions: NDArray[np.int64], neighbours: int) -> NDArray[np.float64]:
    """Return the distance of points, given by their positions in tree order, from the quadrics fitted around them."""
    found = np.empty(len(positions))
    _residuals(tree.points, tree.low, tree.high, positions, min(neighbours, len(tree.order)), found)
    return found


@nb.njit(cache=True, parallel=True, nogil=True, fastmath=False)
def _residuals(points, low, high, positions, k, found):
    for slot in nb.prange(len(positions)):
        i = positions[slot]
        normal = np.empty(3, dtype=np.float64)
        height, reach, _ = fit_quadric(points, low, high, points[0, i], points[1, i], points[2, i], k, normal)
        found[slot] = abs(height) * reach
