"""The nearest triangle of each dense point, found by walking over the mesh."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.halfedges import MOST_AROUND, Floats, HalfEdges, Ints, around
from gppcs.spatial.triangles import (
    area_vector,
    cross,
    dot,
    minus,
    nearest_in_triangle,
    nearest_triangles,
    row,
    squared_distance,
)

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
        on_ranges(
            _walk_all, count, mesh, vertices, upright, sides, points, normals, nearest, found,
            least=POINTS_AT_ONCE,
        )  # fmt: skip
        return found

    @classmethod
    def on_any_sheet(cls, mesh: HalfEdges, vertices: Floats, points: Floats) -> Self:
        """Find the nearest of all triangles, whatever sheet it is on; this takes longer."""
        numbers = np.flatnonzero(mesh.origin[::3] >= 0)
        nearest, squared, weights = nearest_triangles(vertices, mesh.faces(), points)
        return cls(numbers[nearest], squared, weights)

    def mean_square(self) -> float:
        """Return the mean of the squared distances."""
        return float(self.squared.sum() / max(1, np.count_nonzero(self.face >= 0)))


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
        corners = corners_from(mesh, vertices, f, (0.0, 0.0, 0.0))
        normal = area_vector(corners[0], corners[1], corners[2])
        upright[f, 0], upright[f, 1], upright[f, 2] = normal
        for k in range(3):
            outward = cross(minus(corners[(k + 1) % 3], corners[k]), normal)
            length = np.sqrt(dot(outward, outward))
            if length > 0.0:
                outward = outward[0] / length, outward[1] / length, outward[2] / length
            sides[f, k, 0], sides[f, k, 1], sides[f, k, 2] = outward
            sides[f, k, 3] = max(dot(outward, corners[0]), dot(outward, corners[1]), dot(outward, corners[2]))


@kernel
def _walk_all(begin, end, mesh, vertices, upright, sides, points, normals, nearest, found):
    """Fill `found` at a range of points: look around vertices until all corners of the nearest triangle are known."""
    visited, halves = np.empty(MOST_WALKED, dtype=np.int64), np.empty(MOST_AROUND, dtype=np.int64)
    for i in range(begin, end):
        point, normal, v = row(points, i), row(normals, i), nearest[i]
        least, face, steps, weights = np.inf, -1, 0, (0.0, 0.0)
        while v >= 0 and steps < MOST_WALKED:
            visited[steps] = v
            steps += 1
            edges, _ = around(mesh, v, halves)
            for slot in range(edges):
                f = halves[slot] // 3
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


@kernel(allocates=False)
def _longest(mesh, vertices, f):
    """Return the squared length of the longest edge of a triangle."""
    _, b, c = corners_from(mesh, vertices, f, row(vertices, mesh.origin[3 * f]))
    bc = minus(c, b)
    return max(dot(b, b), dot(c, c), dot(bc, bc))
