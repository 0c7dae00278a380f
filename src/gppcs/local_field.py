"""A full-rank Matérn field on the surface, whose posterior at a point needs only the chosen points near it.

The paper's posterior (Eqs. 3 and 4) with a kernel that is not truncated: Matérn of smoothness 5/2, whose lengthscale is
about the spacing of the points to be chosen and varies with the place (Paciorek and Schervish 2004), over a distance
that takes positions and normals together. A point is conditioned on the nearest few chosen ones, which screen off the
others (Vecchia 1988; Datta et al. 2016).
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.kdtree import KdTree, nearest_in_tree

NEGLIGIBLE = 1e-12  # of the prior variance: what is left of a pivot that rounding has used up
SURPLUS = 2  # times as many neighbours by position are looked at as are kept by the field's distance


class LocalField(NamedTuple):
    """The field at n points: what its kernel depends on, and the function observed there.

    Attributes
    ----------
    positions : (3, n) array
        In units of the target spacing h.
    normals : (3, n) array
        Unit vectors; their sign does not matter.
    spacings : (n,) array
        s: the spacing that the place deserves, in units of h; the lengthscale there is `lengthscale` s h.
    y : (n,) array
        The function modelled, of zero mean and about unit variance.
    noise : (n,) array
        The variance of what is observed at each point, in units of the prior variance; positive.
    lengthscale : float
        In units of the spacing of the place.
    normal_weight : float
        beta: the distance, in spacings, that a right angle between normals is worth.
    """

    positions: NDArray[np.float64]
    normals: NDArray[np.float64]
    spacings: NDArray[np.float64]
    y: NDArray[np.float64]
    noise: NDArray[np.float64]
    lengthscale: float
    normal_weight: float


class Conditioning(NamedTuple):
    """The chosen points that each point is conditioned on, nearest first.

    Attributes
    ----------
    nearest : (n, K) array, int32
        Positions in the field's order; -1 where fewer are chosen.
    squared : (n, K) array, float64
        Their squared distances in the field; infinite where fewer are chosen.
    """

    nearest: NDArray[np.int32]
    squared: NDArray[np.float64]


@nb.njit(cache=True, fastmath=False)
def squared_distance(field, i, j):
    """Return |x - x'|^2 / ((s^2 + s'^2) / 2) + beta^2 (1 - (n . n')^2), a distance between points with normals.

    The second term is half the squared distance between the projections n n^T and n' n'^T, so that the sign of a
    normal has no influence. Where s is the same everywhere, the whole is Euclidean, in nine dimensions.
    """
    p, n = field.positions, field.normals
    dx, dy, dz = p[0, i] - p[0, j], p[1, i] - p[1, j], p[2, i] - p[2, j]
    cosine = n[0, i] * n[0, j] + n[1, i] * n[1, j] + n[2, i] * n[2, j]
    scale = 0.5 * (field.spacings[i] * field.spacings[i] + field.spacings[j] * field.spacings[j])
    across = field.normal_weight * field.normal_weight * max(0.0, 1.0 - cosine * cosine)
    return (dx * dx + dy * dy + dz * dz) / scale + across


@nb.njit(cache=True, fastmath=False)
def correlation(field, i, j, squared):
    """Return the kernel between two points of that squared distance, in units of the prior variance.

    (2 s s' / (s^2 + s'^2))^(3/2) (1 + a + a^2 / 3) exp(-a) with a = sqrt(5) distance / lengthscale; the factor in front
    keeps it positive definite where s varies.
    """
    s, t = field.spacings[i], field.spacings[j]
    even = 2.0 * s * t / (s * s + t * t)
    a = np.sqrt(5.0 * squared) / field.lengthscale
    return even * np.sqrt(even) * (1.0 + a + a * a / 3.0) * np.exp(-a)


@nb.njit(cache=True, fastmath=False)
def posterior(field, i, nearest, squared, work):
    """Return mean and variance at a point (paper, Eqs. 3 and 4), given the chosen points it is conditioned on.

    `work` is (K, K + 2): the Cholesky factor of their covariance, and two right-hand sides.
    """
    k = len(nearest)
    mean, variance = 0.0, 1.0
    for a in range(k):
        if nearest[a] < 0:
            break
        work[a, k] = correlation(field, i, nearest[a], squared[a])
        work[a, k + 1] = field.y[nearest[a]]
        for b in range(a):
            between = squared_distance(field, nearest[a], nearest[b])
            work[a, b] = correlation(field, nearest[a], nearest[b], between)
            for c in range(b):
                work[a, b] -= work[a, c] * work[b, c]
            work[a, b] /= work[b, b]
        pivot = 1.0 + field.noise[nearest[a]]
        for c in range(a):
            pivot -= work[a, c] * work[a, c]
            work[a, k] -= work[a, c] * work[c, k]
            work[a, k + 1] -= work[a, c] * work[c, k + 1]
        work[a, a] = np.sqrt(max(pivot, NEGLIGIBLE))
        work[a, k] /= work[a, a]
        work[a, k + 1] /= work[a, a]
        variance -= work[a, k] * work[a, k]
        mean += work[a, k] * work[a, k + 1]
    return mean, max(variance, 0.0)


@nb.njit(cache=True, fastmath=False)
def keep_nearest(nearest, squared, j, distance):
    """Put point j among the nearest kept, if it is one of them."""
    slot = len(squared) - 1
    if not distance < squared[slot]:
        return
    while slot > 0 and squared[slot - 1] > distance:
        squared[slot], nearest[slot] = squared[slot - 1], nearest[slot - 1]
        slot -= 1
    squared[slot], nearest[slot] = distance, j


def condition(field: LocalField, chosen: NDArray[np.int64], neighbours: int) -> Conditioning:
    """Return the `neighbours` chosen points nearest each point in the field, of the nearest twice as many in space.

    Parameters
    ----------
    field : LocalField
    chosen : (m,) array
        Positions in the field's order, ascending or not; may be empty.
    neighbours : int
        K.
    """
    n = len(field.y)
    conditioning = Conditioning(np.full((n, neighbours), -1, dtype=np.int32), np.full((n, neighbours), np.inf))
    if len(chosen):
        tree = KdTree.build(np.ascontiguousarray(field.positions[:, chosen].T))
        looked_at = min(SURPLUS * neighbours, len(chosen))
        _condition_all(field, tree.points, tree.low, tree.high, chosen[tree.order], looked_at, conditioning)
    return conditioning


@nb.njit(cache=True, parallel=True, nogil=True, fastmath=False)
def _condition_all(field, points, low, high, chosen, looked_at, conditioning):
    for i in nb.prange(len(field.y)):
        found = np.empty(looked_at, dtype=np.int64)
        gaps = np.empty(looked_at, dtype=np.float64)
        x, y, z = field.positions[:, i]
        nearest_in_tree(points, low, high, x, y, z, found, gaps)
        for slot in range(looked_at):
            j = chosen[found[slot]]
            keep_nearest(conditioning.nearest[i], conditioning.squared[i], j, squared_distance(field, i, j))
