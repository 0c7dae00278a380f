"""Meshes that tests make."""

from fractions import Fraction

import numpy as np

import gppcs
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.energy import THIN_IN_FLIPS, FittedMesh
from gppcs.meshing.halfedges import HalfEdges
from gppcs.spatial.triangles import qualities
from shapes import hull


def hull_mesh(points) -> gppcs.Mesh:
    """Return the convex hull of (N, 3) points around the origin, its triangles turned outwards."""
    return gppcs.Mesh(points, hull(points))


def moved(mesh, by) -> gppcs.Mesh:
    """Return a mesh whose vertices are moved by a vector or a number."""
    return gppcs.Mesh(mesh.vertices + np.asarray(by), mesh.faces)


def faulty_triangles(mesh: gppcs.Mesh) -> set[int]:
    """Return the triangles that have no area, or meet another in more than common corners, by exact whole numbers."""
    parts = [Fraction(x).denominator for x in mesh.vertices.ravel().tolist()]
    points = [tuple(int(Fraction(x) * max(parts)) for x in vertex) for vertex in mesh.vertices.tolist()]
    faces = [tuple(face) for face in mesh.faces.tolist()]
    flat = {f for f, (a, b, c) in enumerate(faces) if not any(_cross(points, a, b, c))}
    found = set(flat)
    for f, g in _close_pairs(mesh, flat):
        if not {f, g} <= found and _meet(points, faces[f], faces[g]):
            found |= {f, g}
    return found


def _close_pairs(mesh, left_out):
    """Yield pairs of triangles whose boxes meet and that no plane of either surely parts."""
    corners = mesh.vertices[mesh.faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    rounding = 1e-13 * np.ptp(mesh.vertices, axis=0).max()
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    order = np.argsort(low[:, 0])
    ends = np.searchsorted(low[order, 0], high[order, 0], side="right")
    for i, f in enumerate(order):
        near = order[i + 1 : ends[i]]
        near = near[((low[near] <= high[f]) & (high[near] >= low[f])).all(axis=1)]
        shared = (mesh.faces[near][:, :, None] == mesh.faces[f]).any(axis=2)
        shared_f = (mesh.faces[near][:, :, None] == mesh.faces[f]).any(axis=1)
        parted = np.zeros(len(near), dtype=bool)
        for other in (
            np.where(shared, np.nan, (corners[near] - corners[f, 0]) @ normals[f]),
            np.where(shared_f, np.nan, np.einsum("nkj,nj->nk", corners[f] - corners[near][:, :1], normals[near])),
        ):
            parted |= ~(other <= rounding).any(axis=1) | ~(other >= -rounding).any(axis=1)
        yield from ((int(f), int(g)) for g in near[~parted] if int(g) not in left_out and int(f) not in left_out)


def _meet(points, f, g):
    """Return whether two triangles meet in more than their common corners."""
    common = [v for v in f if v in g]
    if len(common) == 3:
        return True
    if len(common) == 2:
        (a,), (c,) = set(f) - set(common), set(g) - set(common)
        one, other = _cross(points, *common, a), _cross(points, *common, c)
        return not any(_turn(one, other)) and _dot(one, other) > 0
    edges = [(e, t) for t, o in ((f, g), (g, f)) for e in ((o[0], o[1]), (o[1], o[2]), (o[2], o[0]))]
    return any(_edge_meets(points, *e, *t) for e, t in edges if not set(e) & set(common))


def _edge_meets(points, p, q, a, b, c):
    """Return whether an edge and a triangle have a place in common, borders included."""
    at_p, at_q = _volume(points, a, b, c, p), _volume(points, a, b, c, q)
    if at_p * at_q > 0:
        return False
    if at_p or at_q:
        signs = [_sign(_volume(points, p, q, *edge)) for edge in ((a, b), (b, c), (c, a))]
        return min(signs) >= 0 or max(signs) <= 0
    axis = next(axis for axis, x in enumerate(_cross(points, a, b, c)) if x)

    def side(u, v, w):
        return _sign(_cross(points, u, v, w)[axis])

    corners = ((a, b), (b, c), (c, a))
    inside = any(abs(sum(side(*e, v) for e in corners)) == sum(abs(side(*e, v)) for e in corners) for v in (p, q))
    return inside or any(
        side(p, q, u) * side(p, q, v) <= 0 and side(u, v, p) * side(u, v, q) <= 0 and (side(p, q, u) or side(p, q, v))
        for u, v in corners
    )


def _sign(x):
    return (x > 0) - (x < 0)


def _cross(points, a, b, c):
    return _turn(*([points[v][k] - points[a][k] for k in range(3)] for v in (b, c)))


def _volume(points, a, b, c, d):
    return _dot(_cross(points, a, b, c), [points[d][k] - points[a][k] for k in range(3)])


def _turn(u, v):
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def _dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def fitted_mesh(points, faces, dense, normals):
    """A mesh and dense points in its triangles."""
    mesh = HalfEdges.from_faces(faces, len(points))
    nearest = np.argmin(((dense[:, None] - points) ** 2).sum(axis=2), axis=1)
    assigned = Assignment.on_same_sheet(mesh, points, dense, normals, nearest)
    return FittedMesh.from_points(mesh, points.copy(), dense, assigned)


def energy(fitted, thin_cost):
    """The sum of the squared distances and of the costs of thin triangles."""
    thinness = np.maximum(0.0, 1.0 - qualities(fitted.vertices, fitted.mesh.faces()) / THIN_IN_FLIPS)
    return fitted.assigned.squared.sum() + thin_cost * thinness.sum()
