"""Greedy selection by uncertainty plus error (paper, Algorithm 1; Lalchand and Faul 2018), exact on all points."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.gp.spectral.posterior import Posterior

BUCKETS = 4096  # a step looks at all buckets and into few; beyond that, looking at all costs more
SLACK = 1e-12  # of a bound, for rounding: many times what a step can gather


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
    Only buckets whose bound is not below the best score that is known are looked into.

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
    points = _Points(np.ascontiguousarray(phi[order].T), y[order], order, free[order], np.empty(len(y)))
    buckets = _buckets(min(BUCKETS, len(y)), points.phi)
    k_add = min(k_add, n_points)
    step = k_add * max(1, 512 // k_add)
    for begin in range(len(initial), n_points, step):
        end = min(begin + step, n_points)
        _choose(points, buckets, mean, covariance, noise, k_add, chosen[:end], scores[:end], begin)
        if advanced:
            advanced(end - begin)
    return chosen, scores


class _Points(NamedTuple):
    """The points, neighbours near each other; `score` is s when the point's bucket was last looked into."""

    phi: NDArray[np.float64]  # (L, N), so that loops over points run along memory
    y: NDArray[np.float64]
    order: NDArray[np.int64]
    free: NDArray[np.bool_]
    score: NDArray[np.float64]


class _Buckets(NamedTuple):
    """Runs of points of equal length; the g-th of G is N g // G to N (g + 1) // G.

    `low` and `high` are the box of the features. When `looked` points had been chosen, the bucket was last
    looked into: `mean` was the weights' mean then, and `above` and `below` the largest sd + y - mu and sd + mu - y.
    `bound` is the largest s that a free point can have now; where looked into now, that of `best`.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    looked: NDArray[np.int64]
    mean: NDArray[np.float64]
    above: NDArray[np.float64]
    below: NDArray[np.float64]
    bound: NDArray[np.float64]
    best: NDArray[np.int64]


def _buckets(count: int, phi: NDArray[np.float64]) -> _Buckets:
    """Return buckets that have not been looked into."""
    starts = np.arange(count) * phi.shape[1] // count
    return _Buckets(
        low=np.ascontiguousarray(np.minimum.reduceat(phi, starts, axis=1).T),
        high=np.ascontiguousarray(np.maximum.reduceat(phi, starts, axis=1).T),
        looked=np.full(count, -1),
        mean=np.zeros((count, len(phi))),
        above=np.full(count, np.inf),
        below=np.full(count, np.inf),
        bound=np.full(count, np.inf),
        best=np.zeros(count, dtype=np.int64),
    )


@nb.njit(cache=True, nogil=True)
def _choose(points, buckets, mean, covariance, noise, k_add, chosen, scores, begin):
    """Fill `chosen` and `scores` from `begin` on."""
    batch = np.empty(k_add, dtype=np.int64)
    for now in range(begin, len(chosen), k_add):
        due = min(k_add, len(chosen) - now)
        for b in range(due):
            g = _bucket_of_best(points, buckets, mean, covariance, now)
            pick = buckets.best[g]
            batch[b], chosen[now + b], scores[now + b] = pick, points.order[pick], buckets.bound[g]
            points.free[pick] = False
            _find_best(g, points, buckets)
        for pick in batch[:due]:
            phi = points.phi[:, pick].copy()
            along = covariance @ phi
            spread = noise + phi @ along
            mean += along * ((points.y[pick] - phi @ mean) / spread)
            for row in range(len(along)):
                covariance[row] -= along * (along[row] / spread)
        _bound_all(buckets, mean)


@nb.njit(cache=True)
def _bucket_of_best(points, buckets, mean, covariance, now):
    """Return the bucket that holds the best point, looking into each that might."""
    bound, looked, best, order = buckets.bound, buckets.looked, buckets.best, points.order
    highest = int(np.argmax(bound))
    if looked[highest] != now:
        _look_into(highest, points, buckets, mean, covariance, now)
    for g in range(len(bound)):
        if bound[g] >= bound[highest]:
            if looked[g] != now:
                _look_into(g, points, buckets, mean, covariance, now)
            if bound[g] > bound[highest] or (bound[g] == bound[highest] and order[best[g]] < order[best[highest]]):
                highest = g
    return highest


@nb.njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
def _look_into(g, points, buckets, mean, covariance, now):
    """Bring the scores of a bucket's points up to date, and find the best."""
    count = len(buckets.bound)
    begin, end = len(points.y) * g // count, len(points.y) * (g + 1) // count
    phi, free, score = points.phi[:, begin:end], points.free[begin:end], points.score[begin:end]
    error = -points.y[begin:end]
    variance = np.zeros(end - begin, dtype=np.float64)
    along = np.empty(end - begin, dtype=np.float64)
    for r in range(len(mean)):
        along[:] = 0.5 * covariance[r, r] * phi[r]
        for c in range(r):
            along += covariance[r, c] * phi[c]
        variance += 2.0 * along * phi[r]
        error += mean[r] * phi[r]
    above = below = -np.inf
    for i in range(end - begin):
        sd = np.sqrt(max(variance[i], 0.0))
        score[i] = sd + abs(error[i])
        if free[i]:
            above = max(above, sd - error[i])
            below = max(below, sd + error[i])
    buckets.above[g], buckets.below[g] = above, below
    buckets.mean[g] = mean
    buckets.looked[g] = now
    _find_best(g, points, buckets)


@nb.njit(cache=True, fastmath=False)
def _find_best(g, points, buckets):
    """Find the free point of largest score in a bucket that is up to date; of several, the smallest index."""
    n, count, order = len(points.y), len(buckets.bound), points.order
    best, highest = -1, -np.inf
    for i in range(n * g // count, n * (g + 1) // count):
        score = points.score[i]
        if points.free[i] and (score > highest or (score == highest and order[i] < order[best])):
            best, highest = i, score
    buckets.best[g], buckets.bound[g] = best, highest


@nb.njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
def _bound_all(buckets, mean):
    """Bound what the step of the weights since each bucket was last looked into can have made of its scores."""
    low, high, seen, bound = buckets.low, buckets.high, buckets.mean, buckets.bound
    for g in range(len(bound)):
        fall = rise = 0.0
        for c in range(len(mean)):
            step = mean[c] - seen[g, c]
            a, b = low[g, c] * step, high[g, c] * step
            fall += min(a, b)
            rise += max(a, b)
        bound[g] = max(buckets.above[g] - fall, buckets.below[g] + rise)
        if bound[g] > -np.inf:
            bound[g] += SLACK * abs(bound[g])
