"""Weights of the density: what users know that the cloud does not tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

GROUPS = 9  # Weights are compared in groups: quantiles, or single weights if there are no more.
FEWEST = 24  # Chosen points of a group from which on it is compared.
SMALLER = 0.7  # The logarithm of what is lacking, from stage to stage: it goes as the spacing.
GREATEST_POWER = 1.2
FINEST = 8.0  # Times the usual number of candidates at most, where large weights want many points in few places.


class Weighing:
    """Multiplies the density of desired spacings by weights, and learns from each stage what that comes to.

    Near a jump of the weights, and where normals turn much from one point to the next, the choice follows the desired
    spacings less than it should. So the weights of the next stage get another power, by which the chosen points have
    the densities that are wanted.
    """

    def __init__(self, weights: NDArray[np.float64]) -> None:
        self._weights, self.power = weights, 1.0

    def weighted(self, spacings: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return desired spacings of candidates of which the density is multiplied by weights, (n,).

        The weights come after the gradation, so that the density jumps where they do. The mean of 1 / spacing^2 is 1.
        """
        density = self._weights[rows] ** self.power * spacings**-2.0
        return np.sqrt(np.mean(density) / density)

    def learn(self, spacings: NDArray[np.float64], rows: NDArray[np.int64], chosen: NDArray[np.int64]) -> None:
        """Compare the points chosen so far with those wanted, and change the power for the next stage.

        Shapes: spacings, rows (n,), chosen (m,).
        """
        weights = self._weights[rows]
        edges = np.unique(np.quantile(weights, np.linspace(0.0, 1.0, GROUPS), method="lower"))
        group = np.searchsorted(edges, weights, side="right") - 1
        wanted = np.bincount(group, weights * spacings**-2.0, len(edges))
        found = np.bincount(group[chosen], minlength=len(edges))
        known = (wanted > 0.0) & (found >= FEWEST)
        if known.sum() < 2:
            return
        means = np.bincount(group, np.log(weights), len(edges))[known] / np.bincount(group, minlength=len(edges))[known]
        slope = np.polyfit(means, np.log(found[known] / wanted[known]), 1, w=np.sqrt(found[known]))[0]
        lacking = self.power / max(1.0 + slope, 0.1)
        self.power = float(np.clip(lacking**SMALLER, 1.0, GREATEST_POWER))


def refinement(weights: NDArray[np.float64]) -> float:
    """Return how many times as many candidates are needed as without weights, (N,)."""
    return min(float(weights.max() / weights.mean()), FINEST)
