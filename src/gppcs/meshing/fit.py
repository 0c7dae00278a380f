"""Move vertices so that the mesh fits the dense points (Hoppe et al. 1993)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import cg

from gppcs.engine.blas import one_blas_thread
from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.halfedges import HalfEdges
from gppcs.spatial.triangles import area_vector, dot, row

PULL = 0.02  # weight with which a vertex is held where it is, in mean weights of a vertex
LEAST_COSINE = 0.2  # between a triangle's normal and the mean of its corners' after a move
MOST_ITERATIONS = 100  # of conjugate gradients
UNDO_ROUNDS = 4  # of undoing moves that turn triangles over


@one_blas_thread()
def fitted(
    mesh: HalfEdges,
    vertices: NDArray[np.float64],
    normals: NDArray[np.float64],
    points: NDArray[np.float64],
    assigned: Assignment,
    pull: float = PULL,
) -> NDArray[np.float64]:
    """Return vertices for which the sum of the squared distances between points and their places is least.

    The places of the dense points are fixed by their barycentric coordinates. Vertices whose triangles would turn
    over stay where they are.

    Parameters
    ----------
    mesh : HalfEdges
    vertices, normals : (V, 3) arrays, float64
    points : (N, 3) array, float64
        The dense points.
    assigned : Assignment
        Their triangles, with valid weights.
    pull : float
        Weight with which a vertex is held where it is, in mean weights of a vertex.

    Returns
    -------
    (V, 3) array, float64
    """
    there = assigned.face >= 0
    s, t = assigned.weights[there].T
    shares = np.column_stack([1.0 - s - t, s, t])
    corners = mesh.origin.reshape(-1, 3)[assigned.face[there]]
    rows = np.broadcast_to(np.arange(len(corners))[:, None], corners.shape)
    matrix = coo_array((shares.ravel(), (rows.ravel(), corners.ravel())), shape=(len(corners), len(vertices))).tocsr()
    normal_matrix = (matrix.T @ matrix).tocsr()
    hold = pull * normal_matrix.diagonal().sum() / np.count_nonzero(mesh.leaving >= 0)
    normal_matrix = (normal_matrix + diags_array(np.full(len(vertices), hold))).tocsr()
    right = matrix.T @ (points[there] - matrix @ vertices)  # what the present vertices leave
    steps = [cg(normal_matrix, axis, rtol=1e-6, maxiter=MOST_ITERATIONS)[0] for axis in right.T]
    moved = vertices + np.column_stack(steps)
    _undo_turns(mesh, vertices, normals, moved)
    return moved


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
