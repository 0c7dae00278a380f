"""Denoising: where the surface lies most probably, by all observed points (Eqs. (11) to (13)).

Around each point, the height over its tangent plane is a quadric whose coefficients have a Gaussian prior. The point
goes along its normal to the mean of the posterior, and the normal turns to that of the posterior. As points and normals
change what observations are worth, the step is repeated.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.spatial.kdtree import KdTree, nearest_in_tree
from gppcs.spatial.leaves import leaves_of_runs, look_around_leaf, on_leaves, radius_of_nearest, search_for
from gppcs.surface.moments import tangents
from gppcs.surface.noise import FEWEST, NEIGHBOURS, NoiseLayer, projections
from gppcs.surface.quadrics import COEFFICIENTS, TERMS, fill_equations, solve

MIN_POINTS, MANY_POINTS = 60, 120  # k, the points of a fit: at least, and at most without thick noise.


class Denoised(NamedTuple):
    """Where n points go."""

    points: Floats  # (n, 3)
    normals: Floats  # (n, 3), unit normals, whose signs have no meaning
    trusted: Flags  # (n,), whether the point was denoised and enough observations agree on it

    def take(self, indices: Ints) -> Denoised:
        """Return those of some points. Shapes: indices (m,)."""
        return Denoised(self.points[indices], self.normals[indices], self.trusted[indices])


def denoised(tree: KdTree, n_points: int, required: Ints) -> Denoised:
    """Return where the n points of a tree lie on the surface that they observe; they stay where there is no noise.

    If that leaves at least 16 for each of `n_points`, 4 where the noise is thick, only some points are denoised, and
    those that are required, whose positions in the tree are (m,).
    """
    n = len(tree.order)
    k, noisy = neighbourhood(tree)
    step_max, step_max_thick = n // (16 * n_points), n // (4 * n_points)
    thick = k > MANY_POINTS
    step = max(1, min(k // MIN_POINTS, step_max_thick)) if thick else 1
    # With more rounds, weights follow the noise of the normals; where the noise is thick, the second does so.
    rounds = 1 if thick else 2 if noisy else 0
    feet, normals = _first_feet(tree, k, step)
    on_surface = feet if noisy else tree.points
    selected, total_weight = np.zeros(n, dtype=bool), np.ones(n)
    selected[:: max(step, step_max)] = True
    selected[required] = True
    for _ in range(rounds):
        new, turned, total_weight = _round(KdTree.over(on_surface), normals, tree.points, k, selected)
        on_surface, normals = np.where(selected, new, on_surface), np.where(selected, turned, normals)
    result = Denoised(np.empty((n, 3)), np.empty((n, 3)), np.empty(n, dtype=bool))
    result.points[tree.order], result.normals[tree.order] = on_surface.T, normals.T
    # Where the weights sum up to less than a quarter of the median, the variance of the posterior is large.
    is_trusted = selected & (total_weight >= 0.25 * np.median(total_weight[selected]))
    result.trusted[tree.order] = is_trusted if noisy else True
    return result


def _first_feet(tree: KdTree, k: int, step: int) -> tuple[Floats, Floats]:
    """Return feet and normals, (3, n), by a quadric at each `step`-th point, and its tangent plane up to the next."""
    feet, fitted = projections(tree, tree.thinned(step), k)
    if step == 1:
        return feet, fitted.normals
    owners = np.arange(len(tree.order)) // step
    normals = np.ascontiguousarray(fitted.normals[:, owners])
    above = ((tree.points - feet[:, owners]) * normals).sum(axis=0)
    return tree.points - above * normals, normals


def neighbourhood(tree: KdTree) -> tuple[int, bool]:
    """Return k, to how many points a quadric is fitted, and whether there is any noise, which is not detail."""
    n, k = len(tree.order), NEIGHBOURS
    if n < FEWEST:
        return n, False
    sampled = tree.thinned(-(-n // 1024))

    @cache
    def fit(k: int) -> tuple[Floats, NoiseLayer]:
        feet, fitted = projections(tree, sampled, k)
        return feet, NoiseLayer.about(fitted)

    feet, layer = fit(k)
    if not layer.is_thick() and layer.is_detail(fit(2 * k)[1]):
        return min(k, n), False
    while 2 * k <= min(480, n):
        thick = layer.is_thick()
        if k >= MANY_POINTS and not thick:
            break
        moved = ((fit(2 * k)[0] - feet) ** 2).sum(axis=0).mean()
        # Noise alone makes about 2.5 of its variances over k; much more shows that more points cut off detail.
        if MIN_POINTS <= k < MANY_POINTS and not thick and moved > 6.0 * layer.sigma**2 / k:
            break
        k *= 2
        feet, layer = fit(k)
    return min(k, n), layer.sigma > 0.0


def _round(tree: KdTree, normals: Floats, observed: Floats, k: int, selected: Flags) -> tuple[Floats, Floats, Floats]:
    """Return new points and normals of those selected, and the sums of the weights, by the last tree."""
    new, turned, total_weight = np.empty_like(observed), np.empty_like(observed), np.ones(observed.shape[1])
    on_leaves(_denoise_leaves, tree, tree, normals, observed, k, selected, new, turned, total_weight)
    return new, turned, total_weight


@kernel(fastmath=False)
def _denoise_leaves(first, last, runs, tree, queries, normals, observed, k, selected, new, turned, total_weight):
    """Fill the selected new points and normals, (3, n), and the sums of the weights, (n,), in a range of runs."""
    points, lower, upper = tree
    search, mean = search_for(k, tree), 0.0
    near = np.empty(len(search.buffer.positions), dtype=np.int64)
    terms = np.zeros((TERMS, search.local.shape[1]), dtype=np.float64)
    equations = np.empty((COEFFICIENTS, COEFFICIENTS + 1), dtype=np.float64)
    for leaf in range(*leaves_of_runs(first, last, runs, queries)):
        begin, end, count, squared_radius = look_around_leaf(tree, queries, leaf, runs, mean, search, True)
        total, number = 0.0, 0
        for i in range(begin, end):
            if selected[i]:
                squared = _find_near(points, lower, upper, i, count, squared_radius, search, near)
                _denoise(
                    i, near[:k], np.sqrt(squared), points, normals, observed, terms, equations, new, turned,
                    total_weight,
                )  # fmt: skip
                total, number = total + squared, number + 1
        mean = total / number if number else mean


@kernel(fastmath=False)
def _find_near(points, lower, upper, i, count, squared_radius, search, near):
    """Fill `near` with the k points nearest to point i, and return the squared distance of the farthest."""
    k, x, y, z = len(search.gaps), points[0, i], points[1, i], points[2, i]
    radius = radius_of_nearest(search.buffer.packed, count, x, y, z, k, squared_radius, search.squared)
    if radius < 0.0:
        nearest_in_tree(points, lower, upper, x, y, z, search.positions, search.gaps)
        near[:k] = search.positions
        return search.gaps[-1]
    slot, farthest = 0, 0.0
    for j in range(count):
        # Always written and then counted or not: a branch would be mispredicted.
        near[slot] = search.buffer.positions[j]
        slot += 1 if search.squared[j] <= radius else 0
    for j in near[:k]:
        farthest = max(farthest, (points[0, j] - x) ** 2 + (points[1, j] - y) ** 2 + (points[2, j] - z) ** 2)
    return farthest


@kernel(fastmath=False)
def _denoise(i, near, radius, points, normals, observed, terms, equations, new, turned, total_weight):
    """Move point i to the posterior mean by the observations near it, and turn its normal (Eq. (13))."""
    x, y, z = points[0, i], points[1, i], points[2, i]
    p, q, r = normals[0, i], normals[1, i], normals[2, i]
    for axis in range(3):
        new[axis, i], turned[axis, i] = points[axis, i], normals[axis, i]
    if radius == 0.0:
        return
    s, t = tangents(p, q, r)
    _fill_terms(near, x, y, z, p, q, r, s, t, radius, points, normals, observed, terms)
    fill_equations(terms, equations)
    total_weight[i] = equations[0, 0]
    for a in range(3, COEFFICIENTS):
        equations[a, a] += 4.0  # tau^2 / Lambda (Eq. (11)): half a standard deviation of the noise at the radius
    solve(equations)
    height = radius * min(max(equations[0, COEFFICIENTS], -1.0), 1.0)
    b, c = equations[1, COEFFICIENTS], equations[2, COEFFICIENTS]
    length = np.sqrt(1.0 + b * b + c * c)
    for axis in range(3):
        new[axis, i] += height * normals[axis, i]
        turned[axis, i] = (normals[axis, i] - b * s[axis] - c * t[axis]) / length


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"})
def _fill_terms(near, x, y, z, p, q, r, s, t, radius, points, normals, observed, terms):
    """Fill `terms`, (TERMS, full), from the observations: in units of the radius, and their weights (Eq. (12))."""
    ones, us, vs, uus, uvs, vvs, heights, weights = terms
    along = 1.0 / radius
    for slot in range(len(near)):
        j = near[slot]
        cosine = abs(p * normals[0, j] + q * normals[1, j] + r * normals[2, j])
        a, b, c = points[0, j] - x, points[1, j] - y, points[2, j] - z
        weights[slot] = (a * a + b * b + c * c) * along * along + (1.0 - cosine) / 0.1
        a, b, c = observed[0, j] - x, observed[1, j] - y, observed[2, j] - z
        us[slot], vs[slot] = (s[0] * a + s[1] * b + s[2] * c) * along, (t[0] * a + t[1] * b + t[2] * c) * along
        heights[slot] = (p * a + q * b + r * c) * along
    for slot in range(len(near)):
        u, v = us[slot], vs[slot]
        ones[slot], uus[slot], uvs[slot], vvs[slot] = 1.0, u * u, u * v, v * v
        part = weights[slot] / 16.0  # the exponential is that of a sixteenth, by its series, to the power of 16
        weight = 1.0 - part * (1.0 - part / 2.0 * (1.0 - part / 3.0 * (1.0 - part / 4.0 * (1.0 - part / 5.0))))
        weight *= weight
        weight *= weight
        weight *= weight
        weights[slot] = weight * weight
