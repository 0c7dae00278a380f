"""Move vertices so that the mesh fits the dense points (Hoppe et al. 1993)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import cg

from gppcs.engine.blas import one_blas_thread
from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment, corners_from
from gppcs.meshing.halfedges import Floats, HalfEdges
from gppcs.spatial.triangles import area_vector, dot, row

PULL = 0.02  # weight with which a vertex is held where it is, in mean weights of a vertex
LEAST_COSINE = 0.2  # between a triangle's normal and the mean of its corners' after a move
MOST_ITERATIONS = 100  # of conjugate gradients
UNDO_ROUNDS = 4  # of undoing moves that turn triangles over


@one_blas_thread()
def fitted(
    mesh: HalfEdges, vertices: Floats, normals: Floats, points: Floats, assigned: Assignment, pull: float = PULL
) -> Floats:
    """Return vertices for which the sum of the squared distances between points and their places is least.

    The places of the dense points are fixed by their barycentric coordinates. Vertices whose triangles would turn
    over stay where they are.
    """
    size = len(mesh.origin) // 3
    products, leavings = np.zeros((size, 3, 3)), np.zeros((size, 3, 3))
    _add_points(mesh, vertices, points, assigned, products, leavings)
    faces = np.flatnonzero(mesh.origin[::3] >= 0)
    corners = mesh.origin.reshape(-1, 3)[faces]
    rows, columns = np.repeat(corners, 3, axis=1), np.tile(corners, 3)
    shape = (len(vertices), len(vertices))
    normal_matrix = coo_array((products[faces].ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsr()
    hold = pull * normal_matrix.diagonal().sum() / np.count_nonzero(mesh.leaving >= 0)
    normal_matrix = (normal_matrix + diags_array(np.full(len(vertices), hold))).tocsr()
    right = np.stack(
        [np.bincount(corners.ravel(), leavings[faces, :, axis].ravel(), len(vertices)) for axis in range(3)], axis=1
    )  # fmt: skip
    steps = [cg(normal_matrix, axis, rtol=1e-6, maxiter=MOST_ITERATIONS)[0] for axis in right.T]
    moved = vertices + np.column_stack(steps)
    _undo_turns(mesh, vertices, normals, moved)
    return moved


@kernel(allocates=False)
def _add_points(mesh, vertices, points, assigned, products, leavings):
    """Add up for each triangle what its dense points give to the normal equations of its corners.

    `products`, (F, 3, 3), are those of the barycentric coordinates. `leavings`, (F, 3, 3), are for each corner the
    coordinates times the step from the place on the triangle to the point: what the present vertices leave.
    """
    for i in range(len(points)):
        f = assigned.face[i]
        if f < 0:
            continue
        s, t = assigned.weights[i]
        shares = 1.0 - s - t, s, t
        a, b, c = corners_from(mesh, vertices, f, row(points, i))
        for k in range(3):
            for other in range(3):
                products[f, k, other] += shares[k] * shares[other]
            for axis in range(3):
                leavings[f, k, axis] -= shares[k] * (shares[0] * a[axis] + s * b[axis] + t * c[axis])


@kernel(allocates=False)
def _undo_turns(mesh, vertices, normals, moved):
    """Put vertices back, in `moved`, (V, 3), whose triangles turn against the normals of their corners."""
    for _ in range(UNDO_ROUNDS):
        undone = 0
        for f in range(len(mesh.origin) // 3):
            a, b, c = mesh.origin[3 * f], mesh.origin[3 * f + 1], mesh.origin[3 * f + 2]
            if a >= 0 and _cosine(normals, moved, a, b, c) < min(LEAST_COSINE, _cosine(normals, vertices, a, b, c)):
                for v in (a, b, c):
                    for axis in range(3):
                        moved[v, axis] = vertices[v, axis]
                undone += 1
        if undone == 0:
            return


@kernel(allocates=False)
def _cosine(normals, vertices, a, b, c):
    """Return the cosine between the normal of a triangle and the mean of its corners' normals."""
    normal = area_vector(row(vertices, a), row(vertices, b), row(vertices, c))
    total = (
        normals[a, 0] + normals[b, 0] + normals[c, 0],
        normals[a, 1] + normals[b, 1] + normals[c, 1],
        normals[a, 2] + normals[b, 2] + normals[c, 2],
    )
    length = np.sqrt(dot(normal, normal) * dot(total, total))
    return dot(normal, total) / length if length > 0.0 else 0.0
