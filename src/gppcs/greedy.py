"""Greedy selection by uncertainty plus error (paper, Algorithm 1; Lalchand and Faul 2018), exact on all points."""

from __future__ import annotations

from collections.abc import Callable

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.posterior import Posterior

BUCKETS = 2048  # a step looks at all buckets and into few; beyond some thousand, looking at all costs more
SLACK = 1e-9  # of a bound, for rounding: many times what a step can gather


def select(
    phi: NDArray[np.float64],
    y: NDArray[np.float64],
    noise: float,
    initial: NDArray[np.int64],
    n_points: int,
    k_add: int = 1,
    order: NDArray[np.int64] | None = None,
    advanced: Callable[[int], None] | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Add to the active set, `k_add` at a time, the points of largest s = sqrt(diag Sigma) + |mu - y|.

    The result is Algorithm 1's, but a step looks into few points. Points are kept in buckets, each with the box
    of its features and the largest s when it was last looked into. Since then variances can only have fallen,
    and when the weights move by dw, the mean of any point in the bucket moves by phi dw, which the box bounds.
    Buckets are looked into from the highest bound down, until one that is up to date holds the largest.

    Parameters
    ----------
    phi : (N, L) array
        Features of the kernel, K = Phi Phi^T.
    y : (N,) array
    noise : float
        sigma_y^2, positive.
    initial : (k_init,) array
        The active set to start from.
    n_points : int
        M.
    k_add : int
        Points added between two updates of the posterior.
    order : (N,) array, optional
        A permutation in which neighbours stand near each other, such as a tree's: it makes the boxes small. It
        has no influence on the result.
    advanced : callable, optional
        Told of the number of points added since the last call.

    Returns
    -------
    indices : (M,) array
        `initial`, then the others in the order chosen; ties go to the smallest index.
    scores : (M,) array
        s of each when it was chosen, infinite for the initial ones.
    """
    order = np.arange(len(y)) if order is None else order
    chosen = np.empty(n_points, dtype=np.int64)
    scores = np.full(n_points, np.inf)
    chosen[: len(initial)] = initial
    posterior = Posterior.given(phi[initial], y[initial], noise)
    mean, covariance = posterior.mean.copy(), posterior.covariance.copy()
    free = np.ones(len(y), dtype=np.bool_)
    free[initial] = False
    sorted_phi, sorted_y, free = phi[order], y[order], free[order]
    buckets = _Buckets(min(BUCKETS, len(y)), sorted_phi)
    score = np.empty(len(y), dtype=np.float64)
    step = k_add * max(1, 512 // k_add)
    for begin in range(len(initial), n_points, step):
        end = min(begin + step, n_points)
        _choose(
            sorted_phi, sorted_y, order, free, score, noise, k_add, mean, covariance,
            buckets.low, buckets.high, buckets.seen, buckets.up_to_date,
            buckets.above, buckets.below, buckets.bound, buckets.best, chosen[begin:end], scores[begin:end],
        )  # fmt: skip
        if advanced:
            advanced(end - begin)
    return chosen, scores


class _Buckets:
    """Runs of equal length over the sorted points; the g-th of G is N g // G to N (g + 1) // G.

    `low` and `high` are the box of the features; `seen` the weights' mean when the bucket was last looked into;
    `above` and `below` the largest sd + y - mu and sd + mu - y then; `bound` the largest s that a free point can
    have now; `best` the position of the largest, where `up_to_date`.
    """

    def __init__(self, count: int, phi: NDArray[np.float64]) -> None:
        starts = np.arange(count) * len(phi) // count
        self.low = np.minimum.reduceat(phi, starts)
        self.high = np.maximum.reduceat(phi, starts)
        self.seen = np.zeros_like(self.low)
        self.up_to_date = np.zeros(count, dtype=np.bool_)
        self.above = np.full(count, np.inf)
        self.below = np.full(count, np.inf)
        self.bound = np.full(count, np.inf)
        self.best = np.zeros(count, dtype=np.int64)


@nb.njit(cache=True)
def _choose(
    phi, y, order, free, score, noise, k_add, mean, covariance,
    low, high, seen, up_to_date, above, below, bound, best, chosen, scores,
):  # fmt: skip
    batch = np.empty(k_add, dtype=np.int64)
    for begin in range(0, len(chosen), k_add):
        due = min(k_add, len(chosen) - begin)
        for b in range(due):
            g = _highest(bound, up_to_date, best, order)
            while not up_to_date[g]:
                _look_into(g, phi, y, order, free, score, mean, covariance, seen, above, below, bound, best)
                up_to_date[g] = True
                g = _highest(bound, up_to_date, best, order)
            batch[b] = best[g]
            chosen[begin + b], scores[begin + b] = order[best[g]], bound[g]
            free[best[g]] = False
            _find_best(g, len(y), order, free, score, bound, best)
        for pick in batch[:due]:
            along = covariance @ phi[pick]
            spread = noise + phi[pick] @ along
            mean += along * ((y[pick] - phi[pick] @ mean) / spread)
            for row in range(len(along)):
                covariance[row] -= along * (along[row] / spread)
        up_to_date[:] = False
        _bound_all(mean, low, high, seen, above, below, bound)


@nb.njit(cache=True)
def _highest(bound, up_to_date, best, order):
    """Return the bucket of highest bound; of several, one not up to date, or else that of the smallest index."""
    highest = 0
    for g in range(1, len(bound)):
        if bound[g] > bound[highest] or (
            bound[g] == bound[highest]
            and up_to_date[highest]
            and (not up_to_date[g] or order[best[g]] < order[best[highest]])
        ):
            highest = g
    return highest


@nb.njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
def _look_into(g, phi, y, order, free, score, mean, covariance, seen, above, below, bound, best):
    """Bring a bucket up to date: the score of each of its points, and the largest."""
    buckets = len(bound)
    above[g] = below[g] = -np.inf
    seen[g] = mean
    for i in range(len(y) * g // buckets, len(y) * (g + 1) // buckets):
        if not free[i]:
            continue
        variance = error = 0.0
        for r in range(len(mean)):
            error += phi[i, r] * mean[r]
            along = 0.0
            for c in range(len(mean)):
                along += covariance[r, c] * phi[i, c]
            variance += phi[i, r] * along
        sd, error = np.sqrt(max(variance, 0.0)), error - y[i]
        score[i] = sd + abs(error)
        above[g] = max(above[g], sd - error)
        below[g] = max(below[g], sd + error)
    _find_best(g, len(y), order, free, score, bound, best)


@nb.njit(cache=True)
def _find_best(g, n, order, free, score, bound, best):
    buckets = len(bound)
    bound[g] = -np.inf
    for i in range(n * g // buckets, n * (g + 1) // buckets):
        if free[i] and (score[i] > bound[g] or (score[i] == bound[g] and order[i] < order[best[g]])):
            bound[g], best[g] = score[i], i


@nb.njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
def _bound_all(mean, low, high, seen, above, below, bound):
    """Bound what the step of the weights since each bucket was last looked into can have made of its scores."""
    for g in range(len(bound)):
        fall = rise = 0.0
        for c in range(len(mean)):
            step = mean[c] - seen[g, c]
            a, b = low[g, c] * step, high[g, c] * step
            fall += min(a, b)
            rise += max(a, b)
        bound[g] = max(above[g] - fall, below[g] + rise)
        if bound[g] > -np.inf:
            bound[g] += SLACK * abs(bound[g])


def largest(values: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return the indices of the `count` largest values, largest first; ties go to the smallest index."""
    if count == 0:
        return np.empty(0, dtype=np.int64)
    least = np.partition(values, len(values) - count)[len(values) - count]
    candidates = np.flatnonzero(values >= least)
    return candidates[np.argsort(-values[candidates], kind="stable")[:count]]
