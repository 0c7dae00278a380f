"""The local surface of a cloud: around each point, the triangles of a local Delaunay triangulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Floats
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import QUERIES_AT_ONCE, KdTree, limit_beside, nearest_in_tree
from gppcs.spatial.leaves import (
    WIDER,
    leaves_of_runs,
    look_around,
    look_around_leaf,
    on_leaves,
    radius_of_nearest,
    search_for,
    sort_nearest,
)
from gppcs.spatial.scaling import widen
from gppcs.spatial.triangles import (
    area_vector,
    circumradius,
    cross,
    dot,
    minus,
    nearest_in_triangle,
    row,
    squared_distance,
    unit,
)
from gppcs.surface.fans import ANY_NORMAL, lay_out, wrap
from gppcs.surface.surface_variation import features_of_nearest

PLANE_NEIGHBOURS = 12  # points that a tangent plane is fitted to, with the point itself
# Neighbours that are searched for corners; twice as many, again and again up to the second number, if necessary.
FAN_NEIGHBOURS, MAX_FAN_NEIGHBOURS = 18, 288
AROUND = 4.0  # squared radius of a search for twice as many: this times the squared distance to the last neighbour
MAX_TRIANGLES = 16  # most triangles of a fan; the mean is six
BOUNDED = 8  # triangles of a fan, at its start, whose distances are bounded before they are computed
MARGIN = 1e-9  # of these bounds, in squared lengths
FANS = 64  # whose planes are kept
QUERIES_PER_SEARCH, MANY_POINTS = 32, 256  # queries share a search of the tree, unless it finds so many points
SIN_MAX_SLOPE = np.sin(np.radians(60.0))  # a neighbour steeper above the tangent plane lies on another sheet


class Feet(NamedTuple):
    """Where a surface is nearest to queries: a triangle of its fans, and the nearest of its points, in tree order."""

    distances: Floats  # (Q,), to the triangle
    corners: NDArray[np.int32]  # (Q, 3), of the triangle
    weights: Floats  # (Q, 2), of the second and the third corner
    nearest: NDArray[np.int32]  # (Q,), the nearest point
    squared: Floats  # (Q,), the squared distance to that


@dataclass(frozen=True)
class LocalSurface:
    """The points of a cloud and, around each, a fan of triangles to its neighbours, laid out in its tangent plane.

    The fan is that of the Delaunay triangulation of the layout. More neighbours are searched while it is open or a
    circle through its corners reaches beyond them. Fans need not agree; if they do, they triangulate a surface.
    """

    tree: KdTree  # The tree over the points, which are distinct
    normals: Floats  # (M, 3), unit normals of the tangent planes, in tree order
    corners: NDArray[np.int32]  # (M, MAX_TRIANGLES, 2), the other corners of each point's triangles; -1 after the last

    @classmethod
    def from_points(cls, points: Floats) -> LocalSurface:
        """Build the surface of a cloud. Shapes: points (M, 3)."""
        return cls.over(KdTree.build(points))

    @classmethod
    def over(cls, tree: KdTree) -> LocalSurface:
        """Build the surface of the points of a tree."""
        normals = features_of_nearest(tree.in_own_order(), PLANE_NEIGHBOURS).normals
        corners = np.empty((len(normals), MAX_TRIANGLES, 2), dtype=np.int32)
        on_leaves(_build_fans, tree, tree, normals, corners)
        return cls(tree, normals, corners)

    def nearest_to(self, queries: Floats) -> tuple[Floats, Floats]:
        """Return distances, (Q,), and normals, (Q, 3), of the surface for queries, (Q, 3), by the nearest fans."""
        feet = self.find(queries)
        return feet.distances, self.normals_at(feet)

    def normals_at(self, feet: Feet) -> Floats:
        """Return normals, (Q, 3), interpolated in the triangles."""
        n = len(feet.corners)
        normals = np.empty((n, 3))
        on_ranges(_interpolate, n, self.normals, feet.corners, feet.weights, normals, minimum=QUERIES_AT_ONCE)
        return normals

    def values_at(self, queries: Floats, values: Floats) -> Floats:
        """Return values, (M, k), interpolated linearly in the triangle nearest to each query, (Q, 3); (Q, k)."""
        feet = self.find(queries)
        a, b, c = (values[self.tree.order[corner]] for corner in feet.corners.T)
        v, w = feet.weights.T[..., np.newaxis]
        return a + v * (b - a) + w * (c - a)

    def find(self, queries: Floats) -> Feet:
        """Find the nearest triangle and the nearest point of each query, (Q, 3): soonest if each is near the last."""
        n = len(queries)
        corners, nearest = np.empty((n, 3), dtype=np.int32), np.empty(n, dtype=np.int32)
        feet = Feet(np.empty(n), corners, np.empty((n, 2)), nearest, np.empty(n))
        on_ranges(_search, n, *self.tree.arrays, self.corners, queries, feet, minimum=QUERIES_AT_ONCE)
        return feet


@kernel
def _build_fans(first, last, runs, tree, queries, normals, corners):
    """Fill `corners`, (M, MAX_TRIANGLES, 2), of the points in a range of runs, by normals, (M, 3), in tree order."""
    points, lower, upper = tree
    n, mean = points.shape[1], 0.0
    k, largest = min(FAN_NEIGHBOURS + 1, n), min(MAX_FAN_NEIGHBOURS + 1, n)
    search, wide, here = search_for(k, tree), search_for(largest, tree), np.empty(3, dtype=np.float64)
    near = np.empty(largest + 1, dtype=np.int64)
    inverse, index = np.empty((largest, 2), dtype=np.float64), np.empty(largest, dtype=np.int64)
    for leaf in range(*leaves_of_runs(first, last, runs, queries)):
        begin, end, count, squared_radius = look_around_leaf(tree, queries, leaf, runs, mean, search)
        total = 0.0
        for i in range(begin, end):
            here[0], here[1], here[2], used = points[0, i], points[1, i], points[2, i], k
            farthest = _find_nearest(points, lower, upper, here, k, count, squared_radius, search, near)
            total += farthest
            while not _is_fan(points, normals, i, near[:used], farthest, inverse, index, corners[i]):
                if used == largest:
                    break
                used, radius = min(2 * used - 1, largest), AROUND * farthest  # twice as many, and the point itself
                around = look_around(points, lower, upper, here, here, radius, wide)
                farthest = _find_nearest(points, lower, upper, here, used, around, radius, wide, near)
        mean = total / (end - begin)


@kernel(allocates=False)
def _find_nearest(points, lower, upper, here, k, count, squared_radius, search, near):
    """Fill `near` with the k nearest points, of a shared search if that is wide enough; return the largest distance."""
    x, y, z = here
    radius = radius_of_nearest(search.buffer.packed, count, x, y, z, k, squared_radius, search.squared)
    if radius >= 0.0:
        return _select(search.buffer.positions, search.squared[:count], radius, near)
    nearest_in_tree(points, lower, upper, x, y, z, near[:k], search.gaps[:k])
    return search.gaps[k - 1]


@kernel(inline="always")
def _select(positions, squared, radius, near):
    """Fill `near` with the positions, (n,), within a squared radius; return the largest squared distance, of (n,)."""
    slot, farthest = 0, 0.0
    for j in range(len(squared)):
        near[slot] = positions[j]  # always written and then counted or not: a branch would be mispredicted often
        slot += 1 if squared[j] <= radius else 0
        farthest = max(farthest, squared[j] if squared[j] <= radius else 0.0)
    return farthest


@kernel(inline="always")
def _is_fan(points, normals, i, near, farthest, inverse, index, corners):
    """Fill the corners (MAX_TRIANGLES, 2) around point i by neighbours; return whether more would not change them."""
    count = lay_out(points.T, normals, i, near, ANY_NORMAL, SIN_MAX_SLOPE, inverse, index)
    corners[:] = -1
    return wrap(inverse, index, count, i, 0.0, corners) and _widest(points, i, corners) <= np.sqrt(farthest)


@kernel(inline="always")
def _widest(points, i, corners):
    """Return the largest diameter of the circles through the triangles of a fan."""
    widest = 0.0
    for j, m in corners:
        if j >= 0:
            widest = max(widest, 2.0 * circumradius(row(points.T, i), row(points.T, j), row(points.T, m)))
    return widest


@kernel
def _search(begin, end, points, lower, upper, corners, queries, feet):
    """Fill the feet of a range of queries, (Q, 3), on fans with corners, (M, MAX_TRIANGLES, 2)."""
    k = min(5, points.shape[1])  # nearest points whose fans are searched; fewer leave gaps
    search, box, squared_radius = search_for(k, (points, lower, upper)), np.empty((2, 3), dtype=np.float64), 0.0
    search.positions[:] = 0  # for a query without a finite distance
    holders, planes = np.full(FANS, -1, dtype=np.int64), np.empty((FANS, 14, BOUNDED), dtype=np.float64)
    kept = holders, planes, np.empty((k, BOUNDED), dtype=np.float64), np.empty(BOUNDED, dtype=np.float64)
    for first in range(begin, end, QUERIES_PER_SEARCH):
        last, total = min(first + QUERIES_PER_SEARCH, end), 0.0
        box[0], box[1] = np.inf, -np.inf
        widen(queries[first:last], box[0], box[1])
        count = look_around(points, lower, upper, box[0], box[1], squared_radius, search)
        is_bounded = 0 < count <= 3 * QUERIES_PER_SEARCH  # each fan is near several queries
        for q in range(first, last):
            x, y, z = queries[q]
            if not sort_nearest(x, y, z, count if count <= MANY_POINTS else 0, squared_radius, search):
                limit = np.inf
                if q > begin:
                    u, v, w = minus(row(queries, q), row(queries, q - 1))
                    limit = limit_beside(search.gaps[-1], u, v, w)
                nearest_in_tree(points, lower, upper, x, y, z, search.positions, search.gaps, limit)
            total += search.gaps[-1]
            _find_foot(points, corners, q, x, y, z, search, is_bounded, kept, feet)
        squared_radius = WIDER * total / (last - first)


@kernel(allocates=False, forceinline=True)  # so many arguments take longer to pass than to use
def _find_foot(points, corners, q, x, y, z, search, is_bounded, kept, feet):
    """Fill the foot of query q at (x, y, z) on the fans of its nearest points; the planes of some fans are kept."""
    holders, planes, lower, upper = kept
    near, smallest, k = search.positions, search.gaps[0], len(search.gaps)
    first, second, third, v, w, limit = near[0], near[0], near[0], 0.0, 0.0, smallest
    lower[:] = 0.0
    for n in range(k if is_bounded else 0):
        i, fan = near[n], near[n] % FANS
        if holders[fan] != i:
            holders[fan] = i
            _measure(points, corners[i], i, planes[fan])
        _bound(planes[fan], _from(points, i, x, y, z), lower[n], upper)
        for bound in upper:
            limit = min(limit, bound)
    for n in range(k):
        i = near[n]
        for slot in range(MAX_TRIANGLES):
            if slot < BOUNDED and lower[n, slot] > limit:
                continue
            j, m = corners[i, slot]
            if j < 0:
                break
            a, b, c = _from(points, i, x, y, z), _from(points, j, x, y, z), _from(points, m, x, y, z)
            new_v, new_w = nearest_in_triangle(a, b, c)
            d = squared_distance(a, b, c, new_v, new_w)
            if d < smallest:
                smallest, first, second, third, v, w = d, i, j, m, new_v, new_w
                limit = min(limit, d)
    feet.distances[q], feet.nearest[q], feet.squared[q] = np.sqrt(smallest), near[0], search.gaps[0]
    feet.corners[q, 0], feet.corners[q, 1], feet.corners[q, 2] = first, second, third
    feet.weights[q, 0], feet.weights[q, 1] = v, w


@kernel(allocates=False)
def _measure(points, corners, i, planes):
    """Fill `planes`, (14, BOUNDED), of the first triangles of point i, with corners (MAX_TRIANGLES, 2).

    Rows 0 to 2: the unit normal of a triangle; 3 to 11: those of its edges, inwards in its plane; 12: how far the edge
    that is not at i is from i; 13: a margin for rounding.
    """
    planes[:], planes[12] = 0.0, -1e-150  # slivers, whose normals are inexact: beside the point at any distance
    a = row(points.T, i)
    for slot in range(BOUNDED):
        if corners[slot, 0] < 0:
            planes[13, slot] = -np.inf  # no triangle: infinitely far
            continue
        b, c = row(points.T, corners[slot, 0]), row(points.T, corners[slot, 1])
        ab, bc, ca, normal = minus(b, a), minus(c, b), minus(a, c), area_vector(a, b, c)
        squared = dot(ab, ab) + dot(bc, bc) + dot(ca, ca)
        planes[13, slot] = MARGIN * squared
        if dot(normal, normal) > (1e-3 * squared) ** 2:
            normals = unit(normal), unit(cross(normal, ab)), unit(cross(normal, ca)), unit(cross(normal, bc))
            for plane in range(4):
                for axis in range(3):
                    planes[3 * plane + axis, slot] = normals[plane][axis]
            planes[12, slot] = -dot(normals[3], ab)


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def _bound(planes, a, lower, upper):
    """Fill bounds, (BOUNDED,), of squared distances of triangles from the origin, from which `a` leads to theirs."""
    x, y, z = a
    margin = MARGIN * (x * x + y * y + z * z)
    for slot in range(BOUNDED):
        height = planes[0, slot] * x + planes[1, slot] * y + planes[2, slot] * z
        beyond = max(
            planes[3, slot] * x + planes[4, slot] * y + planes[5, slot] * z,
            planes[6, slot] * x + planes[7, slot] * y + planes[8, slot] * z,
            planes[9, slot] * x + planes[10, slot] * y + planes[11, slot] * z - planes[12, slot],
        )
        wide = margin + planes[13, slot]
        lower[slot] = height * height + max(beyond, 0.0) ** 2 - wide
        upper[slot] = height * height + wide if beyond <= 0.0 else np.inf


@kernel
def _from(points, i, x, y, z):
    """Return the vector from (x, y, z) to point i of points (3, M)."""
    return points[0, i] - x, points[1, i] - y, points[2, i] - z


@kernel
def _interpolate(begin, end, normals, corners, weights, result):
    """Fill `result`, (Q, 3), with weighted means of three rows of normals, with the signs that make each longest."""
    for q in range(begin, end):
        a, b, c = normals[corners[q, 0]], normals[corners[q, 1]], normals[corners[q, 2]]
        v, w = weights[q]
        longest = -1.0
        for turned_v in (v, -v):
            for turned_w in (w, -w):
                x, y, z = (
                    (1.0 - v - w) * a[0] + turned_v * b[0] + turned_w * c[0],
                    (1.0 - v - w) * a[1] + turned_v * b[1] + turned_w * c[1],
                    (1.0 - v - w) * a[2] + turned_v * b[2] + turned_w * c[2],
                )
                if x * x + y * y + z * z > longest:
                    longest = x * x + y * y + z * z
                    result[q, 0], result[q, 1], result[q, 2] = x, y, z
