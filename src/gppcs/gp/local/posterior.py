"""Posterior mean and variance of the local field (paper, Eqs. 3 and 4), by a Cholesky factorisation for each point.

All arithmetic runs over LANES points side by side, one operation at a time, so that the compiler can vectorise it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.conditioning import Conditioning
from gppcs.gp.local.kernel import LANES, LocalField, correlate

POINTS_AT_ONCE = 1024  # Points that a thread takes at once, at least.
SITE = 9  # Numbers of a site: position (3), normal (3), desired spacing, y, 1 + variance of the observation.
NEGLIGIBLE = 1e-12  # Least pivot of the factorisation, in units of the prior variance: less is only rounding.


class Work(NamedTuple):
    """Memory for the posteriors of LANES points, each conditioned on K others.

    Attributes
    ----------
    sites : (K + 1, 9, LANES) array
        Sites of the K points on which each point is conditioned; the last row is the point itself.
    factor : (K (K + 2), LANES) array
        K rows of the Cholesky factor, with the inverse of its diagonal. Each row ends with two solutions of the
        triangular system: for the covariances with the point, and for y.
    cross, observed, pivot : (LANES,) arrays
        The current row: covariance with the point, y, and diagonal.
    mean, variance, score : (LANES,) arrays
        The results.
    """

    sites: NDArray[np.float64]
    factor: NDArray[np.float64]
    cross: NDArray[np.float64]
    observed: NDArray[np.float64]
    pivot: NDArray[np.float64]
    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    score: NDArray[np.float64]


@kernel
def workspace(neighbours):
    """Return memory for posteriors."""
    return Work(
        np.empty((neighbours + 1, SITE, LANES), dtype=np.float64),
        np.empty((neighbours * (neighbours + 2), LANES), dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
    )


@kernel(fastmath={"contract", "nnan", "nsz", "arcp", "reassoc"}, allocates=False)
def posteriors(field, nearest, which, begin, end, error_weight, work):
    """Compute mean, variance and score at the points `which[begin:end]`.

    `gppcs.gp.local.greedy.extend` defines the score.

    Shapes: nearest (n, K), which (count,).
    """
    neighbours = nearest.shape[1]
    sites, factor, cross, observed, pivot, mean, variance, score = work
    _gather(field, nearest, which, begin, end, sites)
    for p in range(LANES):
        mean[p], variance[p] = 0.0, 1.0
    for a in range(neighbours):
        of_a = a * (neighbours + 2)
        correlate(sites, a, neighbours, field.lengthscale, field.normal_weight, cross)
        for p in range(LANES):
            observed[p], pivot[p] = sites[a, 7, p], sites[a, 8, p]
        for b in range(a):
            of_b = b * (neighbours + 2)
            correlate(sites, a, b, field.lengthscale, field.normal_weight, factor[of_a + b])
            for c in range(b):
                for p in range(LANES):
                    factor[of_a + b, p] -= factor[of_a + c, p] * factor[of_b + c, p]
            for p in range(LANES):
                entry = factor[of_a + b, p] * factor[of_b + b, p]
                factor[of_a + b, p] = entry
                cross[p] -= entry * factor[of_b + neighbours, p]
                observed[p] -= entry * factor[of_b + neighbours + 1, p]
                pivot[p] -= entry * entry
        for p in range(LANES):
            inverse = 1.0 / np.sqrt(max(pivot[p], NEGLIGIBLE))
            of_point, of_y = cross[p] * inverse, observed[p] * inverse
            factor[of_a + a, p] = inverse
            factor[of_a + neighbours, p], factor[of_a + neighbours + 1, p] = of_point, of_y
            variance[p] -= of_point * of_point
            mean[p] += of_point * of_y
    for p in range(LANES):
        variance[p] = max(variance[p], 0.0)
        gain = variance[p] / (variance[p] + (sites[neighbours, 8, p] - 1.0))
        score[p] = np.sqrt(gain * variance[p]) + error_weight * gain * abs(mean[p] - sites[neighbours, 7, p])


@kernel(allocates=False)
def _gather(field, nearest, which, begin, end, sites):
    """Copy what the kernel and the observation need of each point into lanes, (K + 1, 9, LANES).

    The last point fills lanes that are left over. A neighbour that is lacking is placed far away.
    """
    neighbours = nearest.shape[1]
    for p in range(LANES):
        i = which[min(begin + p, end - 1)]
        for a in range(neighbours + 1):
            j = nearest[i, a] if a < neighbours else i
            if j < 0:
                sites[a, :, p] = 0.0
                sites[a, 0, p], sites[a, 6, p], sites[a, 8, p] = (a + 1) / NEGLIGIBLE, 1.0, 1.0
                continue
            for axis in range(3):
                sites[a, axis, p], sites[a, 3 + axis, p] = field.positions[axis, j], field.normals[axis, j]
            sites[a, 6, p], sites[a, 7, p], sites[a, 8, p] = field.spacings[j], field.y[j], 1.0 + field.noise[j]


class Posterior(NamedTuple):
    """Mean and variance of the field, and the score, at every point; (n,) each."""

    means: NDArray[np.float64]
    variances: NDArray[np.float64]
    scores: NDArray[np.float64]


def posterior(field: LocalField, conditioning: Conditioning, error_weight: float) -> Posterior:
    """Return the posterior at every point."""
    n = len(field.y)
    found = Posterior(np.empty(n), np.empty(n), np.empty(n))
    on_ranges(
        _posterior_everywhere, n, field, conditioning.nearest, error_weight, *found, least=POINTS_AT_ONCE
    )  # fmt: skip
    return found


@kernel
def _posterior_everywhere(begin, end, field, nearest, error_weight, means, variances, scores):
    """Fill the entries `begin` to `end` of the results, (n,) each, given nearest, (n, K)."""
    work = workspace(nearest.shape[1])
    which = np.arange(begin, end)
    for some in range(0, len(which), LANES):
        count = min(LANES, len(which) - some)
        posteriors(field, nearest, which, some, some + count, error_weight, work)
        for p in range(count):
            i = begin + some + p
            means[i], variances[i], scores[i] = work.mean[p], work.variance[p], work.score[p]
