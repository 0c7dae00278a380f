"""The nearest triangle of each dense point, found by walking over the mesh."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.halfedges import MOST_AROUND, HalfEdges, around
from gppcs.spatial.triangles import area_vector, dot, minus, nearest_in_triangle, row, squared_distance

POINTS_AT_ONCE = 1024  # dense points that a thread takes at once, at least
MOST_WALKED = 64  # vertices that a walk visits, at most


class Assignment(NamedTuple):
    """The nearest triangle of each of N dense points.

    Attributes
    ----------
    face : (N,) array, int64
        Its number; -1 if there is none near the point on its sheet.
    squared : (N,) array, float64
        The squared distance; 0 without a triangle.
    weights : (N, 2) array, float64
        Barycentric coordinates of the nearest place, for the second and the third corner.
    """

    face: NDArray[np.int64]
    squared: NDArray[np.float64]
    weights: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        mesh: HalfEdges,
        vertices: NDArray[np.float64],
        points: NDArray[np.float64],
        normals: NDArray[np.float64],
        nearest: NDArray[np.int64],
    ) -> Self:
        """Walk from a vertex near each point to its nearest triangle.

        Parameters
        ----------
        mesh : HalfEdges
        vertices : (V, 3) array, float64
        points, normals : (N, 3) arrays, float64
            Of the dense points. A triangle whose normal is more than 90 degrees off is left out.
        nearest : (N,) array, int64
            Where each walk starts; -1 for points without a vertex.

        Returns
        -------
        Assignment
        """
        count = len(points)
        found = cls(np.full(count, -1), np.zeros(count), np.zeros((count, 2)))
        upright = np.zeros((len(mesh.origin) // 3, 3))
        on_ranges(_fill_normals, len(upright), mesh, vertices, upright, least=POINTS_AT_ONCE)
        on_ranges(_walk_all, count, mesh, vertices, upright, points, normals, nearest, found, least=POINTS_AT_ONCE)
        return found


@kernel(allocates=False)
def _fill_normals(begin, end, mesh, vertices, upright):
    """Fill the normals of the triangles, (F, 3), not of unit length; their signs are all that matters."""
    for f in range(begin, end):
        if mesh.origin[3 * f] >= 0:
            a, b, c = mesh.origin[3 * f], mesh.origin[3 * f + 1], mesh.origin[3 * f + 2]
            upright[f] = area_vector(row(vertices, a), row(vertices, b), row(vertices, c))


@kernel
def _walk_all(begin, end, mesh, vertices, upright, points, normals, nearest, found):
    """Fill `found` at a range of points; other arrays as in `Assignment.of`."""
    halves = np.empty(MOST_AROUND, dtype=np.int64)
    visited = np.empty(MOST_WALKED, dtype=np.int64)
    for i in range(begin, end):
        if nearest[i] >= 0:
            _walk(mesh, vertices, upright, points, normals, i, nearest[i], halves, visited, found)


@kernel(allocates=False)
def _walk(mesh, vertices, upright, points, normals, i, v, halves, visited, found):
    """Look around vertices until all three corners of the nearest triangle have been looked at."""
    point, normal = row(points, i), row(normals, i)
    least, face, steps = np.inf, -1, 0
    while v >= 0 and steps < MOST_WALKED:
        visited[steps] = v
        steps += 1
        edges, _ = around(mesh, v, halves)
        for slot in range(edges):
            f = halves[slot] // 3
            if f == face or dot(row(upright, f), normal) <= 0.0:
                continue
            a, b, c = corners_from(mesh, vertices, f, point)
            s, t = nearest_in_triangle(a, b, c)
            squared = squared_distance(a, b, c, s, t)
            if squared < least:
                least, face = squared, f
                found.weights[i, 0], found.weights[i, 1] = s, t
        v = -1
        if face >= 0:
            for k in range(3):
                corner = mesh.origin[3 * face + k]
                known = False
                for step in range(steps):
                    known = known or visited[step] == corner
                if not known:
                    v = corner
    if face >= 0 and least <= _longest(mesh, vertices, face):
        found.face[i], found.squared[i] = face, least


@kernel(allocates=False)
def corners_from(mesh, vertices, f, point):
    """Return the corners of a triangle, relative to a point.

    Parameters
    ----------
    mesh : HalfEdges
    vertices : (V, 3) array
    f : int
    point : three floats

    Returns
    -------
    a, b, c : tuples of three floats
    """
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
