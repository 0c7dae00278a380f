"""Points that are kept whatever happens, and weights of the density: what users know that the cloud does not tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.stages import Stages
from gppcs.gp.local.candidates import Candidates, Finest
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.chunks import ChunkedValues, Places, SparseValues, joined_places
from gppcs.spatial.exact_sums import exact_sum, mean_of

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

    Parameters
    ----------
    weights : (N,) array
        Of the candidates of the last stage; above 0.
    """

    def __init__(self, weights: NDArray[np.float64]) -> None:
        self._weights, self._power = weights, 1.0

    def weighted(self, spacings: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return desired spacings of which the density is multiplied by weights.

        The weights come after the gradation, so that the density jumps where they do.

        Parameters
        ----------
        spacings : (n,) array
            In units of the target spacing.
        rows : (n,) array, int64
            Of these candidates.

        Returns
        -------
        (n,) array
            The mean of 1 / spacing^2 is 1.
        """
        density = self._weights[rows] ** self._power * spacings**-2.0
        return np.sqrt(np.mean(density) / density)

    def learn(self, spacings: NDArray[np.float64], rows: NDArray[np.int64], chosen: NDArray[np.int64]) -> None:
        """Compare the points chosen so far with those wanted, and change the power for the next stage.

        Parameters
        ----------
        spacings, rows : (n,) arrays
            As for `weighted`.
        chosen : (m,) array, int64
            Which of the candidates are chosen.
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
        lacking = self._power / max(1.0 + slope, 0.1)
        self._power = float(np.clip(lacking**SMALLER, 1.0, GREATEST_POWER))


def refinement(weights: NDArray[np.float64] | None) -> float:
    """Return how many times as many candidates are needed as without weights.

    Parameters
    ----------
    weights : (N,) array or None

    Returns
    -------
    float
        At least 1: the largest weight in units of their mean.
    """
    return 1.0 if weights is None else min(float(weights.max() / weights.mean()), FINEST)


class ChunkedWeights:
    """Weights of points in chunks. This takes a pass over them, which finds their mean and the least one.

    Parameters
    ----------
    weights : ChunkedValues
        Shares of the largest one. Those of points that are chosen anyway may be 0; they count as
        the least of the others.
    stages : Stages
        Times "weights". A step is a point read.
    """

    def __init__(self, weights: ChunkedValues, stages: Stages) -> None:
        self._weights, self._stages = weights, stages
        with stages("weights", len(weights)) as advanced:
            found = list(weights.each(_summed, advanced))
        self._least = min(each.least for each in found)
        zeros = sum(each.zeros for each in found)
        total = sum(each.total for each in found) + zeros * exact_sum(np.array([self._least]))
        self._mean = mean_of(total, len(weights))

    @property
    def refinement(self) -> float:
        """How many times as many candidates are needed as without weights; see `refinement`."""
        return min(1.0 / self._mean, FINEST)

    def at(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the weights of some points, above 0, by a pass over all of them.

        Parameters
        ----------
        rows : (n,) array, int64
            In any order.

        Returns
        -------
        (n,) array
        """
        with self._stages("weights", len(self._weights)) as advanced:
            return np.maximum(self._weights.at(rows, advanced), self._least)


class _Summed(NamedTuple):
    """The exact sum of the weights of a chunk, the number of those that are 0, and the least of others."""

    total: int
    zeros: int
    least: float


def _summed(first: int, weights: NDArray[np.float64]) -> _Summed:
    positive = weights > 0.0
    return _Summed(exact_sum(weights), int((~positive).sum()), float(weights.min(initial=1.0, where=positive)))


def behind_fixed(finest: Finest, fixed: Places, sharpness: SparseValues) -> Finest:
    """Return the candidates of the last stage behind given points, without those at the same places.

    Parameters
    ----------
    finest : Finest
    fixed : Places
        Without repeats.
    sharpness : SparseValues
        Of all points.

    Returns
    -------
    Finest
        Its rows need not ascend.
    """
    found = fixed._replace(values=sharpness.take(fixed.rows))
    both = joined_places([found, finest.places])
    return finest._replace(places=both.take(np.flatnonzero(first_occurrences(both.points))))


def after_fixed(candidates: Sequence[Candidates], fixed: int) -> list[Candidates]:
    """Return the stages that want more than the first points, with these among their candidates.

    Parameters
    ----------
    candidates : sequence of Candidates
        Of all stages.
    fixed : int
        How many first points.

    Returns
    -------
    list of Candidates
    """
    return [
        stage._replace(indices=np.union1d(stage.indices, np.arange(fixed)))
        for stage in candidates
        if stage.target > fixed
    ]
