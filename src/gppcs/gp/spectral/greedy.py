"""Greedy selection by uncertainty plus error, exact on all points (paper, Algorithm 1; Lalchand and Faul 2018)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.gp.spectral.posterior import posterior

BUCKETS = 4096  # most buckets of points: each step reads all bounds but rescans few buckets; more would be slower
# The posterior is computed anew whenever there are this many times as many observations, as the errors of updates stay
# while the variance shrinks: from one observation on 13,000 updates could lose all digits.
REFRESHED = 4


def select(
    phi: Floats,
    y: Floats,
    noise: float,
    initial: Ints,
    n_points: int,
    k_add: int = 1,
    order: Ints | None = None,
    on_progress: Callable[[int], None] | None = None,
) -> Ints:
    """Add points to the active set, each time the `k_add` of largest score s = sqrt(diag Sigma) + |mu - y|.

    The result is exactly that of the paper's Algorithm 1, but a step scans only the buckets of points whose bound is
    not below the best score so far. Since a bucket was last scanned, variances can only have decreased. If the weights'
    mean has moved by dw, the mean at a point has moved by phi dw, which the bounding box of phi bounds. Shapes: phi (N,
    L), y (N,), initial (k_init,), order (N,); returns (M,).
    """
    order = np.arange(len(y)) if order is None else order
    chosen = np.empty(n_points, dtype=np.int64)
    chosen[: len(initial)] = initial
    free = np.ones(len(y), dtype=np.bool_)
    free[initial] = False
    points = _Points(np.ascontiguousarray(phi[order].T), y[order], order, free[order], np.empty(len(y)))
    k_add = min(k_add, n_points)
    begin, computed = len(initial), 0  # at how many observations the posterior was last computed anew
    while begin < n_points:
        if begin >= REFRESHED * computed:
            # compute mu_t, Sigma_t; later `_observe` updates them
            mean, covariance = posterior(phi[chosen[:begin]], y[chosen[:begin]], noise)
            covariance, computed = np.ascontiguousarray(covariance), begin
            buckets = _buckets(min(BUCKETS, len(y)), points.phi)  # bounds from an earlier posterior need not hold
        steps = max(1, -(-min(512, REFRESHED * computed - begin) // k_add))  # from one report of progress to the next
        end = min(begin + steps * k_add, n_points)
        _choose(points, buckets, mean, covariance, noise, k_add, chosen[:end], begin)
        if on_progress:
            on_progress(end - begin)
        begin = end
    return chosen


class _Points(NamedTuple):
    """The points in an order that puts neighbours near each other."""

    phi: Floats  # (L, N): transposed, so that loops over points read contiguous memory
    y: Floats  # (N,)
    order: Ints  # (N,): indices in the input
    free: Flags  # (N,): false for chosen points
    score: Floats  # (N,): s when the point's bucket was last scanned


class _Buckets(NamedTuple):
    """G runs of consecutive points of equal length: the g-th holds the points from N g // G to N (g + 1) // G."""

    lower: Floats  # (G, L): the bounding boxes of the features
    upper: Floats
    scanned: Ints  # (G,): number of chosen points when the bucket was last scanned
    mean: Floats  # (G, L): mean of the weights at that time
    above: Floats  # (G,): largest sd + y - mu of its free points then
    below: Floats  # (G,): largest sd + mu - y
    bound: Floats  # (G,): upper bound of the scores of its free points now
    best: Ints  # (G,): the point whose score this is, right after a scan


def _buckets(count: int, phi: Floats) -> _Buckets:
    """Return `count` buckets of the features, (L, N), that have not been scanned."""
    starts = np.arange(count) * phi.shape[1] // count
    return _Buckets(
        lower=np.ascontiguousarray(np.minimum.reduceat(phi, starts, axis=1).T),
        upper=np.ascontiguousarray(np.maximum.reduceat(phi, starts, axis=1).T),
        scanned=np.full(count, -1),
        mean=np.zeros((count, len(phi))),
        above=np.full(count, np.inf),
        below=np.full(count, np.inf),
        bound=np.full(count, np.inf),
        best=np.zeros(count, dtype=np.int64),
    )


@kernel
def _choose(points, buckets, mean, covariance, noise, k_add, chosen, begin):
    """Fill `chosen`, (M,), from `begin` on; `mean` is (L,), `covariance` (L, L); both are updated."""
    batch = np.empty(k_add, dtype=np.int64)
    for now in range(begin, len(chosen), k_add):
        due = min(k_add, len(chosen) - now)
        for b in range(due):
            g = _bucket_of_best(points, buckets, mean, covariance, now)
            pick = buckets.best[g]
            batch[b], chosen[now + b] = pick, points.order[pick]
            points.free[pick] = False  # R <- P - P_simp
            _find_best(g, points, buckets)
        for pick in batch[:due]:
            _observe(points.phi[:, pick].copy(), points.y[pick], noise, mean, covariance)
        _bound_all(buckets, mean)


@kernel(fastmath={"contract", "reassoc", "nsz"})
def _observe(phi, y, noise, mean, covariance):
    """Update `mean`, (L,), and `covariance`, (L, L), with one observation at a point of features `phi`, (L,)."""
    # Loops in place of BLAS, whose rounding depends on the number of threads.
    along = np.empty(len(phi), dtype=np.float64)
    spread, error = noise, y
    for row in range(len(phi)):
        total = 0.0
        for c in range(len(phi)):
            total += covariance[row, c] * phi[c]
        along[row] = total
        spread += phi[row] * total
        error -= phi[row] * mean[row]
    for row in range(len(phi)):
        mean[row] += along[row] * (error / spread)
        scaled = along[row] / spread
        for c in range(len(phi)):
            covariance[row, c] -= along[c] * scaled


@kernel
def _bucket_of_best(points, buckets, mean, covariance, now):
    """Scan each bucket that might hold the best point; return the one that does. `mean` (L,), `covariance` (L, L)."""
    bound, scanned, best, order = buckets.bound, buckets.scanned, buckets.best, points.order
    highest = int(np.argmax(bound))
    if scanned[highest] != now:
        _scan(highest, points, buckets, mean, covariance, now)
    for g in range(len(bound)):
        if bound[g] >= bound[highest]:
            if scanned[g] != now:
                _scan(g, points, buckets, mean, covariance, now)
            if bound[g] > bound[highest] or (bound[g] == bound[highest] and order[best[g]] < order[best[highest]]):
                highest = g
    return highest


@kernel(fastmath={"contract", "reassoc", "nsz"})
def _scan(g, points, buckets, mean, covariance, now):
    """Compute the scores of a bucket's points and find the best; `mean` is (L,), `covariance` (L, L)."""
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
        score[i] = sd + abs(error[i])  # s <- sqrt(diag Sigma_t) + |mu_t - y|
        if free[i]:
            above = max(above, sd - error[i])
            below = max(below, sd + error[i])
    buckets.above[g], buckets.below[g] = above, below
    buckets.mean[g] = mean
    buckets.scanned[g] = now
    _find_best(g, points, buckets)


@kernel(fastmath=False)
def _find_best(g, points, buckets):
    """Find the free point of largest score in a bucket that was just scanned; ties go to the smallest index."""
    n, count, order = len(points.y), len(buckets.bound), points.order
    best, highest = -1, -np.inf
    for i in range(n * g // count, n * (g + 1) // count):
        score = points.score[i]
        if points.free[i] and (score > highest or (score == highest and order[i] < order[best])):
            best, highest = i, score
    buckets.best[g], buckets.bound[g] = best, highest


@kernel(fastmath={"contract", "reassoc", "nsz"})
def _bound_all(buckets, mean):
    """Update the upper bounds of all buckets' scores from the change of the weights' mean, (L,), since their scans."""
    lower, upper, seen, bound = buckets.lower, buckets.upper, buckets.mean, buckets.bound
    for g in range(len(bound)):
        fall = rise = 0.0
        for c in range(len(mean)):
            step = mean[c] - seen[g, c]
            a, b = lower[g, c] * step, upper[g, c] * step
            fall += min(a, b)
            rise += max(a, b)
        bound[g] = max(buckets.above[g] - fall, buckets.below[g] + rise)
        if bound[g] > -np.inf:
            bound[g] += 1e-12 * abs(bound[g])  # well above the rounding errors of a step
