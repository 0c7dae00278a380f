"""The quadric that best fits the points around a place (Cazals and Pouget 2005)."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range
from gppcs.spatial.nearest import WIDER, look_around, search_for, steps_to_nearest
from gppcs.surface.moments import MOMENTS, flattest, moments_in_ball, tangents

COEFFICIENTS = 6  # of a + b u + c v + d u^2 + e u v + f v^2
TERMS = COEFFICIENTS + 2  # what they multiply, the height, and the weight
RIDGE = 1e-8  # keeps the equations solvable where points lie on a line or a conic
TASKS = 256  # parts of the work that threads take in turn
STEEPEST = 3.0  # squared slope: more than 60 degrees off the plane, the quadric is extended from points to one side


class Quadrics(NamedTuple):
    """Quadrics fitted around m places.

    Attributes
    ----------
    heights : (m,) array
        Height of the quadric above the place, along the quadric's normal.
    normals : (3, m) array
        Unit normal of the quadric under the place; its sign has no meaning.
    reaches : (m,) array
        Distance from the place to the farthest of the fitted points; one where that is zero.
    """

    heights: NDArray[np.float64]
    normals: NDArray[np.float64]
    reaches: NDArray[np.float64]


def fit_quadrics(tree: KdTree, places: KdTree, k: int) -> Quadrics:
    """Fit z = a + b u + c v + d u^2 + e u v + f v^2 to the k points nearest each place (Cazals and Pouget 2005).

    The coordinates u and v lie in the plane fitted to the same points; weights are Gaussian. With fewer than six
    points, or where the quadric is steep, the normal is the plane's.

    Parameters
    ----------
    tree : KdTree
        Over the points that quadrics are fitted to.
    places : KdTree
        Over the m places.
    k : int
        Points of each fit, at most all.

    Returns
    -------
    Quadrics
        In the order of the tree of places.
    """
    m = places.points.shape[1]
    fitted = Quadrics(np.empty(m), np.empty((3, m)), np.empty(m))
    with nb.parallel_chunksize(1):
        _fit_all(
            tree.points, tree.low, tree.high, places.points, places.low, places.high, min(k, len(tree.order)), fitted
        )
    return fitted


@nb.njit(cache=True, parallel=True, nogil=True, fastmath=False)
def _fit_all(points, low, high, places, places_low, places_high, k, fitted):
    leaves = first_leaf(places_low)
    tasks = min(leaves, TASKS)
    for task in nb.prange(tasks):
        search = search_for(k, first_leaf(low))
        squared_radius = 0.0  # the first leaf has no radius to start from; others start from that of the leaf before
        for leaf in range(leaves + leaves * task // tasks, leaves + leaves * (task + 1) // tasks):
            count = look_around(points, low, high, places_low[leaf], places_high[leaf], squared_radius, search)
            begin, end = leaf_range(places.shape[1], leaves, leaf)
            reached = _fit_leaf(points, low, high, places, begin, end, count, squared_radius, search, fitted)
            squared_radius = WIDER * reached / (end - begin)


@nb.njit(cache=True, fastmath=False)
def _fit_leaf(points, low, high, places, begin, end, count, squared_radius, search, fitted):
    """Fit quadrics around the places of a leaf; return the sum of their squared reaches."""
    k, full = len(search.gaps), search.local.shape[1]
    moments = np.empty((MOMENTS, 1), dtype=np.float64)
    terms = np.empty((TERMS, full), dtype=np.float64)
    equations = np.empty((COEFFICIENTS, COEFFICIENTS + 1), dtype=np.float64)
    normal = np.empty(3, dtype=np.float64)
    reached = 0.0
    for i in range(begin, end):
        x, y, z = places[0, i], places[1, i], places[2, i]
        squared = steps_to_nearest(points, low, high, x, y, z, count, squared_radius, search)
        reach = np.sqrt(squared) if squared > 0.0 else 1.0
        moments_in_ball(search.local, full, 0.0, 0.0, 0.0, 2.0 * squared, moments, 0)
        _plane_normal(moments[:, 0], normal)
        height = 0.0
        if k >= COEFFICIENTS:
            u, v = tangents(normal[0], normal[1], normal[2])
            _fill_terms(search.local, k, reach, u, v, normal, terms)
            _fill_equations(terms, equations)
            _solve(equations)
            height = _turn(equations[:, COEFFICIENTS], u, v, normal)
        fitted.heights[i], fitted.reaches[i] = height * reach, reach
        fitted.normals[0, i], fitted.normals[1, i], fitted.normals[2, i] = normal[0], normal[1], normal[2]
        reached += squared
    return reached


@nb.njit(cache=True, fastmath=False)
def _plane_normal(moments, normal):
    """Put the normal of the plane fitted to points of these moments into `normal`."""
    n = moments[0]
    x, y, z = moments[1] / n, moments[2] / n, moments[3] / n
    flattest(
        moments[4] / n - x * x, moments[5] / n - x * y, moments[6] / n - x * z,
        moments[7] / n - y * y, moments[8] / n - y * z, moments[9] / n - z * z, normal,
    )  # fmt: skip


@nb.njit(cache=True, fastmath={"nsz", "arcp", "contract", "reassoc"})
def _fill_terms(local, k, reach, s, t, normal, terms):
    """Fill the rows with u, v, their products, the height and the weight of each point, in units of the reach.

    The weight is exp(-x) of x = u^2 + v^2, by its series, since x is at most 1; zero for what follows the k points.
    """
    ones, us, vs, uus, uvs, vvs, heights, weights = terms
    steps_x, steps_y, steps_z = local
    for j in range(len(weights)):
        inside = j < k
        x, y, z = (
            steps_x[j] / reach if inside else 0.0, steps_y[j] / reach if inside else 0.0,
            steps_z[j] / reach if inside else 0.0,
        )  # fmt: skip
        u, v = s[0] * x + s[1] * y + s[2] * z, t[0] * x + t[1] * y + t[2] * z
        ones[j], us[j], vs[j], uus[j], uvs[j], vvs[j] = 1.0, u, v, u * u, u * v, v * v
        heights[j] = normal[0] * x + normal[1] * y + normal[2] * z
        squared = u * u + v * v
        weight = 1.0
        for power in range(17, 0, -1):
            weight = 1.0 - squared * weight * (1.0 / power)
        weights[j] = weight if inside else 0.0


@nb.njit(cache=True, fastmath={"nsz", "arcp", "contract", "reassoc"})
def _fill_equations(terms, equations):
    """Fill the upper triangle of the normal equations of weighted least squares, and their right side."""
    weights = terms[TERMS - 1]
    for a in range(COEFFICIENTS):
        of_a = terms[a]
        for b in range(a, COEFFICIENTS + 1):
            of_b, total = terms[b], 0.0
            for j in range(len(weights)):
                total += weights[j] * of_a[j] * of_b[j]
            equations[a, b] = total
        equations[a, a] += RIDGE


@nb.njit(cache=True, fastmath=False)
def _turn(coefficients, s, t, normal):
    """Replace the plane's normal by that of the quadric at the origin, and return the quadric's distance from there."""
    height, b, c = coefficients[0], coefficients[1], coefficients[2]
    if b * b + c * c > STEEPEST:
        return height
    length = np.sqrt(1.0 + b * b + c * c)
    for axis in range(3):
        normal[axis] = (normal[axis] - b * s[axis] - c * t[axis]) / length
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
