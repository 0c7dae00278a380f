"""The quadric that best fits the points around a place (Cazals and Pouget 2005)."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.covariance import flattest, tangents
from gppcs.kdtree import KdTree, first_leaf
from gppcs.nearest import WIDER, look_around, search_for, steps_to_nearest

COEFFICIENTS = 6  # of a + b u + c v + d u^2 + e u v + f v^2
RIDGE = 1e-8  # keeps the equations solvable where points lie on a line or a conic
TASKS = 256  # parts of the work that threads take in turn
STEEPEST = 3.0  # squared slope: more than 60 degrees off the plane, the quadric is extended from points to one side


class Quadrics(NamedTuple):
    """Quadrics fitted around places.

    Attributes
    ----------
    heights : (m,) array
        Of the quadric over the place, along its normal.
    normals : (m, 3) array
        The quadric's unit normal under the place, without a sign that means anything.
    reaches : (m,) array
        Distance from the place to the farthest of the points; one where that is zero.
    """

    heights: NDArray[np.float64]
    normals: NDArray[np.float64]
    reaches: NDArray[np.float64]


def fit_quadrics(tree: KdTree, places: NDArray[np.float64], k: int) -> Quadrics:
    """Fit z = a + b u + c v + d u^2 + e u v + f v^2 to the k points of a tree nearest each place, (m, 3).

    u and v lie in the plane fitted to the same points, whose weights are Gaussian. With fewer than six points, or where
    the quadric stands steep, the normal is the plane's.
    """
    k = min(k, len(tree.order))
    of_places = KdTree.build(places)
    fitted = Quadrics(np.empty(len(places)), np.empty((len(places), 3)), np.empty(len(places)))
    with nb.parallel_chunksize(1):
        _fit_all(
            tree.points,
            tree.low,
            tree.high,
            of_places.points,
            of_places.order,
            of_places.low,
            of_places.high,
            k,
            fitted,
        )
    return fitted


@nb.njit(cache=True, parallel=True, nogil=True, fastmath=False)
def _fit_all(points, low, high, places, order, places_low, places_high, k, fitted):
    leaves = first_leaf(places_low)
    tasks = min(leaves, TASKS)
    for task in nb.prange(tasks):
        search, local = search_for(k), np.empty((3, k), dtype=np.float64)
        squared_radius = (
            0.0  # at first each searches by itself; then within a radius that held those of the leaf before
        )
        for leaf in range(leaves + leaves * task // tasks, leaves + leaves * (task + 1) // tasks):
            count = look_around(points, low, high, places_low[leaf], places_high[leaf], squared_radius, search)
            begin, end = len(order) * (leaf - leaves) // leaves, len(order) * (leaf - leaves + 1) // leaves
            reached = _fit_leaf(
                points, low, high, places, order, begin, end, count, squared_radius, search, local, fitted
            )
            squared_radius = WIDER * reached / (end - begin)


@nb.njit(cache=True, fastmath=False)
def _fit_leaf(points, low, high, places, order, begin, end, count, squared_radius, search, local, fitted):
    """Fit quadrics around the places of a leaf; return the sum of their squared reaches."""
    reached = 0.0
    for i in range(begin, end):
        x, y, z = places[0, i], places[1, i], places[2, i]
        squared = steps_to_nearest(points, low, high, x, y, z, count, squared_radius, search)
        reach = np.sqrt(squared) if squared > 0.0 else 1.0
        for axis in range(3):
            for slot in range(local.shape[1]):
                local[axis, slot] = search.local[axis, slot] / reach
        index = order[i]
        normal = fitted.normals[index]
        _plane_normal(local, normal)
        height = _height_and_normal(local, normal) if local.shape[1] >= COEFFICIENTS else 0.0
        fitted.heights[index], fitted.reaches[index] = height * reach, reach
        reached += squared
    return reached


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
