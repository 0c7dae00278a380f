"""A fit is a step of Gauss and Newton, never raises the error, keeps borders, and turns no triangle over."""

import numpy as np
import pytest

from gppcs.meshing.assignment import Assignment
from gppcs.meshing.fit import NEAR, PULL, PULL_ALONE, SLIDE, stepped, undo_turns
from gppcs.meshing.halfedges import HalfEdges
from shapes import ball


def assigned_to_ball(faces, points):
    """A mesh of these triangles, and the dense points of a ball with their triangles."""
    mesh = HalfEdges.from_faces(faces, len(points))
    dense, _, _ = ball(5000, seed=1)
    start = np.argmax(dense @ points.T, axis=1)
    return mesh, dense, Assignment.on_same_sheet(mesh, points, dense, dense, start)


@pytest.fixture
def coarse():
    """A coarse mesh of a ball, and the dense points with their triangles."""
    points, normals, faces = ball(200)
    mesh, dense, assigned = assigned_to_ball(faces, points)
    return mesh, points, normals, dense, assigned


@pytest.mark.parametrize("left_out", [0, 30])
def test_a_step_is_that_of_a_dense_solver(left_out):
    """Rows: the distance off the triangle, a weak hold along it, and a pull on each vertex, stronger on borders."""
    points, _, faces = ball(200)
    faces = faces[(faces >= left_out).all(axis=1)]
    mesh, dense, assigned = assigned_to_ball(faces, points)
    there = np.flatnonzero(assigned.face >= 0)
    weights = assigned.weights[there]
    shares = np.zeros((len(there), 200))
    corners = faces[assigned.face[there]]
    shares[np.arange(len(there))[:, None], corners] = np.column_stack([1 - weights.sum(axis=1), weights])
    off = dense[there] - shares @ points
    a, b, c = (points[corner] for corner in corners.T)
    inner = (weights.min(axis=1) > 1e-9) & (weights.sum(axis=1) < 1 - 1e-9)
    across = np.where(inner[:, None], np.cross(b - a, c - a), off)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    distances = (shares[:, :, None] * across[:, None]).reshape(len(there), 600)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    both_ways = {tuple(edge) for edge in edges.tolist()}
    rim = [p for p, q in both_ways if (q, p) not in both_ways]
    hold = np.full(200, PULL)
    hold[rim] = PULL_ALONE
    hold[shares.max(axis=0) < NEAR] = PULL_ALONE
    hold *= (shares**2).sum() / len(np.unique(faces))
    matrix = [np.sqrt(1 - SLIDE) * distances, np.sqrt(SLIDE) * np.kron(shares, np.eye(3))]
    right = [np.sqrt(1 - SLIDE) * (off * across).sum(axis=1), np.sqrt(SLIDE) * off.ravel(), np.zeros(600)]
    step = np.linalg.lstsq(np.vstack([*matrix, np.diag(np.sqrt(np.repeat(hold, 3)))]), np.concatenate(right))[0]
    assert stepped(mesh, points, dense, assigned) == pytest.approx(points + step.reshape(-1, 3), abs=1e-4)


def test_vertices_whose_triangles_would_turn_over_move_less(coarse):
    mesh, points, normals, dense, assigned = coarse
    faces = mesh.faces()
    wrong = dense.copy()
    wrong[assigned.face == 7] *= -1  # as if all points of one triangle lay on the other side of the ball
    moved = stepped(mesh, points, wrong, assigned)
    undo_turns(faces, points, normals, moved)
    a, b, c = (moved[corner] for corner in mesh.faces().T)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()
