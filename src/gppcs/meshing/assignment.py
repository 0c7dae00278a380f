"""The nearest triangle of each dense point, found by walking over the mesh."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.halfedges import MOST_AROUND, Floats, HalfEdges, Ints, around
from gppcs.spatial.triangles import area_vector, cross, dot, minus, nearest_in_triangle, row, squared_distance

POINTS_AT_ONCE = 1024  # dense points that a thread takes at once, at least
MOST_WALKED = 64  # vertices that a walk visits, at most
ROUNDING = 1e-12  # of the distance between a point and a plane, at most, as clouds are of about unit size


class Assignment(NamedTuple):
    """The nearest triangle of each of N dense points."""

    face: Ints  # (N,): its number; -1 if there is none near the point on its sheet
    squared: Floats  # (N,): the squared distance; 0 without a triangle
    weights: Floats  # (N, 2): barycentric coordinates of the nearest place, for the second and the third corner

    @classmethod
    def of(cls, mesh: HalfEdges, vertices: Floats, points: Floats, normals: Floats, nearest: Ints) -> Self:
        """Walk from a vertex near each point to its nearest triangle."""
        count = len(points)
        found = cls(np.full(count, -1), np.zeros(count), np.zeros((count, 2)))
        size = len(mesh.origin) // 3
        upright, sides = np.zeros((size, 3)), np.zeros((size, 3, 4))
        on_ranges(_fill_planes, size, mesh, vertices, upright, sides, least=POINTS_AT_ONCE)
        ends, fans = np.empty(len(vertices), dtype=np.int64), np.empty(3 * size, dtype=np.int64)
        _list_fans(mesh, np.empty(MOST_AROUND, dtype=np.int64), ends, fans)
        on_ranges(
            _walk_all, count, mesh, vertices, upright, sides, ends, fans, points, normals, nearest, found,
            least=POINTS_AT_ONCE,
        )  # fmt: skip
        return found


@kernel(allocates=False)
def _fill_planes(begin, end, mesh, vertices, upright, sides):
    """Fill the normals of the triangles and the planes along their edges.

    `upright`, (F, 3), are not of unit length; their signs are all that matters. `sides`, (F, 3, 4), are the planes
    through the edges that are upright on the triangle: the unit normal that points outward, and how far out the
    triangle reaches.
    """
    for f in range(begin, end):
        if mesh.origin[3 * f] < 0:
            continue
        corners = (
            row(vertices, mesh.origin[3 * f]), row(vertices, mesh.origin[3 * f + 1]),
            row(vertices, mesh.origin[3 * f + 2]),
        )  # fmt: skip
        normal = area_vector(corners[0], corners[1], corners[2])
        upright[f, 0], upright[f, 1], upright[f, 2] = normal
        for k in range(3):
            outward = cross(minus(corners[(k + 1) % 3], corners[k]), normal)
            length = np.sqrt(dot(outward, outward))
            if length > 0.0:
                outward = outward[0] / length, outward[1] / length, outward[2] / length
            sides[f, k, 0], sides[f, k, 1], sides[f, k, 2] = outward
            sides[f, k, 3] = max(dot(outward, corners[0]), dot(outward, corners[1]), dot(outward, corners[2]))


@kernel(allocates=False)
def _list_fans(mesh, halves, ends, fans):
    """Fill `fans`, (3 F,), with the triangles around each vertex, and `ends`, (V,), with where those of each end."""
    end = 0
    for v in range(len(ends)):
        edges, _ = around(mesh, v, halves)
        for slot in range(edges):
            fans[end] = halves[slot] // 3
            end += 1
        ends[v] = end


@kernel
def _walk_all(begin, end, mesh, vertices, upright, sides, ends, fans, points, normals, nearest, found):
    """Fill `found` at a range of points; other arrays as in `Assignment.of`, `_fill_planes` and `_list_fans`."""
    visited = np.empty(MOST_WALKED, dtype=np.int64)
    _walk(begin, end, mesh, vertices, upright, sides, ends, fans, points, normals, nearest, visited, found)


@kernel(allocates=False)
def _walk(begin, end, mesh, vertices, upright, sides, ends, fans, points, normals, nearest, visited, found):
    """Look around vertices until all three corners of the nearest triangle have been looked at."""
    for i in range(begin, end):
        point, normal, v = row(points, i), row(normals, i), nearest[i]
        least, face, steps, weights = np.inf, -1, 0, (0.0, 0.0)
        while v >= 0 and steps < MOST_WALKED:
            visited[steps] = v
            steps += 1
            for slot in range(ends[v - 1] if v else 0, ends[v]):
                f = fans[slot]
                if f == face or _is_farther(sides, f, point, least) or dot(row(upright, f), normal) <= 0.0:
                    continue
                a, b, c = corners_from(mesh, vertices, f, point)
                s, t = nearest_in_triangle(a, b, c)
                squared = squared_distance(a, b, c, s, t)
                if squared < least:
                    least, face, weights = squared, f, (s, t)
            v = -1
            if face >= 0:
                for k in range(3):
                    corner = mesh.origin[3 * face + k]
                    known = False
                    for step in range(steps):
                        known = known or visited[step] == corner
                    if not known:
                        v = corner
        found.weights[i, 0], found.weights[i, 1] = weights
        if face >= 0 and least <= _longest(mesh, vertices, face):
            found.face[i], found.squared[i] = face, least


@kernel(allocates=False)
def _is_farther(sides, f, point, least):
    """Return whether a point is so far outside the sides of a triangle, of (F, 3, 4), that it is not as near as others.

    `least` is the squared distance of these.
    """
    for k in range(3):
        outside = sides[f, k, 0] * point[0] + sides[f, k, 1] * point[1] + sides[f, k, 2] * point[2]
        outside -= sides[f, k, 3] + ROUNDING
        if outside > 0.0 and outside * outside > least:
            return True
    return False


@kernel(allocates=False)
def corners_from(mesh, vertices, f, point):
    """Return the corners of a triangle, relative to a point."""
    return (
        minus(row(vertices, mesh.origin[3 * f]), point),
        minus(row(vertices, mesh.origin[3 * f + 1]), point),
        minus(row(vertices, mesh.origin[3 * f + 2]), point),
    )


def set_to_nearest_corners(
    mesh: HalfEdges, vertices: Floats, points: Floats, assigned: Assignment, nearest: Ints
) -> None:
    """Set for each dense point that has a triangle the nearest corner of it."""
    on_ranges(_set_corners, len(points), mesh, vertices, points, assigned, nearest, least=POINTS_AT_ONCE)


@kernel(allocates=False)
def _set_corners(begin, end, mesh, vertices, points, assigned, nearest):
    """See `set_to_nearest_corners`; for a range of points."""
    for i in range(begin, end):
        f, least = assigned.face[i], np.inf
        for h in range(3 * f, 3 * f + 3):
            if f >= 0:
                step = minus(row(vertices, mesh.origin[h]), row(points, i))
                if dot(step, step) < least:
                    nearest[i], least = mesh.origin[h], dot(step, step)


@kernel(allocates=False)
def _longest(mesh, vertices, f):
    """Return the squared length of the longest edge of a triangle."""
    _, b, c = corners_from(mesh, vertices, f, row(vertices, mesh.origin[3 * f]))
    bc = minus(c, b)
    return max(dot(b, b), dot(c, c), dot(bc, bc))
