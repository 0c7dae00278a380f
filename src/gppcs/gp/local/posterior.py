"""Mean and variance of the local field (paper, Eqs. 3 and 4), of as many points at a time as fill vector registers.

All arithmetic runs over LANES points side by side, an operation at a time, so that the compiler makes vectors of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.gp.local.conditioning import Conditioning
from gppcs.gp.local.kernel import LANES, LocalField, correlate

SITE = 9  # numbers that the kernel and the observation need of a point: place, normal, spacing, y, one plus noise
NEGLIGIBLE = 1e-12  # of the prior variance: what is left of a pivot that rounding has used up


class Work(NamedTuple):
    """Room for the posteriors of LANES points, each conditioned on K others.

    Attributes
    ----------
    sites : (K + 1, 9, LANES) array
        What the kernel and the observation need of what each is conditioned on; last, of the point itself.
    factor : (K (K + 2), LANES) array
        Rows of the Cholesky factor, of the inverse of its diagonal, and of its products with two right-hand sides.
    cross, observed, pivot : (LANES,) arrays
        The entries of the current row that belong to the point, to y and to the diagonal.
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


@nb.njit(cache=True)
def workspace(neighbours):
    """Return room for points that are conditioned on K others."""
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


@nb.njit(cache=True, error_model="numpy", fastmath={"contract", "nnan", "nsz", "arcp", "reassoc"})
def posteriors(field, all_sites, nearest, which, begin, end, error_weight, work):
    """Put mean, variance and score at the points `which[begin:end]`, LANES at most, into `work`, given their nearest.

    See `extend` in local_greedy.py for the score.
    """
    neighbours = nearest.shape[1]
    sites, factor, cross, observed, pivot, mean, variance, score = work
    _gather(all_sites, nearest, which, begin, end, sites)
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


@nb.njit(cache=True)
def _gather(all_sites, nearest, which, begin, end, sites):
    """Fill the sites of each lane, of those without a point as of the last; what lacks a neighbour has one far away."""
    neighbours = nearest.shape[1]
    for p in range(LANES):
        i = which[min(begin + p, end - 1)]
        for a in range(neighbours + 1):
            j = nearest[i, a] if a < neighbours else i
            for number in range(SITE):
                sites[a, number, p] = all_sites[j, number] if j >= 0 else 0.0
            if j < 0:
                sites[a, 0, p], sites[a, 6, p], sites[a, 8, p] = (a + 1) / NEGLIGIBLE, 1.0, 1.0


@nb.njit(cache=True, parallel=True, nogil=True)
def sites_of(field):
    """Return what the kernel and the observation need of each point side by side in memory, (n, 9)."""
    n = len(field.y)
    sites = np.empty((n, SITE), dtype=np.float64)
    for i in nb.prange(n):
        for axis in range(3):
            sites[i, axis], sites[i, 3 + axis] = field.positions[axis, i], field.normals[axis, i]
        sites[i, 6], sites[i, 7], sites[i, 8] = field.spacings[i], field.y[i], 1.0 + field.noise[i]
    return sites


class Posterior(NamedTuple):
    """Mean and variance of the field, and the score, at every point."""

    means: NDArray[np.float64]
    variances: NDArray[np.float64]
    scores: NDArray[np.float64]


def posterior(
    field: LocalField, sites: NDArray[np.float64], conditioning: Conditioning, error_weight: float
) -> Posterior:
    """Return the posterior at every point, given what it is conditioned on; (n,) each.

    Parameters
    ----------
    field : LocalField
    sites : (n, 9) array
        That `sites_of` gives.
    conditioning : Conditioning
    error_weight : float
        w, of the error in the score.
    """
    found = Posterior(np.empty(len(sites)), np.empty(len(sites)), np.empty(len(sites)))
    _posterior_everywhere(field, sites, conditioning.nearest, error_weight, *found)
    return found


@nb.njit(cache=True, parallel=True, nogil=True)
def _posterior_everywhere(field, sites, nearest, error_weight, means, variances, scores):
    n = len(sites)
    chunk = 64 * LANES
    for first in nb.prange(-(-n // chunk)):
        work = workspace(nearest.shape[1])
        which = np.arange(first * chunk, min((first + 1) * chunk, n))
        for begin in range(0, len(which), LANES):
            end = min(begin + LANES, len(which))
            posteriors(field, sites, nearest, which, begin, end, error_weight, work)
            means[which[begin] : which[end - 1] + 1] = work.mean[: end - begin]
            variances[which[begin] : which[end - 1] + 1] = work.variance[: end - begin]
            scores[which[begin] : which[end - 1] + 1] = work.score[: end - begin]
