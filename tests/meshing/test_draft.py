"""What a mesh promises by its making: few thin triangles on flat parts, and no more vertices than it had."""

import numpy as np
import pytest

import gppcs
from gppcs.meshing.cuts import cutting
from gppcs.meshing.dense import DensePoints
from gppcs.meshing.draft import MOST_THIN, THIN, Draft
from gppcs.meshing.flips import qualities
from gppcs.meshing.halfedges import HalfEdges
from shapes import ball, faults, hull


def cube(n, seed=0):
    """Random points of the surface of a unit cube."""
    rng = np.random.default_rng(seed)
    points = rng.random((n, 3))
    points[np.arange(n), rng.integers(0, 3, n)] = rng.integers(0, 2, n)
    return points


@pytest.fixture
def draft():
    """A ball of 4,000 dense points, and a mesh of 300 of them."""
    points, _, _ = ball(4000)
    dense = DensePoints.from_points(points, 300, np.empty(0, dtype=np.int64))
    level = np.arange(0, 3900, 13)
    return Draft.of(dense, False, level, np.zeros(300, dtype=bool), hull(dense.places[level]))


@pytest.mark.parametrize("moved", [False, True])
def test_flat_faces_have_few_thin_triangles(moved):
    mesh = gppcs.mesh(cube(8000), n_points=300, moved=moved).mesh
    thin = qualities(HalfEdges.of(mesh.faces, 300), mesh.vertices) < THIN
    assert thin.mean() <= 0.015


def test_refinement_brings_the_mesh_nearer_with_as_many_vertices(draft):
    before = draft.assigned().squared.sum()
    draft.refine(60, draft.assigned())
    assert 300 < draft.used() <= 360
    draft.collapse(300, False)
    draft.compact()
    draft.flip()
    assert draft.used() == len(draft.level) == len(np.unique(draft.level)) == 300
    assert np.array_equal(draft.vertices, draft.dense.raw[draft.level])
    assert faults(draft.mesh) == []
    assert draft.assigned().squared.sum() < before
    assert draft.thin() <= MOST_THIN


def test_moved_meshes_of_thin_noisy_parts_keep_together_by_relaxing(monkeypatch):
    cloud = gppcs.sample("fan", 10_000, noise=0.002)
    relaxed = gppcs.mesh(cloud, n_points=1000, moved=True)
    monkeypatch.setattr("gppcs.meshing.draft.RELAXATIONS", 0)
    other = gppcs.mesh(cloud, n_points=1000, moved=True)
    assert relaxed.diagnostics["pieces"] < other.diagnostics["pieces"]
    assert len(relaxed.indices) == 1000
    mesh = relaxed.mesh
    assert len(cutting(HalfEdges.of(mesh.faces, 1000), mesh.vertices)) == 0


@pytest.mark.slow
def test_mending_puts_vertices_elsewhere_for_those_it_removes(draft):
    before = draft.used()
    draft.vertices = draft.vertices.copy()
    draft.vertices[::40] *= -0.95
    cuts = len(cutting(draft.mesh, draft.vertices))
    draft.mend(counts_faces=False)
    assert cuts > 0 == len(cutting(draft.mesh, draft.vertices))
    assert draft.used() == before
    assert len(draft.level) > before
    assert faults(draft.mesh) == []
