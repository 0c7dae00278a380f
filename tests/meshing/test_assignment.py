"""Walks over a mesh find the nearest triangle."""

import numpy as np
import pytest

from dense import distances_to_triangles
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.halfedges import HalfEdges
from shapes import ball, on_sphere


def test_walks_find_the_nearest_triangle_of_all(threads):
    points, _, faces = ball(300)
    mesh = HalfEdges.from_faces(faces, 300)
    normals = on_sphere(500, seed=1)
    dense = normals * np.random.default_rng(2).uniform(0.98, 1.02, (500, 1))
    start = np.argmax(normals @ points.T, axis=1)
    found = Assignment.on_same_sheet(mesh, points, dense, normals, start)
    nearest = distances_to_triangles(dense, points[faces])
    assert (found.face >= 0).all()
    assert np.sqrt(found.squared) == pytest.approx(nearest, abs=1e-9)
    shares = np.column_stack([1 - found.weights.sum(axis=1), found.weights])
    places = np.einsum("nk,nkx->nx", shares, points[faces[found.face]])
    assert np.linalg.norm(places - dense, axis=1) == pytest.approx(nearest, abs=1e-9)


def test_points_of_another_sheet_or_without_a_vertex_have_no_triangle():
    points, normals, faces = ball(300)
    mesh = HalfEdges.from_faces(faces, 300)
    assert (Assignment.on_same_sheet(mesh, points, points, -normals, np.arange(300)).face == -1).all()
    assert (Assignment.on_same_sheet(mesh, points, points, normals, np.full(300, -1)).face == -1).all()
