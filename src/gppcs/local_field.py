"""A full-rank Matérn field on the surface: distances in it, and which chosen points a point is conditioned on.

The kernel is not truncated, as the paper's is: Matérn of smoothness 5/2, whose lengthscale is about the spacing of the
points to be chosen and varies with the place (Paciorek and Schervish 2004), over a distance that takes positions and
normals together. A point is conditioned on the nearest few chosen ones, which screen off the others (Vecchia 1988;
Datta et al. 2016).
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.kdtree import KdTree, nearest_in_tree

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


@nb.njit(cache=True, error_model="numpy", fastmath=False)
def field_distance(dx, dy, dz, cosine, s, r, normal_weight):
    """Return |x - x'|^2 / ((s^2 + s'^2) / 2) + beta^2 (1 - (n . n')^2), a squared distance of points with normals.

    The second term is half the squared distance between the projections n n^T and n' n'^T, so that the sign of a
    normal has no influence. Where s is the same everywhere, the whole is Euclidean, in nine dimensions.
    """
    across = normal_weight * normal_weight * max(0.0, 1.0 - cosine * cosine)
    return (dx * dx + dy * dy + dz * dz) / (0.5 * (s * s + r * r)) + across


@nb.njit(cache=True, error_model="numpy", fastmath=False)
def squared_distance(field, i, j):
    """Return the squared distance in the field between two points."""
    p, n, s = field.positions, field.normals, field.spacings
    cosine = n[0, i] * n[0, j] + n[1, i] * n[1, j] + n[2, i] * n[2, j]
    return field_distance(
        p[0, i] - p[0, j], p[1, i] - p[1, j], p[2, i] - p[2, j], cosine, s[i], s[j], field.normal_weight
    )


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
