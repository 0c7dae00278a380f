"""The kernel: Matérn 5/2 over positions and normals, whose lengthscale varies over the surface (Eqs. (5) and (6)).

The nonstationary form is that of Paciorek and Schervish (2004). The paper truncates its kernel to a series (Eq. 6).
This one has full rank, and its lengthscale is about the target spacing.
"""

import math
from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Floats
from gppcs.engine.kernels import kernel

LANES, STEP = 32, 8  # Points that are computed side by side at most; their number is rounded up to whole steps.
SITE = 9  # Numbers of a site before its k details: position (3), normal (3), desired spacing, y, 1 + variance.
EXPONENTIAL = tuple((-1 / 64) ** n / math.factorial(n) for n in range(10, -1, -1))  # Taylor's, of exp(-t / 64)


class LocalField(NamedTuple):
    """The field at n points: what the kernel needs, and the function to observe."""

    positions: Floats  # (3, n), in units of the target spacing h
    normals: Floats  # (3, n), unit vectors; their sign does not matter
    spacings: Floats  # (n,), s: the desired spacing, in units of h
    y: Floats  # (n,), the function: surface variation, standardised to mean 0 and variance 1
    noise: Floats  # (n,), sigma_y^2: variance of each observation, in units of the prior; positive
    detail: Floats  # (k, n), attributes that count beside the shape, as distances in desired spacings; k may be 0
    lengthscale: float  # kappa, in desired spacings
    normal_weight: float  # beta: the distance of two normals at a right angle, in desired spacings


@kernel(fastmath=False, allocates=False)
def inverse_of_squares(s, r):
    """Return 1 / (s^2 + r^2), bit for bit the same if r and s are exchanged."""
    return 1.0 / (s * s + r * r)


@kernel(fastmath=False, allocates=False)
def field_distance(dx, dy, dz, cosine, s, r, normal_weight):
    """Return the squared distance in the field (Eq. (5)), |x - x'|^2 / ((s^2 + s'^2) / 2) + beta^2 (1 - (n . n')^2)."""
    across = normal_weight * normal_weight * max(0.0, 1.0 - cosine * cosine)
    return (dx * dx + dy * dy + dz * dz) * (2.0 * inverse_of_squares(s, r)) + across


@kernel(fastmath={"contract", "nnan", "nsz", "arcp", "reassoc"}, allocates=False)
def correlate(sites, a, b, lengthscale, normal_weight, lanes, out):
    """Compute the kernel (Eq. (6)) between the a-th and the b-th site of each lane, in units of the prior variance.

    Only so many lanes, a multiple of `STEP`, are computed. Shapes: sites (K + 1, SITE + k, LANES), out (LANES,).
    """
    vanished = 40.0  # from this t on, the correlation is less than rounding
    for p in range(lanes):
        out[p] = 0.0
    for c in range(SITE, sites.shape[1]):  # before the next loop, which is vectorised only without one inside
        for p in range(lanes):
            out[p] += (sites[a, c, p] - sites[b, c, p]) ** 2
    for p in range(lanes):
        s, r = sites[a, 6, p], sites[b, 6, p]
        squared = out[p] + field_distance(
            sites[a, 0, p] - sites[b, 0, p], sites[a, 1, p] - sites[b, 1, p], sites[a, 2, p] - sites[b, 2, p],
            sites[a, 3, p] * sites[b, 3, p] + sites[a, 4, p] * sites[b, 4, p] + sites[a, 5, p] * sites[b, 5, p],
            s, r, normal_weight,
        )  # fmt: skip
        t = np.sqrt(5.0 * squared) / lengthscale
        e = _exponential(min(t, vanished))
        even = 2.0 * s * r * inverse_of_squares(s, r)
        value = even * np.sqrt(even) * (1.0 + t + t * t * (1.0 / 3.0)) * e
        out[p] = value if t < vanished else 0.0


@kernel(fastmath={"contract", "nnan", "nsz", "arcp", "reassoc"}, allocates=False)
def _exponential(t):
    """Return exp(-t): the 64th power of the Taylor polynomial at -t / 64, with an error below 1e-14."""
    e = EXPONENTIAL[0]
    for power in range(1, len(EXPONENTIAL)):
        e = e * t + EXPONENTIAL[power]
    for _ in range(6):
        e *= e
    return e
