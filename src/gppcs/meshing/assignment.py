"""The nearest triangle of each dense point, found by walking over the mesh."""

from typing import NamedTuple, Self

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.halfedges import HalfEdges, around, position_of, room_for_ring
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.triangles import (
    area_vector,
    dot,
    minus,
    nearest_in_triangle,
    nearest_triangles,
    row,
    squared_distance,
)

MAX_WALK = 64  # vertices that a walk visits


class Assignment(NamedTuple):
    """The nearest triangle of each of N dense points."""

    face: Ints  # (N,): its number; -1 if there is none near the point on its sheet
    squared: Floats  # (N,): the squared distance; 0 without a triangle
    weights: Floats  # (N, 2): barycentric coordinates of the foot, for the second and the third corner

    @classmethod
    def on_same_sheet(cls, mesh: HalfEdges, vertices: Floats, points: Floats, normals: Floats, nearest: Ints) -> Self:
        """Walk from a vertex near each point to its nearest triangle."""
        count = len(points)
        assigned = cls(np.full(count, -1), np.zeros(count), np.zeros((count, 2)))
        on_ranges(_walk_all, count, mesh, vertices, points, normals, nearest, assigned, minimum=1024)
        return assigned

    @classmethod
    def on_any_sheet(cls, mesh: HalfEdges, vertices: Floats, points: Floats) -> Self:
        """Find the nearest of all triangles, whatever sheet it is on; this takes longer."""
        numbers = np.flatnonzero(mesh.origin[::3] >= 0)
        nearest, squared, weights = nearest_triangles(vertices, mesh.faces(), points)
        return cls(numbers[nearest], squared, weights)

    def mean_square(self) -> float:
        """Return the mean of the squared distances."""
        return float(self.squared.sum() / max(1, np.count_nonzero(self.face >= 0)))


def nearest_vertices(points: Floats, normals: Floats, vertices: Floats, vertex_normals: Floats, members: Ints) -> Ints:
    """Return for each dense point the nearest of some vertices on its sheet, among the nearest four."""
    tree = KdTree.build(vertices[members])
    nearest = members[tree.nearest_of(points, 1)[0][:, 0]]  # which is on the sheet of nearly all points
    left = np.flatnonzero(~(np.einsum("ij,ij->i", normals, vertex_normals[nearest]) > 0.0))
    nearest[left] = -1
    for rank in members[tree.nearest_of(points[left], min(4, len(members)))[0]].T:
        agrees = (nearest[left] < 0) & (np.einsum("ij,ij->i", normals[left], vertex_normals[rank]) > 0.0)
        nearest[left[agrees]] = rank[agrees]
    return nearest


@kernel
def _walk_all(begin, end, mesh, vertices, points, normals, nearest, assigned):
    """Fill `assigned` at a range of points: walk until all corners of the nearest triangle were visited."""
    visited = np.empty(MAX_WALK, dtype=np.int64)
    halves, _ = room_for_ring()
    for i in range(begin, end):
        point, normal, v = row(points, i), row(normals, i), nearest[i]
        lowest, face, steps, weights = np.inf, -1, 0, (0.0, 0.0)
        while v >= 0 and steps < MAX_WALK:
            visited[steps] = v
            steps += 1
            edges, _ = around(mesh, v, halves)
            for slot in range(edges):
                f = halves[slot] // 3
                a, b, c = corners_from(mesh, vertices, f, point)
                if f == face or dot(area_vector(a, b, c), normal) <= 0.0:
                    continue
                s, t = nearest_in_triangle(a, b, c)
                squared = squared_distance(a, b, c, s, t)
                if squared < lowest:
                    lowest, face, weights = squared, f, (s, t)
            v = -1
            if face >= 0:
                for k in range(3):
                    if position_of(visited, steps, mesh.origin[3 * face + k]) < 0:
                        v = mesh.origin[3 * face + k]
        assigned.weights[i, 0], assigned.weights[i, 1] = weights
        if face >= 0 and lowest <= _longest(mesh, vertices, face):
            assigned.face[i], assigned.squared[i] = face, lowest


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
