"""What a mesh promises by its making: few thin triangles on flat parts, and no more vertices than it had."""

import numpy as np
import pytest

import gppcs
from gppcs.meshing.collapse import collapse
from gppcs.meshing.dense import DensePoints
from gppcs.meshing.draft import Draft
from gppcs.meshing.fit import fit
from gppcs.meshing.flips import flip
from gppcs.meshing.halfedges import HalfEdges
from gppcs.meshing.refinement import refine
from gppcs.spatial.triangles import qualities
from shapes import ball, cube, faults, hull


@pytest.fixture
def draft():
    """A ball of 4,000 dense points, and a mesh of 300 of them."""
    points, _, _ = ball(4000)
    dense = DensePoints.from_points(points, 300, np.empty(0, dtype=np.int64))
    joined = np.arange(0, 3900, 13)
    mesh = HalfEdges.from_faces(hull(dense.positions[joined]), 300)
    return Draft.from_mesh(mesh, dense, joined, np.zeros(300, dtype=bool), moved=False)


@pytest.mark.parametrize("moved", [False, True])
def test_flat_faces_have_few_thin_triangles(moved):
    mesh = gppcs.mesh(cube(8000), n_points=300, moved=moved).mesh
    assert (qualities(mesh.vertices, mesh.faces) < 0.2).mean() <= 0.015


def test_refinement_brings_the_mesh_nearer_with_as_many_vertices(draft):
    before = draft.assigned().squared.sum()
    refine(draft, 60, draft.assigned())
    assert 300 < draft.n_vertices <= 360
    collapse(draft, 300)
    draft.compact()
    flip(draft)
    assert draft.n_vertices == len(draft.dense_index) == len(np.unique(draft.dense_index)) == 300
    assert np.array_equal(draft.vertices, draft.dense.raw[draft.dense_index])
    assert faults(draft.mesh) == []
    assert draft.assigned().squared.sum() < before
    assert (qualities(draft.vertices, draft.mesh.faces()) < 0.2).mean() <= 0.012


def test_a_fit_brings_the_mesh_nearer_and_turns_hardly_any_triangle_over(draft):
    assigned = flip(draft)
    before = assigned.mean_square()
    after = fit(draft, assigned)
    assert after.mean_square() < 0.5 * before
    assert draft.assigned().mean_square() <= after.mean_square() * (1 + 1e-9)
    assert faults(draft.mesh) == []
    a, b, c = draft.vertices[draft.mesh.faces()].transpose(1, 0, 2)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).mean() > 0.99
