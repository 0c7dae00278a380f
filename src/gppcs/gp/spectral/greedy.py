"""Greedy selection by uncertainty plus error, exact on all points (paper, Algorithm 1; Lalchand and Faul 2018)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.spectral.posterior import posterior

BUCKETS = 8192  # most buckets of points: each step reads all bounds but rescans few buckets; more would be slower
BUCKETS_AT_ONCE = 64  # in a range of a thread, at least
PICKS_PER_CALL = 64  # about as many picks between two scans by all threads, and reports of progress
LANES = 32  # points whose scores are computed side by side
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
    mean has moved by dw, the mean at a point has moved by phi dw, which the bounding box of phi bounds. All threads
    scan the buckets that are likely to be needed, by the last scores. Neighbours should be near each other in the
    arrays; ties go to the smallest `order`. Shapes: phi (N, L), y (N,), initial (k_init,), order (N,); returns (M,).
    """
    chosen = np.empty(n_points, dtype=np.int64)
    chosen[: len(initial)] = initial
    free = np.ones(len(y), dtype=np.bool_)
    free[initial] = False
    order = np.arange(len(y)) if order is None else order
    points = _Points(np.ascontiguousarray(phi.T), y, order, free, np.empty(len(y)))
    k_add = min(k_add, n_points)
    begin, computed = len(initial), 0  # at how many observations the posterior was last computed anew
    while begin < n_points:
        if begin >= REFRESHED * computed:
            # compute mu_t, Sigma_t; later `_observe` updates them
            mean, covariance = posterior(phi[chosen[:begin]], y[chosen[:begin]], noise)
            covariance, computed = np.ascontiguousarray(covariance), begin
            buckets = _buckets(min(BUCKETS, len(y)), points.phi)  # bounds from an earlier posterior need not hold
            likely = last = -np.inf
        steps = max(1, min(PICKS_PER_CALL, REFRESHED * computed - begin) // k_add)
        end = min(begin + steps * k_add, n_points)
        state = points, buckets, mean, covariance
        on_ranges(_scan_likely, len(buckets.bound), *state, begin, likely, minimum=BUCKETS_AT_ONCE)
        before, last = last, _choose(*state, noise, k_add, chosen[:end], begin)
        likely = min(last, 2 * last - before)  # the last score falls by about as much in each call
        if on_progress:
            on_progress(end - begin)
        begin = end
    return chosen


class _Points(NamedTuple):
    """The points in an order that puts neighbours near each other."""

    phi: Floats  # (L, N): transposed, so that loops over points read contiguous memory
    y: Floats  # (N,)
    order: Ints  # (N,): decides ties
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
    begins = phi.shape[1] * np.arange(count) // count
    return _Buckets(
        lower=np.minimum.reduceat(phi, begins, axis=1).T.copy(),
        upper=np.maximum.reduceat(phi, begins, axis=1).T.copy(),
        scanned=np.full(count, -1),
        mean=np.zeros((count, len(phi))),
        above=np.full(count, np.inf),
        below=np.full(count, np.inf),
        bound=np.full(count, np.inf),
        best=np.zeros(count, dtype=np.int64),
    )


@kernel
def _scan_likely(begin, end, points, buckets, mean, covariance, now, likely):
    """Bound the scores of a range of buckets; scan those that may have a score that is likely to be chosen."""
    for g in range(begin, end):
        _bound(g, buckets, mean)
        if buckets.bound[g] >= likely:
            _scan(g, points, buckets, mean, covariance, now)


@kernel
def _choose(points, buckets, mean, covariance, noise, k_add, chosen, begin):
    """Fill `chosen`, (M,), from `begin` on, and return the last score; updates `mean`, (L,), `covariance`, (L, L)."""
    batch, last = np.empty(k_add, dtype=np.int64), np.inf
    for now in range(begin, len(chosen), k_add):
        if now > begin:
            for g in range(len(buckets.bound)):
                _bound(g, buckets, mean)
        due = min(k_add, len(chosen) - now)
        for b in range(due):
            g = _bucket_of_best(points, buckets, mean, covariance, now)
            batch[b], last = buckets.best[g], buckets.bound[g]
            points.free[batch[b]] = False  # R <- P - P_simp
            _find_best(g, points, buckets)
        chosen[now : now + due] = batch[:due]
        for pick in batch[:due]:
            _observe(points.phi[:, pick].copy(), points.y[pick], noise, mean, covariance)
    return last


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
    n, count, features = len(points.y), len(buckets.bound), len(mean)
    # Blocks of two by two: half of the covariance below its diagonal, and copies of the features with one more of zeros
    half = np.zeros((features + 1, features + 1), dtype=np.float64)
    for r in range(features):
        half[r, : r + 1] = covariance[r, : r + 1]
        half[r, r] *= 0.5
    phi = np.zeros((features + 1, LANES), dtype=np.float64)
    error, variance = np.empty(LANES, dtype=np.float64), np.empty(LANES, dtype=np.float64)
    above = below = -np.inf
    for begin in range(n * g // count, n * (g + 1) // count, LANES):
        lanes = min(LANES, n * (g + 1) // count - begin)
        for i in range(lanes):
            error[i] = -points.y[begin + i]
        for r in range(features):
            for i in range(lanes):
                phi[r, i] = points.phi[r, begin + i]
                error[i] += mean[r] * phi[r, i]
        variance[:] = 0.0
        for r in range(0, features, 2):
            for c in range(0, r + 1, 2):
                _add_block(phi[r], phi[r + 1], phi[c], phi[c + 1], half[r : r + 2, c : c + 2], variance)
        for i in range(lanes):
            sd = np.sqrt(max(2.0 * variance[i], 0.0))
            points.score[begin + i] = sd + abs(error[i])  # s <- sqrt(diag Sigma_t) + |mu_t - y|
            if points.free[begin + i]:
                above = max(above, sd - error[i])
                below = max(below, sd + error[i])
    buckets.above[g], buckets.below[g] = above, below
    buckets.mean[g] = mean
    buckets.scanned[g] = now
    _find_best(g, points, buckets)


@kernel(fastmath={"contract", "reassoc", "nsz"}, allocates=False)
def _add_block(a, b, c, d, weights, variance):
    """Add to the variances, (LANES,), the terms of four pairs of features, (LANES,) each, with `weights`, (2, 2)."""
    ac, ad, bc, bd = weights[0, 0], weights[0, 1], weights[1, 0], weights[1, 1]
    for i in range(LANES):
        variance[i] += a[i] * (ac * c[i] + ad * d[i]) + b[i] * (bc * c[i] + bd * d[i])


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


@kernel(fastmath={"contract", "reassoc", "nsz"}, allocates=False)
def _bound(g, buckets, mean):
    """Update the upper bound of a bucket's scores from the change of the weights' mean, (L,), since its scan."""
    fall = rise = 0.0
    for c in range(len(mean)):
        step = mean[c] - buckets.mean[g, c]
        a, b = buckets.lower[g, c] * step, buckets.upper[g, c] * step
        fall += min(a, b)
        rise += max(a, b)
    bound = max(buckets.above[g] - fall, buckets.below[g] + rise)
    # well above the rounding errors of a step
    buckets.bound[g] = bound + 1e-12 * abs(bound) if bound > -np.inf else bound
