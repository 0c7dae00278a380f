"""The surface that a cloud spans by itself: around each point, the triangles of its local Delaunay triangulation."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.kdtree import KdTree, nearest_in_tree
from gppcs.surface.moments import tangents
from gppcs.surface.surface_variation import features_of_nearest

PLANE = 12  # points that the tangent plane is fitted to, the point itself among them
NEIGHBOURS = 30, 240  # of which the corners are found: twice as many as before, until no other could be one
MOST = 16  # triangles of a fan; there are six on average
FANS = 5  # of the nearest points, searched for the nearest triangle; with fewer, a gap here and there
STEEPEST = np.sin(np.radians(60.0))  # a neighbour further out of the tangent plane lies on another sheet


@dataclass(frozen=True)
class LocalSurface:
    """The points and, around each, a fan of triangles to its neighbours.

    A point's neighbours are laid out in its tangent plane, each in its direction and at its true distance; the
    corners of the fan are the point's neighbours in the Delaunay triangulation there. The fans of different
    points need not agree, as in the Laplacian of a cloud; where they do, they are the triangulation of a surface
    that passes through all points.

    The neighbours searched are the 30 nearest or, where the fan is open or a circle through its corners reaches beyond
    these, twice as many, up to 240. Where even these all lie to one side, the fan stays open as on a border.

    Attributes
    ----------
    tree : KdTree
        Over the points, which hold no repeats.
    normals : (M, 3) array, float64
        Of the tangent planes, in tree order.
    corners : (M, MOST, 2) array, int32
        Of each triangle around a point, the two corners beside the point itself; -1 from the end of the fan on.
        Points and corners in tree order.
    """

    tree: KdTree
    normals: NDArray[np.float64]
    corners: NDArray[np.int32]

    @classmethod
    def of(cls, points: NDArray[np.float64]) -> LocalSurface:
        """Build the surface of `points`, (M, 3), without repeats."""
        tree = KdTree.build(points)
        normals = features_of_nearest(tree, PLANE).normals[tree.order]
        corners = np.full((len(points), MOST, 2), -1, dtype=np.int32)
        _build_fans(tree.points, tree.low, tree.high, normals, corners)
        return cls(tree, normals, corners)

    def nearest_to(self, queries: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how far each query, (Q, 3), is from the surface, (Q,), and the surface's normal nearest to it, (Q, 3).

        Searched are the triangles of the nearest points and, where these have none, the nearest point itself. Normals
        are interpolated between the corners of the triangle; they have no sign that means anything.
        """
        distances, normals = np.empty(len(queries)), np.empty((len(queries), 3))
        _search(
            self.tree.points, self.tree.low, self.tree.high, self.normals, self.corners, queries, distances, normals
        )  # fmt: skip
        return distances, normals


@nb.njit(cache=True, parallel=True, nogil=True)
def _build_fans(points, low, high, normals, corners):
    for i in nb.prange(points.shape[1]):
        _build_fan(points, low, high, i, normals[i], corners[i])


@nb.njit(cache=True)
def _build_fan(points, low, high, i, normal, corners):
    """Fill the corners around point i, of as many neighbours as it takes."""
    n = points.shape[1]
    neighbours, most = NEIGHBOURS
    while True:
        k = min(neighbours + 1, n)
        found = np.empty(k, dtype=np.int64)
        squared = np.empty(k, dtype=np.float64)
        nearest_in_tree(points, low, high, points[0, i], points[1, i], points[2, i], found, squared)
        inverse = np.empty((k, 2), dtype=np.float64)
        index = np.empty(k, dtype=np.int64)
        count = _lay_out(points, i, normal, found, squared, inverse, index)
        widest = _fan(inverse[:count], index[:count], corners)
        if widest * widest <= squared[-1] or k == n or neighbours >= most:
            return
        neighbours *= 2


@nb.njit(cache=True)
def _lay_out(points, i, normal, found, squared, inverse, index):
    """Lay the neighbours out in the tangent plane, each divided by its squared distance; return how many there are."""
    u, v = tangents(normal[0], normal[1], normal[2])
    count = 0
    for slot in range(len(found)):
        j = found[slot]
        if j == i or squared[slot] == 0.0:
            continue
        away = _from(points, j, points[0, i], points[1, i], points[2, i])
        a, b = _dot(away, u), _dot(away, v)
        in_plane, distance = np.sqrt(a * a + b * b), np.sqrt(squared[slot])
        if in_plane * in_plane < (1.0 - STEEPEST * STEEPEST) * squared[slot]:
            continue
        inverse[count, 0], inverse[count, 1] = a / (in_plane * distance), b / (in_plane * distance)
        index[count] = j
        count += 1
    return count


@nb.njit(cache=True)
def _fan(inverse, index, corners):
    """Find the triangles at the origin and the diameter of the widest circle around one, infinite for an open fan.

    They are edges of the hull of the inverted neighbours and the origin itself. A circle through the origin is inverted
    to a line, as far from the origin as the inverse of its diameter.

    The bisector between the origin and a neighbour is dual to the neighbour divided by its squared distance, so the
    origin's Voronoi cell is dual to the hull of these. On a border the origin is a corner of the hull.
    """
    n = len(inverse)
    corners[:] = -1
    if n < 2:
        return np.inf
    round_ = _around(inverse)
    hull = np.empty(len(round_), dtype=np.int64)
    height = 0
    for new in round_:
        while height >= 2 and not _turns_left(inverse, hull[height - 2], hull[height - 1], new):
            height -= 1
        hull[height] = new
        height += 1
    triangles, widest = 0, 0.0 if hull[0] < n else np.inf
    for edge in range(height - 1):
        a, b = hull[edge], hull[edge + 1]
        if a < n and b < n and triangles < MOST and _turns_left(inverse, n, a, b):
            corners[triangles, 0], corners[triangles, 1] = index[a], index[b]
            triangles += 1
            widest = max(widest, _diameter(inverse[a], inverse[b]))
    return widest


@nb.njit(cache=True)
def _diameter(a, b):
    """Return the diameter of the circle through the origin whose inverse is the line through a and b."""
    doubled_area = abs(a[0] * b[1] - a[1] * b[0])
    return np.hypot(b[0] - a[0], b[1] - a[1]) / doubled_area if doubled_area > 0.0 else np.inf


@nb.njit(cache=True)
def _around(inverse):
    """Return the neighbours in the order of their directions, from one corner of the hull back to the same.

    That is the origin, numbered n, where half of all directions or more are free; else the nearest neighbour.
    """
    n = len(inverse)
    angles = np.arctan2(inverse[:, 1], inverse[:, 0])
    order = np.argsort(angles, kind="mergesort")
    begin, free = 0, False
    for step in range(n):
        before = angles[order[step - 1]] - (2.0 * np.pi if step == 0 else 0.0)
        if angles[order[step]] - before >= np.pi:
            begin, free = step, True
        elif order[step] == 0 and not free:
            begin = step
    round_ = np.empty(n + 1 + free, dtype=np.int64)
    for step in range(n + 1):
        round_[step + free] = order[(begin + step) % n]
    if free:
        round_[0] = round_[n + 1] = n
    return round_


@nb.njit(cache=True)
def _turns_left(points, a, b, c):
    """Tell whether the way from a over b to c turns left; the number beyond the last point means the origin."""
    ax, ay = (points[a, 0], points[a, 1]) if a < len(points) else (0.0, 0.0)
    bx, by = (points[b, 0], points[b, 1]) if b < len(points) else (0.0, 0.0)
    cx, cy = (points[c, 0], points[c, 1]) if c < len(points) else (0.0, 0.0)
    return (bx - ax) * (cy - by) - (by - ay) * (cx - bx) > 0.0


@nb.njit(cache=True, parallel=True, nogil=True)
def _search(points, low, high, normals, corners, queries, distances, nearest_normals):
    k = min(FANS, points.shape[1])
    for q in nb.prange(len(queries)):
        found = np.empty(k, dtype=np.int64)
        squared = np.empty(k, dtype=np.float64)
        x, y, z = queries[q]
        nearest_in_tree(points, low, high, x, y, z, found, squared)
        least, first, second, third, v, w = squared[0], found[0], found[0], found[0], 0.0, 0.0
        for i in found:
            a = _from(points, i, x, y, z)
            for slot in range(MOST):
                j, m = corners[i, slot]
                if j < 0:
                    break
                b, c = _from(points, j, x, y, z), _from(points, m, x, y, z)
                new_v, new_w = nearest_in_triangle(a, b, c)
                d = _squared(a, b, c, new_v, new_w)
                if d < least:
                    least, first, second, third, v, w = d, i, j, m, new_v, new_w
        distances[q] = np.sqrt(least)
        _interpolate(normals, first, second, third, v, w, nearest_normals[q])


@nb.njit(cache=True)
def _from(points, i, x, y, z):
    return points[0, i] - x, points[1, i] - y, points[2, i] - z


@nb.njit(cache=True)
def _squared(a, b, c, v, w):
    """Return the squared length of a + v (b - a) + w (c - a)."""
    x = a[0] + v * (b[0] - a[0]) + w * (c[0] - a[0])
    y = a[1] + v * (b[1] - a[1]) + w * (c[1] - a[1])
    z = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2])
    return x * x + y * y + z * z


@nb.njit(cache=True)
def _interpolate(normals, first, second, third, v, w, normal):
    """Put the weighted mean of three normals, turned so that it is longest, into `normal`."""
    a, b, c = normals[first], normals[second], normals[third]
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
                normal[0], normal[1], normal[2] = x, y, z


@nb.njit(cache=True)
def nearest_in_triangle(a, b, c):
    """Return v and w for which a + v (b - a) + w (c - a) is the point of a triangle that is nearest to the origin.

    By regions: a corner, a side, or the inside (Ericson, Real-Time Collision Detection, section 5.1.5).
    """
    ab, ac = _minus(b, a), _minus(c, a)
    ab_a, ac_a, ab_b, ac_b, ab_c, ac_c = _dot(ab, a), _dot(ac, a), _dot(ab, b), _dot(ac, b), _dot(ab, c), _dot(ac, c)
    if ab_a >= 0.0 and ac_a >= 0.0:
        return 0.0, 0.0
    if ab_b <= 0.0 and ac_b >= ab_b:
        return 1.0, 0.0
    if ac_c <= 0.0 and ab_c >= ac_c:
        return 0.0, 1.0
    beside_ab, beside_ac, beside_bc = ab_a * ac_b - ab_b * ac_a, ab_c * ac_a - ab_a * ac_c, ab_b * ac_c - ab_c * ac_b
    if beside_ab <= 0.0 and ab_a <= 0.0 <= ab_b:
        return ab_a / (ab_a - ab_b), 0.0
    if beside_ac <= 0.0 and ac_a <= 0.0 <= ac_c:
        return 0.0, ac_a / (ac_a - ac_c)
    if beside_bc <= 0.0 and ab_b >= ac_b and ac_c >= ab_c:
        share = (ab_b - ac_b) / (ab_b - ac_b + ac_c - ab_c)
        return 1.0 - share, share
    area = beside_ab + beside_ac + beside_bc
    return beside_ac / area, beside_ab / area


@nb.njit(cache=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@nb.njit(cache=True)
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
