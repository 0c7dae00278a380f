"""Move vertices so that the mesh fits the dense points (Hoppe et al. 1993, by steps of Gauss and Newton)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import cg

from gppcs.engine.blas import one_blas_thread
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.halfedges import Floats, HalfEdges, Ints

SLIDE = 0.02  # weight of a point's step along the mesh, which costs no distance, beside that off the mesh
PULL = 0.001  # weight with which a vertex is held where it is, in mean weights of a vertex
PULL_ALONE = 0.5  # the same on borders, beyond which no points hold a vertex, and without points near a vertex
NEAR = 0.4  # least weight of the vertex in a point that is near it
LEAST_COSINE = 0.2  # between a triangle's normal and the mean of its corners' after a move
THIN = 0.2  # steps that make triangles of a lower quality are shortened
MOST_ITERATIONS = 100  # of conjugate gradients
HALVINGS, UNDO_ROUNDS = 4, 4  # of steps that turn triangles over, and then of undoing them


@one_blas_thread()
def fitted(mesh: HalfEdges, vertices: Floats, normals: Floats, points: Floats, assigned: Assignment) -> Floats:
    """Return vertices after one step towards the least sum of squared distances between dense points and triangles.

    A step off the triangle at a point's foot changes its distance; one along it hardly does, as the foot slides.
    """
    there = np.flatnonzero(assigned.face >= 0)
    corners = mesh.origin.reshape(-1, 3)[assigned.face[there]]
    s, t = assigned.weights[there].T
    shares = np.column_stack([1.0 - s - t, s, t])
    off = points[there] - np.einsum("ij,ijk->ik", shares, vertices[corners])
    across = _directions(vertices[corners], shares, off)

    count, size = len(there), len(vertices)
    columns = (3 * corners[:, :, None] + np.arange(3)).ravel()
    slopes = (shares[:, :, None] * across[:, None, :]).ravel()
    distances = csr_array((slopes, columns, np.arange(0, 9 * count + 1, 9)), shape=(count, 3 * size))
    feet = csr_array((shares.ravel(), corners.ravel(), np.arange(0, 3 * count + 1, 3)), shape=(count, size))
    products = feet.T @ feet
    pull = np.full(size, PULL)
    pull[mesh.origin[(mesh.opposite < 0) & (mesh.origin >= 0)]] = PULL_ALONE
    largest = np.zeros(size)
    np.maximum.at(largest, corners, shares)
    pull[largest < NEAR] = PULL_ALONE
    pull *= products.diagonal().sum() / np.count_nonzero(mesh.leaving >= 0)
    matrix = (1.0 - SLIDE) * (distances.T @ distances) + kron(SLIDE * products + diags_array(pull), eye_array(3))
    along = np.einsum("ij,ij->i", off, across)
    right = (1.0 - SLIDE) * (distances.T @ along) + SLIDE * (feet.T @ off).ravel()
    scale = diags_array(1.0 / matrix.diagonal())
    steps, _ = cg(matrix.tocsr(), right, rtol=1e-5, maxiter=MOST_ITERATIONS, M=scale)
    moved = vertices + steps.reshape(-1, 3)
    _undo_turns(mesh.faces(), vertices, normals, moved)
    return moved


def _directions(corners: Floats, shares: Floats, off: Floats) -> Floats:
    """Return the unit vectors in which the distances of points grow, (n, 3): the triangle's normal at an inner foot."""
    upright = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outside = (shares.min(axis=1) < 1e-9) & ((off**2).sum(axis=1) > 1e-24)
    found: Floats = np.where(outside[:, None], off, upright)
    return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300)


def _undo_turns(faces: Ints, vertices: Floats, normals: Floats, moved: Floats) -> None:
    """Halve steps in `moved`, (V, 3), that make triangles thin; also undo those that turn them against the normals."""
    cosines, qualities = _shapes(faces, vertices, normals)
    least, thinnest = np.minimum(LEAST_COSINE, cosines), np.minimum(THIN, qualities)
    for share in (*[0.5] * HALVINGS, *[0.0] * UNDO_ROUNDS):
        cosines, qualities = _shapes(faces, moved, normals)
        worse = np.unique(faces[(cosines < least) | ((qualities < thinnest) & (share > 0.0))])
        moved[worse] = vertices[worse] + share * (moved[worse] - vertices[worse])


def _shapes(faces: Ints, vertices: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Return the cosine between the normal of each triangle and the mean of its corners' normals, and its quality."""
    a, b, c = (vertices[corner] for corner in faces.T)
    upright, mean = np.cross(b - a, c - a), normals[faces].sum(axis=1)
    area = np.linalg.norm(upright, axis=1)
    length = area * np.linalg.norm(mean, axis=1)
    squared = ((b - a) ** 2 + (c - b) ** 2 + (a - c) ** 2).sum(axis=1)
    cosines = np.einsum("ij,ij->i", upright, mean) / np.where(length > 0.0, length, 1.0)
    return cosines, 2.0 * np.sqrt(3.0) * area / np.where(squared > 0.0, squared, 1.0)
