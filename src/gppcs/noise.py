"""How far points lie off the surface that their neighbours make out."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.kdtree import KdTree
from gppcs.local_quadric import fit_quadric

NEIGHBOURS = 40  # points that a quadric is fitted to
SAMPLES = 4096  # points by which the level of the noise is judged
TOLERATED = 0.5  # of the target spacing: noise of that size makes an observation as uncertain as the field's prior
QUIET = 0.02  # of the target spacing: a level of noise that changes no choice worth the time


def variances(tree: KdTree, spacing: float) -> tuple[NDArray[np.float64] | None, float]:
    """Return the variance of each point's observation across the surface, and the level of the noise.

    A point's residual is its distance from the quadric fitted to its nearest points. The level is the root of the
    mean squared residual of some points. Where that is small beside the target spacing, there is no noise to speak of.

    Parameters
    ----------
    tree : KdTree
        Over points without repeats.
    spacing : float
        The target spacing, in the unit of the points.

    Returns
    -------
    variances : (N,) array or None
        In the order of the tree's input, in units of the field's prior if the target spacing were one. None where
        there is no noise to speak of.
    level : float
        In the unit of the points.
    """
    count = len(tree.order)
    some = residuals(tree, np.arange(0, count, -(-count // SAMPLES)))
    level = float(np.sqrt(np.mean(some**2)))
    if level <= QUIET * spacing:
        return None, level
    result = np.empty(count)
    result[tree.order] = (residuals(tree, np.arange(count)) / TOLERATED) ** 2
    return result, level


def residuals(tree: KdTree, positions: NDArray[np.int64], neighbours: int = NEIGHBOURS) -> NDArray[np.float64]:
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
