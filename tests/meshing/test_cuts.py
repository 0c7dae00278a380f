"""Triangles that cut others are those that another program finds, also after the mesh has changed."""

import numpy as np
import pytest

import gppcs
from gppcs.meshing.cuts import TriangleTree, cutting, follow
from gppcs.meshing.halfedges import HalfEdges
from meshes import faulty_triangles
from shapes import ball


def loose(vertices, faces):
    """Triangles that need not be a manifold: only their corners matter for cuts."""
    return HalfEdges(np.ravel(faces).copy(), np.full(np.size(faces), -1), np.full(len(vertices), -1))


@pytest.mark.parametrize("corners", [3, 6, 12])
@pytest.mark.parametrize("axes", [2, 3])
def test_on_a_lattice_the_triangles_found_are_exactly_those_that_meet_or_have_no_area(corners, axes):
    rng = np.random.default_rng(corners)
    for _ in range(60):
        vertices = np.unique(rng.integers(0, 5, (corners, 3)) * (np.arange(3) < axes), axis=0) / 3.0 + 0.1
        if len(vertices) < 3:
            continue
        faces = np.array([rng.permutation(len(vertices))[:3] for _ in range(4)])
        faces = faces[np.sort(np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1])]
        lattice = np.round((vertices - 0.1) * 3)
        flat = gppcs.Mesh(lattice, faces).face_areas() == 0
        assert set(np.flatnonzero(flat)) <= set(cutting(loose(vertices, faces), vertices))
        if not flat.all():
            faces = faces[~flat]
            assert set(cutting(loose(vertices, faces), vertices)) == faulty_triangles(gppcs.Mesh(lattice, faces))


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_triangles_that_cut_are_those_that_pymeshlab_finds(seed, shared):
    pymeshlab = pytest.importorskip("pymeshlab")
    rng = np.random.default_rng(seed)
    vertices = rng.random((60, 3))
    faces = np.array([rng.permutation(30)[:3] for _ in range(12)]) if shared else np.arange(60).reshape(20, 3)
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.compute_selection_by_self_intersections_per_face()
    expected = np.flatnonzero(meshes.current_mesh().face_selection_array())
    assert len(expected) > 0
    assert np.array_equal(cutting(loose(vertices, faces), vertices), expected)


@pytest.mark.parametrize("seed", range(3))
def test_a_tree_that_follows_the_changes_finds_what_a_new_one_finds(seed):
    points, _, faces = ball(300, seed)
    mesh = HalfEdges.from_faces(faces, 300)
    tree = TriangleTree.from_mesh(mesh, points)
    assert len(cutting(mesh, points, tree)) == 0
    moved = points.copy()
    moved[::60] *= -0.95
    for f in np.flatnonzero((faces % 60 == 0).any(axis=1)):
        follow(mesh, moved, tree, f)
    found = cutting(mesh, moved, tree)
    assert len(found) > 0
    assert np.array_equal(found, cutting(mesh, moved))
