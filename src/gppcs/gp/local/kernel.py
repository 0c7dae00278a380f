"""The kernel: Matérn 5/2 whose lengthscale varies with the place, over positions and normals together.

It is not truncated, as the paper's is (Eq. 6): its lengthscale is about the spacing of the points to be chosen, and
varies with the place (Paciorek and Schervish 2004).
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

LANES = 16
VANISHED = 40.0  # lengthscales, times sqrt(5), beyond which a correlation is less than rounding


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


@nb.njit(cache=True, error_model="numpy", fastmath=False)
def field_distance(dx, dy, dz, cosine, s, r, normal_weight):
    """Return |x - x'|^2 / ((s^2 + s'^2) / 2) + beta^2 (1 - (n . n')^2), a squared distance of points with normals.

    The second term is half the squared distance between the projections n n^T and n' n'^T, so that the sign of a
    normal has no influence. Where s is the same everywhere, the whole is Euclidean, in nine dimensions.
    """
    across = normal_weight * normal_weight * max(0.0, 1.0 - cosine * cosine)
    return (dx * dx + dy * dy + dz * dz) / (0.5 * (s * s + r * r)) + across


@nb.njit(cache=True, error_model="numpy", fastmath={"contract", "nnan", "nsz", "arcp", "reassoc"})
def correlate(sites, a, b, lengthscale, normal_weight, out):
    """Fill `out` with the kernel between the a-th and b-th sites of each lane, in units of the prior variance.

    (2 s s' / (s^2 + s'^2))^(3/2) (1 + t + t^2 / 3) exp(-t) with t = sqrt(5) distance / lengthscale; the factor in front
    keeps it positive definite where s varies. The exponential is the 64th power of its Taylor polynomial at -t / 64,
    whose relative error is below 1e-12.
    """
    for p in range(LANES):
        s, r = sites[a, 6, p], sites[b, 6, p]
        squared = field_distance(
            sites[a, 0, p] - sites[b, 0, p], sites[a, 1, p] - sites[b, 1, p], sites[a, 2, p] - sites[b, 2, p],
            sites[a, 3, p] * sites[b, 3, p] + sites[a, 4, p] * sites[b, 4, p] + sites[a, 5, p] * sites[b, 5, p],
            s, r, normal_weight,
        )  # fmt: skip
        t = np.sqrt(5.0 * squared) / lengthscale
        x = min(t, VANISHED) / -64.0
        e = 1.0 + x * (1.0 / 13.0)
        e = 1.0 + x * e * (1.0 / 12.0)
        e = 1.0 + x * e * (1.0 / 11.0)
        e = 1.0 + x * e * (1.0 / 10.0)
        e = 1.0 + x * e * (1.0 / 9.0)
        e = 1.0 + x * e * (1.0 / 8.0)
        e = 1.0 + x * e * (1.0 / 7.0)
        e = 1.0 + x * e * (1.0 / 6.0)
        e = 1.0 + x * e * (1.0 / 5.0)
        e = 1.0 + x * e * (1.0 / 4.0)
        e = 1.0 + x * e * (1.0 / 3.0)
        e = 1.0 + x * e * (1.0 / 2.0)
        e = 1.0 + x * e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        even = 2.0 * s * r / (s * s + r * r)
        value = even * np.sqrt(even) * (1.0 + t + t * t * (1.0 / 3.0)) * e
        out[p] = value if t < VANISHED else 0.0
