"""How far points lie off the surface that their neighbours make out."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.kdtree import KdTree
from gppcs.local_quadric import fit_quadric

FEWEST, MOST = 12, 40  # points that a quadric is fitted to: with fewer it goes through them, noise and all
SAMPLES = 4096  # points by which the level of the noise is judged
TOLERATED = 0.5  # of the target spacing: noise of that size makes an observation as uncertain as the field's prior
QUIET = 0.04  # of the target spacing: a level of noise that changes no choice worth the time


@dataclass(frozen=True)
class Noise:
    """How far points lie off the surface, by the quadrics fitted to those around them.

    Attributes
    ----------
    tree : KdTree
        Over the points that quadrics are fitted to.
    neighbours : int
        How many each is fitted to.
    level : float
        The root of the mean squared residual of some points, in their unit; 0 where it cannot be told.
    spacing : float
        The target spacing.
    """

    tree: KdTree
    neighbours: int
    level: float
    spacing: float

    @classmethod
    def measure(cls, tree: KdTree, n_points: int, spacing: float) -> Noise:
        """Measure the noise where M points are to be chosen.

        A quadric is fitted to as many points as there are on average within the target spacing: beyond, detail that is
        to be kept would pass for noise.
        """
        count = len(tree.order)
        neighbours = min(MOST, int(np.pi * count / n_points))
        if neighbours < FEWEST:
            return cls(tree, neighbours, 0.0, spacing)
        some = tree.points.T[:: -(-count // SAMPLES)]
        return cls(tree, neighbours, float(np.sqrt(np.mean(residuals(tree, some, neighbours) ** 2))), spacing)

    @property
    def quiet(self) -> bool:
        """Whether there is none to speak of: it is small, or too few points lie near each other to tell."""
        return self.level <= QUIET * self.spacing

    def variances(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the variance of the observation at each of some points, (n, 3), across the surface.

        Times 1 / h^2, in units of the field's prior at spacing h. At most one at the target spacing: an observation is
        worth at least half of one without noise, lest lone points be left out.
        """
        if self.quiet:
            return np.zeros(len(places))
        return np.minimum(residuals(self.tree, places, self.neighbours) / TOLERATED, self.spacing) ** 2


def residuals(tree: KdTree, places: NDArray[np.float64], neighbours: int) -> NDArray[np.float64]:
    """Return the distance of places, (n, 3), from the quadrics fitted to the points around them."""
    found = np.empty(len(places))
    places = np.ascontiguousarray(places)
    _residuals(tree.points, tree.low, tree.high, places, min(neighbours, len(tree.order)), found)
    return found


@nb.njit(cache=True, parallel=True, nogil=True, fastmath=False)
def _residuals(points, low, high, places, k, found):
    for i in nb.prange(len(places)):
        normal = np.empty(3, dtype=np.float64)
        x, y, z = places[i]
        height, reach, _ = fit_quadric(points, low, high, x, y, z, k, normal)
        found[i] = abs(height) * reach
