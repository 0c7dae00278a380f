"""The error quadrics of the vertices of a mesh, from the tangent planes of the dense points."""

from __future__ import annotations

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.meshing.halfedges import Floats, Ints, following
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.triangles import cross, dot, minus, row
from gppcs.surface.error_quadrics import NUMBERS, add_plane

NEAREST_VERTICES = 4  # vertices among which that of a dense point is chosen


def nearest_vertices(points: Floats, normals: Floats, vertices: Floats, vertex_normals: Floats, members: Ints) -> Ints:
    """Return for each dense point the nearest vertex of its sheet."""
    tree = KdTree.build(vertices[members])
    near, _ = tree.nearest_of(points, min(NEAREST_VERTICES, len(members)))
    found = np.full(len(points), -1)
    for rank in reversed(members[near].T):
        fits = np.einsum("ij,ij->i", normals, vertex_normals[rank]) > 0.0
        found[fits] = rank[fits]
    return found


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


@kernel(allocates=False)
def add_borders(mesh, vertices, weight, quadrics):
    """Add to the ends of each edge on a border the plane through it that is upright on its triangle."""
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
