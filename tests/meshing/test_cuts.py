"""Triangles that cut others are those that dense samples and another program find, and mending leaves fewer of them."""

import numpy as np
import pytest

from gppcs.clouds.topology import topology_of
from gppcs.meshing.cuts import cutting
from gppcs.meshing.halfedges import HalfEdges, faults
from gppcs.meshing.mending import mend
from shapes import ball


def loose(vertices, faces):
    """Triangles that need not be a manifold: only their corners matter for cuts."""
    return HalfEdges(np.ravel(faces).copy(), np.full(np.size(faces), -1), np.full(len(vertices), -1))


def crumpled(seed):
    """A ball some of whose points lie so far inside that their triangles cut others."""
    points, normals, faces = ball(300, seed)
    points = points.copy()
    points[::60] *= -0.95
    return points, normals, faces


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


@pytest.mark.parametrize(
    ("tip", "found"),
    [((0.3, 0.3, -1.0), [0, 1]), ((0.3, 0.3, 0.01), []), ((0.9, 0.9, -1.0), [])],
)
def test_a_tip_cuts_if_it_goes_through(tip, found):
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], tip, [0.3, 0.2, 1], [0.2, 0.4, 1]], dtype=float)
    assert cutting(loose(vertices, [[0, 1, 2], [3, 4, 5]]), vertices).tolist() == found


def test_neighbours_in_one_plane_do_not_cut():
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    vertices = np.column_stack([x.ravel() / 3, y.ravel() / 7, x.ravel() / 3 + y.ravel() / 7])  # rounding tilts them
    i = np.arange(20)[np.arange(20) % 5 < 4]
    faces = np.concatenate([np.column_stack([i, i + 1, i + 6]), np.column_stack([i, i + 6, i + 5])])
    assert len(cutting(HalfEdges.of(faces, 25), vertices)) == 0


@pytest.mark.parametrize("seed", range(4))
def test_mending_keeps_the_topology_and_leaves_no_cut(seed):
    points, normals, faces = crumpled(seed)
    mesh = HalfEdges.of(faces, len(points))
    assert len(cutting(mesh, points)) > 0
    into = mend(mesh, points, normals, np.zeros(len(points), dtype=bool))
    used = np.unique(mesh.faces())
    assert faults(mesh) == []
    assert topology_of(mesh.faces()) == (0, 0, 0, 1, 0)
    assert len(used) >= len(points) - 30
    assert set(into) == set(used)
    assert len(cutting(mesh, points)) == 0


def test_kept_vertices_stay_while_edges_flip():
    points, normals, faces = crumpled(0)
    mesh = HalfEdges.of(faces, len(points))
    before = len(cutting(mesh, points))
    into = mend(mesh, points, normals, np.ones(len(points), dtype=bool))
    assert np.array_equal(into, np.arange(len(points)))
    assert len(np.unique(mesh.faces())) == len(points)
    assert len(cutting(mesh, points)) <= before


def test_a_mesh_without_cuts_is_not_changed():
    points, normals, faces = ball(200)
    mesh = HalfEdges.of(faces, 200)
    mend(mesh, points, normals, np.zeros(200, dtype=bool))
    assert np.array_equal(mesh.faces(), faces)
