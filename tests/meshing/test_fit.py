"""A fit is a solution of least squares, and turns no triangle over."""

import numpy as np
import pytest

from gppcs.meshing.assignment import Assignment
from gppcs.meshing.fit import fitted
from gppcs.meshing.halfedges import HalfEdges
from shapes import ball


@pytest.fixture
def coarse():
    """A coarse mesh of a ball, and the dense points with their triangles."""
    points, normals, faces = ball(200)
    mesh = HalfEdges.of(faces, 200)
    dense, _, _ = ball(5000, seed=1)
    start = np.argmax(dense @ points.T, axis=1)
    return mesh, points, normals, dense, Assignment.of(mesh, points, dense, dense, start)


def test_the_fit_is_that_of_a_dense_solver(coarse):
    mesh, points, normals, dense, assigned = coarse
    matrix = np.zeros((len(dense), 200))
    rows = np.arange(len(dense))[:, None]
    matrix[rows, mesh.faces()[assigned.face]] = np.column_stack([1 - assigned.weights.sum(axis=1), assigned.weights])
    hold = 0.02 * (matrix**2).sum() / 200
    stacked = np.vstack([matrix, np.sqrt(hold) * np.eye(200)])
    expected = np.linalg.lstsq(stacked, np.vstack([dense, np.sqrt(hold) * points]))[0]
    assert fitted(mesh, points, normals, dense, assigned) == pytest.approx(expected, abs=1e-5)


def test_vertices_whose_triangles_would_turn_over_stay(coarse):
    mesh, points, normals, dense, assigned = coarse
    wrong = dense.copy()
    wrong[assigned.face == 7] *= -1  # as if all points of one triangle lay on the other side of the ball
    moved = fitted(mesh, points, normals, wrong, assigned)
    a, b, c = (moved[corner] for corner in mesh.faces().T)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()
    corners = mesh.faces()[7]
    assert np.array_equal(moved[corners], points[corners])
