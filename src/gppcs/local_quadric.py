"""The quadric that best fits the points around a place (Cazals and Pouget 2005)."""

from __future__ import annotations

import numba as nb
import numpy as np

from gppcs.covariance import flattest, tangents
from gppcs.kdtree import nearest_in_tree

COEFFICIENTS = 6  # of a + b u + c v + d u^2 + e u v + f v^2
RIDGE = 1e-8  # keeps the equations solvable where points lie on a line or a conic
STEEPEST = 3.0  # squared slope: more than 60 degrees off the plane, the quadric is extended from points to one side


@nb.njit(cache=True, fastmath=False)
def fit_quadric(points, low, high, x, y, z, k, normal):
    """Fit z = a + b u + c v + d u^2 + e u v + f v^2 to the k nearest points, over the plane fitted to the same.

    Their weights are Gaussian. The quadric's unit normal under the place (x, y, z) is put into `normal`; with fewer
    than six points, or where the quadric stands steep, it is the plane's.

    Returns
    -------
    height : float
        Of the quadric over the place, in units of `reach`, along its normal.
    reach : float
        Distance to the k-th point; one where that is zero.
    found : (k,) array
        Positions of the points in tree order, nearest first.
    """
    found = np.empty(k, dtype=np.int64)
    squared = np.empty(k, dtype=np.float64)
    nearest_in_tree(points, low, high, x, y, z, found, squared)
    reach = np.sqrt(squared[-1]) if squared[-1] > 0.0 else 1.0
    local = np.empty((3, k), dtype=np.float64)
    for slot in range(k):
        local[0, slot] = (points[0, found[slot]] - x) / reach
        local[1, slot] = (points[1, found[slot]] - y) / reach
        local[2, slot] = (points[2, found[slot]] - z) / reach
    _plane_normal(local, normal)
    height = _height_and_normal(local, normal) if k >= COEFFICIENTS else 0.0
    return height, reach, found


@nb.njit(cache=True, fastmath=False)
def _plane_normal(local, normal):
    x, y, z = local[0] - local[0].mean(), local[1] - local[1].mean(), local[2] - local[2].mean()
    flattest(
        (x * x).mean(), (x * y).mean(), (x * z).mean(), (y * y).mean(), (y * z).mean(), (z * z).mean(), normal
    )  # fmt: skip


@nb.njit(cache=True, fastmath=False)
def _height_and_normal(local, normal):
    """Replace the plane's normal by that of the quadric at the origin, and return the quadric's distance from there."""
    n = normal[0], normal[1], normal[2]
    s, t = tangents(n[0], n[1], n[2])
    equations = np.zeros((COEFFICIENTS, COEFFICIENTS + 1), dtype=np.float64)
    row = np.empty(COEFFICIENTS + 1, dtype=np.float64)
    for j in range(local.shape[1]):
        x, y, z = local[0, j], local[1, j], local[2, j]
        u, v = s[0] * x + s[1] * y + s[2] * z, t[0] * x + t[1] * y + t[2] * z
        row[0], row[1], row[2], row[3], row[4], row[5] = 1.0, u, v, u * u, u * v, v * v
        row[6] = n[0] * x + n[1] * y + n[2] * z
        weight = np.exp(-(u * u + v * v))
        for a in range(COEFFICIENTS):
            for b in range(a, COEFFICIENTS + 1):
                equations[a, b] += weight * row[a] * row[b]
    for a in range(COEFFICIENTS):
        equations[a, a] += RIDGE
    _solve(equations)
    height, b, c = equations[0, 6], equations[1, 6], equations[2, 6]
    if b * b + c * c > STEEPEST:
        return height
    length = np.sqrt(1.0 + b * b + c * c)
    for axis in range(3):
        normal[axis] = (n[axis] - b * s[axis] - c * t[axis]) / length
    return height / length


@nb.njit(cache=True, fastmath=False)
def _solve(equations):
    """Put the solution of n symmetric positive definite equations, (n, n + 1), into the last column.

    By elimination, of which only the upper triangle is kept; such equations need no pivots.
    """
    n = len(equations)
    for a in range(n):
        for b in range(a + 1, n):
            factor = equations[a, b] / equations[a, a]
            for c in range(b, n + 1):
                equations[b, c] -= factor * equations[a, c]
    for a in range(n - 1, -1, -1):
        for b in range(a + 1, n):
            equations[a, n] -= equations[a, b] * equations[b, n]
        equations[a, n] /= equations[a, a]
