"""Quadrics fitted to the points around queries by weighted least squares (Cazals and Pouget 2005)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.leaves import leaves_of_runs, look_around_leaf, on_leaves, search_for, steps_to_nearest
from gppcs.spatial.triangles import dot
from gppcs.surface.moments import MOMENTS, flattest_of, moments_in_ball, tangents

COEFFICIENTS = 6  # Those of a + b u + c v + d u^2 + e u v + f v^2.
TWO_PEAKS = 1.7  # Kurtosis of residuals below which these are two sheets: those have 1, a uniform layer 1.8, noise 3.
RIM = 0.3  # Distance of the middle of points from the query along their plane, in radii: at a rim it is 0.42.
TERMS = COEFFICIENTS + 2  # For each point: 1, u, v, u^2, u v, v^2, its height and its weight.


class Quadrics(NamedTuple):
    """Quadrics fitted around m queries."""

    heights: Floats  # (m,), signed distance from the query to the quadric, along its normal, to first order
    normals: Floats  # (3, m), unit normal of the quadric at the query; its sign has no meaning
    radii: Floats  # (m,), distance from the middle of the fit to the farthest of its points; 1 where that is zero
    kurtosis: Floats  # (m,), of the residuals of its points, which tells two sheets from noise; (0,) if not wanted

    @property
    def two_sheets(self) -> Flags:
        """Whether the points of each fit lie on two sheets, (m,): below `TWO_PEAKS`, also if `sheets` was larger."""
        two_sheets: Flags = self.kurtosis < TWO_PEAKS
        return two_sheets

    def take(self, positions: Ints) -> Quadrics:
        """Return those around some of the queries."""
        kurtosis = self.kurtosis[positions] if len(self.kurtosis) else self.kurtosis
        return Quadrics(self.heights[positions], self.normals.take(positions, axis=1), self.radii[positions], kurtosis)

    def astype(self, dtype: DTypeLike) -> Quadrics:
        """Return them in another precision."""
        return Quadrics(*(part.astype(dtype) for part in self))


def fit_quadrics(tree: KdTree, queries: KdTree, k: int, shared: float = 0.0, sheets: float = 0.0) -> Quadrics:
    """Fit z = a + b u + c v + d u^2 + e u v + f v^2 to the k points nearest each query, over their plane.

    Queries of a leaf within `shared` radii of a fit take its quadric; with 0, each has its own. Where it is steep, or
    there are fewer than six points, the normal is the plane's. Where the kurtosis of the residuals is below `sheets`,
    points lie on two sheets, and the quadric is that of the query's own; if more than `TWO_PEAKS`, not at rims.
    """
    m = queries.points.shape[1]
    fitted = Quadrics(np.empty(m), np.empty((3, m)), np.empty(m), np.empty(m if sheets else 0))
    on_leaves(_fit_leaves, tree, queries, min(k, len(tree.order)), shared, sheets, fitted)
    return fitted


@kernel(fastmath=False)
def _fit_leaves(first, last, runs, tree, queries, k, shared, sheets, fitted):
    """Fill `fitted` at the queries, (3, m), of a range of runs."""
    points, lower, upper = tree
    of_queries, search, mean = queries[0], search_for(k, tree), 0.0
    scratch = (
        np.empty((MOMENTS, 1), dtype=np.float64), np.empty((TERMS, search.local.shape[1]), dtype=np.float64),
        np.empty((COEFFICIENTS, COEFFICIENTS + 1), dtype=np.float64), np.empty(3, dtype=np.float64),
    )  # fmt: skip
    for leaf in range(*leaves_of_runs(first, last, runs, queries)):
        begin, end, count, squared_radius = look_around_leaf(tree, queries, leaf, runs, mean, search)
        fitted.radii[begin:end] = 0.0
        total = 0.0
        for i in range(begin, end):
            if fitted.radii[i] > 0.0:
                continue
            x, y, z = of_queries[0, i], of_queries[1, i], of_queries[2, i]
            squared = steps_to_nearest(points, lower, upper, x, y, z, count, squared_radius, search)
            last_query = end if shared else i + 1
            total += squared * _fit(of_queries, i, last_query, squared, shared, sheets, search, scratch, fitted)
        mean = total / (end - begin)


@kernel(inline="always")
def _fit(queries, centre, end, squared, shared, sheets, search, scratch, fitted):
    """Fit a quadric to the nearest points of a query, of (3, m); return for how many up to `end` it is taken."""
    k, full = len(search.gaps), search.local.shape[1]
    moments, terms, equations, normal = scratch
    radius = np.sqrt(squared) if squared > 0.0 else 1.0
    moments_in_ball(search.local, full, 0.0, 0.0, 0.0, 2.0 * squared, moments, 0)
    flattest_of(moments[:, 0], normal)
    u, v = tangents(normal[0], normal[1], normal[2])
    if k >= COEFFICIENTS:
        _fill_terms(search.local, k, radius, u, v, normal, terms)
        fill_equations(terms, equations)
        solve(equations)
    kurtosis = np.inf
    if sheets and k >= COEFFICIENTS and (sheets <= TWO_PEAKS or _aside(moments, normal) <= RIM * radius):
        kurtosis = _fit_own_sheet(terms, equations, sheets)
        end = centre + 1 if kurtosis < sheets else end  # others may lie on the other sheet
    count = 0
    for i in range(centre, end):
        x, y, z = (
            (queries[0, i] - queries[0, centre]) / radius, (queries[1, i] - queries[1, centre]) / radius,
            (queries[2, i] - queries[2, centre]) / radius,
        )  # fmt: skip
        if i > centre and (squared == 0.0 or fitted.radii[i] > 0.0 or x * x + y * y + z * z > shared * shared):
            continue
        height = 0.0
        fitted.normals[0, i], fitted.normals[1, i], fitted.normals[2, i] = normal[0], normal[1], normal[2]
        if k >= COEFFICIENTS:
            height = _turn(equations[:, COEFFICIENTS], (x, y, z), u, v, fitted.normals[:, i])
        fitted.heights[i], fitted.radii[i] = height * radius, radius
        if sheets:
            fitted.kurtosis[i] = kurtosis
        count += 1
    return count


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"})
def _fill_terms(local, k, radius, s, t, normal, terms):
    """Fill `terms`, (TERMS, full), from steps to the k nearest, in units of the radius; weights are exp(-u^2 - v^2)."""
    a, b, c = normal[0], normal[1], normal[2]  # with views of the rows or of the normal, the loop is not vectorised
    for j in range(terms.shape[1]):
        inside = j < k
        x, y, z = (
            local[0, j] / radius if inside else 0.0, local[1, j] / radius if inside else 0.0,
            local[2, j] / radius if inside else 0.0,
        )  # fmt: skip
        u, v = s[0] * x + s[1] * y + s[2] * z, t[0] * x + t[1] * y + t[2] * z
        terms[0, j], terms[1, j], terms[2, j], terms[3, j], terms[4, j], terms[5, j] = 1.0, u, v, u * u, u * v, v * v
        terms[6, j] = a * x + b * y + c * z
        squared = u * u + v * v
        weight = 1.0
        for power in range(17, 0, -1):
            weight = 1.0 - squared * weight * (1.0 / power)
        terms[7, j] = weight if inside else 0.0


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"})
def fill_equations(terms, equations):
    """Fill the upper triangle of the normal equations, (6, 7), whose last column is the right-hand side."""
    weights = terms[TERMS - 1]
    for a in range(COEFFICIENTS):
        of_a = terms[a]
        for b in range(a, COEFFICIENTS + 1):
            of_b, total = terms[b], 0.0
            for j in range(len(weights)):
                total += weights[j] * of_a[j] * of_b[j]
            equations[a, b] = total
        equations[a, a] += 1e-8  # solvable if the points lie on a line or a conic


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"})
def _fit_own_sheet(terms, equations, sheets):
    """Return the kurtosis of the residuals of a fit; where it is small, fit the points on the query's side."""
    a, b, c, d, e, f = equations[:, COEFFICIENTS]
    total = second = fourth = 0.0
    for j in range(terms.shape[1]):
        fit = a + b * terms[1, j] + c * terms[2, j] + d * terms[3, j] + e * terms[4, j] + f * terms[5, j]
        weight, squared = terms[7, j], (terms[6, j] - fit) ** 2
        total += weight
        second += weight * squared
        fourth += weight * squared * squared
    kurtosis = total * fourth / (second * second) if second > 0.0 else np.inf
    if kurtosis < sheets:
        for j in range(terms.shape[1]):
            fit = a + b * terms[1, j] + c * terms[2, j] + d * terms[3, j] + e * terms[4, j] + f * terms[5, j]
            terms[7, j] *= (terms[6, j] - fit) * a < 0.0  # the query lies at -a
        fill_equations(terms, equations)
        solve(equations)
    return kurtosis


@kernel(inline="always")
def _aside(moments, normal):
    """Return how far the middle of points is from the query along their plane, by their moments, (10, 1)."""
    x, y, z = moments[1, 0] / moments[0, 0], moments[2, 0] / moments[0, 0], moments[3, 0] / moments[0, 0]
    height = x * normal[0] + y * normal[1] + z * normal[2]
    return np.sqrt(max(0.0, x * x + y * y + z * z - height * height))


@kernel(inline="always")
def _turn(coefficients, step, s, t, normal):
    """Turn the plane's normal, (3,), into the quadric's below a step; return the distance to the quadric along it."""
    u, v = dot(step, s), dot(step, t)
    height = -(step[0] * normal[0] + step[1] * normal[1] + step[2] * normal[2])
    height += coefficients[0] + u * (coefficients[1] + u * coefficients[3] + v * coefficients[4])
    height += v * (coefficients[2] + v * coefficients[5])
    b = coefficients[1] + 2.0 * u * coefficients[3] + v * coefficients[4]
    c = coefficients[2] + u * coefficients[4] + 2.0 * v * coefficients[5]
    if b * b + c * c > 3.0:  # 60 degrees: a steeper quadric extrapolates from points on one side only
        return height
    length = np.sqrt(1.0 + b * b + c * c)
    for axis in range(3):
        normal[axis] = (normal[axis] - b * s[axis] - c * t[axis]) / length
    return height / length


@kernel(inline="always")
def solve(equations):
    """Solve symmetric positive definite equations, (n, n + 1), in place, without pivots; see the last column."""
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
