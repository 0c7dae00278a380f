"""Move vertices so that the mesh fits the dense points (Hoppe et al. 1993)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.sparse.linalg import cg

from gppcs.engine.blas import one_blas_thread
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.halfedges import Floats, HalfEdges, Ints

PULL = 0.02  # weight with which a vertex is held where it is, in mean weights of a vertex
LEAST_COSINE = 0.2  # between a triangle's normal and the mean of its corners' after a move
MOST_ITERATIONS = 100  # of conjugate gradients
UNDO_ROUNDS = 4  # of undoing moves that turn triangles over


@one_blas_thread()
def fitted(mesh: HalfEdges, vertices: Floats, normals: Floats, points: Floats, assigned: Assignment) -> Floats:
    """Return vertices for which the sum of the squared distances between points and their places is least.

    The places of the dense points are fixed by their barycentric coordinates. Vertices whose triangles would turn
    over stay where they are.
    """
    there = np.flatnonzero(assigned.face >= 0)
    corners = mesh.origin.reshape(-1, 3)[assigned.face[there]]
    s, t = assigned.weights[there].T
    shares = np.column_stack([1.0 - s - t, s, t])
    shape = (len(there), len(vertices))
    places = csr_array((shares.ravel(), corners.ravel(), np.arange(0, 3 * len(there) + 1, 3)), shape=shape)
    products = places.T @ places
    hold = PULL * products.diagonal().sum() / np.count_nonzero(mesh.leaving >= 0)
    matrix = (products + hold * eye_array(len(vertices))).tocsr()
    right = places.T @ (points[there] - places @ vertices)
    steps = [cg(matrix, axis, rtol=1e-6, maxiter=MOST_ITERATIONS)[0] for axis in right.T]
    moved = vertices + np.column_stack(steps)
    _undo_turns(mesh.faces(), vertices, normals, moved)
    return moved


def _undo_turns(faces: Ints, vertices: Floats, normals: Floats, moved: Floats) -> None:
    """Put vertices back, in `moved`, (V, 3), whose triangles turn against the normals of their corners."""
    least = np.minimum(LEAST_COSINE, _cosines(faces, vertices, normals))
    for _ in range(UNDO_ROUNDS):
        turned = faces[_cosines(faces, moved, normals) < least]
        moved[turned] = vertices[turned]


def _cosines(faces: Ints, vertices: Floats, normals: Floats) -> Floats:
    """Return the cosine between the normal of each triangle and the mean of its corners' normals."""
    a, b, c = (vertices[corner] for corner in faces.T)
    upright, mean = np.cross(b - a, c - a), normals[faces].sum(axis=1)
    length = np.linalg.norm(upright, axis=1) * np.linalg.norm(mean, axis=1)
    return np.einsum("ij,ij->i", upright, mean) / np.where(length > 0.0, length, 1.0)
