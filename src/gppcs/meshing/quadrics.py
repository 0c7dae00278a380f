"""The error quadrics of the vertices of a mesh, from the tangent planes of the dense points."""

from __future__ import annotations

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.halfedges import Floats, HalfEdges, Ints, following
from gppcs.spatial.kdtree import KdTree, limit_beside, nearest_within
from gppcs.spatial.triangles import cross, dot, minus, row
from gppcs.surface.error_quadrics import NUMBERS, add_plane

NEAREST_VERTICES = 4  # vertices among which that of a dense point is chosen
QUERIES_AT_ONCE = 256  # dense points that a thread takes at once, at least


def nearest_vertices(points: Floats, normals: Floats, vertices: Floats, vertex_normals: Floats, members: Ints) -> Ints:
    """Return for each dense point the nearest vertex of its sheet."""
    tree = KdTree.build(vertices[members])
    found = np.empty(len(points), dtype=np.int64)
    on_ranges(
        _find_vertices, len(points), points, normals, tree.points, tree.low, tree.high,
        np.ascontiguousarray(vertex_normals[members][tree.order]), members[tree.order], found, least=QUERIES_AT_ONCE,
    )  # fmt: skip
    return found


@kernel
def _find_vertices(begin, end, points, normals, vertices, low, high, vertex_normals, members, found):
    """Fill `found`, (N,), with one of `members`, (V',); vertices, (3, V'), and boxes are those of a tree."""
    k = min(NEAREST_VERTICES, vertices.shape[1])
    near, squared = np.empty(k, dtype=np.int64), np.empty(k, dtype=np.float64)
    limit = np.inf
    for i in range(begin, end):
        point = row(points, i)
        nearest_within(vertices, low, high, point[0], point[1], point[2], limit, near[:1], squared[:1])
        nearest = squared[0]
        if dot(row(normals, i), row(vertex_normals, near[0])) <= 0.0:  # it lies on another sheet
            nearest_within(vertices, low, high, point[0], point[1], point[2], np.inf, near, squared)
        found[i] = -1
        for j in near:
            if dot(row(normals, i), row(vertex_normals, j)) > 0.0:
                found[i] = members[j]
                break
        if i + 1 < end:
            step = minus(row(points, i + 1), point)
            limit = limit_beside(nearest, step[0], step[1], step[2])


def dense_quadrics(points: Floats, normals: Floats, vertices: Floats, nearest: Ints) -> Floats:
    """Return for each vertex the quadric of the tangent planes of the dense points nearest to it, (V, 10)."""
    quadrics = np.zeros((len(vertices), NUMBERS))
    _add_dense(points, normals, vertices, nearest, quadrics)
    return quadrics


@kernel(allocates=False)
def _add_dense(points, normals, vertices, nearest, quadrics):
    """Add the planes of all dense points to `quadrics`, (V, 10)."""
    for i in range(len(points)):
        v = nearest[i]
        if v >= 0:
            normal = row(normals, i)
            add_plane(quadrics[v], normal, dot(normal, minus(row(vertices, v), row(points, i))), 1.0)


def add_borders(mesh: HalfEdges, vertices: Floats, weight: float, quadrics: Floats) -> None:
    """Add to the ends of each edge on a border the plane through it that is upright on its triangle."""
    _add_borders(mesh, vertices, weight, quadrics)


@kernel(allocates=False)
def _add_borders(mesh, vertices, weight, quadrics):
    """See `add_borders`."""
    for h in range(len(mesh.origin)):
        if mesh.origin[h] < 0 or mesh.opposite[h] >= 0:
            continue
        v, w = mesh.origin[h], mesh.origin[following(h)]
        edge = minus(row(vertices, w), row(vertices, v))
        third = minus(row(vertices, mesh.origin[following(following(h))]), row(vertices, v))
        upright = cross(edge, cross(edge, third))
        length = np.sqrt(dot(upright, upright))
        if length > 0.0:
            normal = upright[0] / length, upright[1] / length, upright[2] / length
            add_plane(quadrics[v], normal, 0.0, weight)
            add_plane(quadrics[w], normal, 0.0, weight)
