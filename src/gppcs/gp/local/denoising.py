"""Denoising: the places where the surface lies most probably, given all observed points.

Around each point, the surface is a Gaussian process over its tangent plane: the height is a quadric whose coefficients
have a Gaussian prior, and each point nearby observes it with Gaussian noise. The point goes along its normal to the
mean of the posterior, and the normal turns to that of the posterior. Observations are worth less with the distance and
with the angle between the normals, so no face smooths another across an edge. As places and normals change what
observations are worth, the step is repeated. research/local-field.md has the equations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range, nearest_in_tree
from gppcs.spatial.nearest import TASKS, WIDER, look_around, reach_of_nearest, search_for
from gppcs.surface.moments import tangents
from gppcs.surface.noise import FEWEST, NEIGHBOURS, SAMPLES, THICK, Layer, is_detail, projections
from gppcs.surface.quadrics import COEFFICIENTS, TERMS, fill_equations, solve

LEAST, MANY, WIDEST = 60, 120, 480  # Points that tell a place: at least, at most without thick noise, and with it.
LAYER = 0.33  # Noise above this, in radii of the neighbourhood, is thick: more points are taken.
# Mean squared distance between the feet on quadrics of k and of 2 k points, in variances of the noise over k, above
# which more points cut off detail. Noise alone makes about 2.5.
UNBIASED = 6.0
FEW, PLENTY = 4, 16  # Least points denoised for each kept one: with thick noise, and otherwise.
# Prior standard deviation of each curvature: of the height that it makes at the reach, in standard deviations of the
# noise.
CURVATURE = 0.5
ROUNDS = 2  # With more, weights follow the noise of the normals; where the noise is thick, the second does so.
TURN = 0.1  # An observation whose normal is off by 1 - cos = TURN is worth 1 / e of what it would be.
LEAST_WORTH = 0.25  # Places of which observations tell less than this share of the median are not trusted.


class Denoised(NamedTuple):
    """Where n points go."""

    places: NDArray[np.float64]  # (n, 3)
    normals: NDArray[np.float64]  # (n, 3), unit normals, whose signs have no meaning
    trusted: NDArray[np.bool_]  # (n,), whether the point was denoised and enough observations agree on its place

    def take(self, rows: NDArray[np.int64]) -> Denoised:
        """Return those of some points. Shapes: rows (m,)."""
        return Denoised(self.places[rows], self.normals[rows], self.trusted[rows])


def denoised(points: NDArray[np.float64], n_points: int) -> Denoised:
    """Return the places of points, (n, 3), on the surface that they observe; they stay where there is no noise.

    Where that is enough to keep `n_points`, only some points in tree order are denoised, given all observations. The
    others keep their feet on quadrics or, where the noise is thick, on the tangent planes of these.
    """
    tree = KdTree.build(points)
    k, noisy = neighbourhood(tree)
    plenty, few = len(points) // (PLENTY * n_points), len(points) // (FEW * n_points)
    thick = k > MANY
    apart, rounds = max(1, min(k // LEAST, few)) if thick else 1, 1 if thick else ROUNDS if noisy else 0
    feet, normals = _first_places(tree, k, apart)
    places = feet if noisy else tree.points
    wanted, worth = np.zeros(len(points), dtype=bool), np.ones(len(points))
    wanted[:: max(apart, plenty)] = True
    for _ in range(rounds):
        new, turned, worth = _round(KdTree.over(places), normals, tree.points, k, wanted)
        places, normals = np.where(wanted, new, places), np.where(wanted, turned, normals)
    result = Denoised(np.empty_like(points), np.empty_like(points), np.empty(len(points), dtype=bool))
    result.places[tree.order], result.normals[tree.order] = places.T, normals.T
    result.trusted[tree.order] = wanted & (worth >= LEAST_WORTH * np.median(worth[wanted])) if noisy else True
    return result


def _first_places(tree: KdTree, k: int, step: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return feet and normals, (3, n), by a quadric at each `step`-th point, whose tangent plane serves up to the next.

    Points that follow each other in tree order are near each other, so the plane differs little from their own.
    """
    some = tree.thinned(step)
    feet, fitted = projections(tree, some, k)
    if step == 1:
        return feet, fitted.normals
    owners = np.arange(len(tree.order)) // step
    normals = np.ascontiguousarray(fitted.normals[:, owners])
    above = ((tree.points - feet[:, owners]) * normals).sum(axis=0)
    return tree.points - above * normals, normals


def neighbourhood(tree: KdTree) -> tuple[int, bool]:
    """Return how many points tell a place, and whether there is any noise, which is not detail of the surface."""
    n, k = len(tree.order), NEIGHBOURS
    if n < FEWEST:
        return n, False
    some = tree.thinned(-(-n // (SAMPLES // 4)))
    feet, fitted = projections(tree, some, k)
    layer = Layer.between(some.points, feet, fitted)
    wider, fitted = projections(tree, some, 2 * k)
    if layer.level <= THICK * layer.radius and is_detail(layer, Layer.between(some.points, wider, fitted)):
        return min(k, n), False
    while 2 * k <= min(WIDEST, n):
        thick = layer.level > LAYER * layer.radius
        if k >= MANY and not thick:
            break
        if k > NEIGHBOURS:
            wider, fitted = projections(tree, some, 2 * k)
        if LEAST <= k < MANY and not thick and ((wider - feet) ** 2).sum(axis=0).mean() > UNBIASED * layer.level**2 / k:
            break
        k, feet, layer = 2 * k, wider, Layer.between(some.points, wider, fitted)
    return min(k, n), layer.level > 0.0


def _round(
    tree: KdTree, normals: NDArray[np.float64], observed: NDArray[np.float64], k: int, wanted: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return new places and normals where wanted, and what told them in all, given the tree over the places so far."""
    new, turned, worth = np.empty_like(observed), np.empty_like(observed), np.ones(observed.shape[1])
    tasks = min(tree.leaves, TASKS)
    on_ranges(
        _denoise_leaves, tasks, tasks, tree.points, tree.low, tree.high, normals, observed, k, wanted, new, turned,
        worth,
    )  # fmt: skip
    return new, turned, worth


@kernel(fastmath=False)
def _denoise_leaves(first, last, tasks, places, low, high, normals, observed, k, wanted, new, turned, worth):
    """Fill the wanted new places and normals, (3, n), and their worth, (n,), in a range of tasks."""
    leaves = first_leaf(low)
    search = search_for(k, leaves)
    near = np.empty(len(search.room.found), dtype=np.int64)
    terms = np.zeros((TERMS, search.local.shape[1]), dtype=np.float64)
    equations = np.empty((COEFFICIENTS, COEFFICIENTS + 1), dtype=np.float64)
    for task in range(first, last):
        squared_radius = 0.0  # in the first leaf, each place searches by itself; others start from the leaf before
        for leaf in range(leaves + leaves * task // tasks, leaves + leaves * (task + 1) // tasks):
            begin, end = leaf_range(places.shape[1], leaves, leaf)
            if not wanted[begin:end].any():
                continue
            count = look_around(places, low, high, low[leaf], high[leaf], squared_radius, search)
            reached, number = 0.0, 0
            for i in range(begin, end):
                if wanted[i]:
                    squared = _find_near(places, low, high, i, count, squared_radius, search, near)
                    _denoise(
                        i, near[:k], np.sqrt(squared), places, normals, observed, terms, equations, new, turned, worth
                    )
                    reached, number = reached + squared, number + 1
            squared_radius = WIDER * reached / number


@kernel(fastmath=False)
def _find_near(places, low, high, i, count, squared_radius, search, near):
    """Fill `near` with the k places nearest to place i, and return the squared distance of the farthest."""
    k, x, y, z = len(search.gaps), places[0, i], places[1, i], places[2, i]
    reach = reach_of_nearest(search.room.packed, count, x, y, z, k, squared_radius, search.squared)
    if reach < 0.0:
        nearest_in_tree(places, low, high, x, y, z, search.positions, search.gaps)
        near[:k] = search.positions
        return search.gaps[-1]
    slot, farthest = 0, 0.0
    for j in range(count):
        near[slot] = search.room.found[j]  # always written and then counted or not: a branch would be mispredicted
        slot += 1 if search.squared[j] <= reach else 0
    for j in near[:k]:
        farthest = max(farthest, (places[0, j] - x) ** 2 + (places[1, j] - y) ** 2 + (places[2, j] - z) ** 2)
    return farthest


@kernel(fastmath=False)
def _denoise(i, near, reach, places, normals, observed, terms, equations, new, turned, worth):
    """Move place i to the posterior mean, given the observations near it, and turn its normal; see the module."""
    x, y, z = places[0, i], places[1, i], places[2, i]
    p, q, r = normals[0, i], normals[1, i], normals[2, i]
    for axis in range(3):
        new[axis, i], turned[axis, i] = places[axis, i], normals[axis, i]
    if reach == 0.0:
        return
    s, t = tangents(p, q, r)
    _fill_terms(near, x, y, z, p, q, r, s, t, reach, places, normals, observed, terms)
    fill_equations(terms, equations)
    worth[i] = equations[0, 0]
    for a in range(3, COEFFICIENTS):
        equations[a, a] += 1.0 / CURVATURE**2
    solve(equations)
    height = reach * min(max(equations[0, COEFFICIENTS], -1.0), 1.0)
    b, c = equations[1, COEFFICIENTS], equations[2, COEFFICIENTS]
    length = np.sqrt(1.0 + b * b + c * c)
    for axis in range(3):
        new[axis, i] += height * normals[axis, i]
        turned[axis, i] = (normals[axis, i] - b * s[axis] - c * t[axis]) / length


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"})
def _fill_terms(near, x, y, z, p, q, r, s, t, reach, places, normals, observed, terms):
    """Fill `terms`, (TERMS, full), from the observations: in units of the reach, and their weights."""
    ones, us, vs, uus, uvs, vvs, heights, weights = terms
    along = 1.0 / reach
    for slot in range(len(near)):
        j = near[slot]
        cosine = abs(p * normals[0, j] + q * normals[1, j] + r * normals[2, j])
        a, b, c = places[0, j] - x, places[1, j] - y, places[2, j] - z
        weights[slot] = (a * a + b * b + c * c) * along * along + (1.0 - cosine) / TURN
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
