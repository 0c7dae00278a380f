"""An exchange costs and gains what was said, and keeps the number of vertices and the topology."""

import numpy as np
import pytest

from gppcs.clouds.topology import topology_of
from gppcs.meshing import exchange as module
from gppcs.meshing.dense import DensePoints
from gppcs.meshing.draft import Draft
from gppcs.meshing.exchange import exchange, split_edge
from gppcs.meshing.halfedges import HalfEdges
from meshes import energy, surface_of
from shapes import ball, faults, hull, random_mesh, sheet


@pytest.mark.parametrize("seed", range(6))
def test_a_split_keeps_the_topology(seed):
    points, _, mesh = random_mesh(seed)
    before, size = topology_of(mesh.faces()), len(mesh.faces())
    mesh = HalfEdges(
        np.append(mesh.origin, np.full(60, -1)), np.append(mesh.opposite, np.full(60, -1)),
        np.append(mesh.leaving, np.full(10, -1)),
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    for k in range(10):
        h = rng.choice(mesh.inner_edges())
        free = size + 2 * k
        split_edge(mesh, h, len(points) + k, (h // 3, free, mesh.opposite[h] // 3, free + 1))
    assert faults(mesh) == []
    assert topology_of(mesh.faces()) == before
    assert len(mesh.faces()) == size + 20
    assert np.count_nonzero(mesh.leaving >= 0) == len(points) + 10


def unmarked(surface):
    """Marks of triangles of which none is set."""
    return np.zeros(len(surface.first), dtype=np.bool_)


@pytest.fixture(params=[ball, sheet])
def fine(request):
    """A mesh of 120 vertices with dense points, and a point for each vertex."""
    points, _, faces = request.param(120)
    dense, normals, _ = request.param(4000, seed=1)
    surface = surface_of(points, faces, dense, normals)
    return surface, np.arange(120)


def test_one_collapse_and_one_split_change_the_energy_as_said(fine):
    surface, level = fine
    for trial, change in ((module.try_collapses, 1), (module._try_splits, -1)):
        edges, before = surface.mesh.inner_edges(), energy(surface, 1e-4)
        said = module.tried(trial, surface, edges, 1e-4)
        best = np.argsort(said, kind="stable")[:1]
        vertices = np.count_nonzero(surface.mesh.leaving >= 0)
        if change == 1:
            assert module._collapse_all(surface, edges[best], level, 1e-4, unmarked(surface)) == 1
        else:
            assert module._split_all(surface, edges[best], level, 1e-4, 1, unmarked(surface)) == 1
            assert said[best[0]] < 0
        assert np.count_nonzero(surface.mesh.leaving >= 0) == vertices - change
        borders = said[best[0]] - (energy(surface, 1e-4) - before)
        assert -1e-9 <= borders < 0.05 * before + 1e-9
        assert faults(surface.mesh) == []


@pytest.mark.parametrize("rough", [0.0, 0.06])
def test_after_collapses_stale_splits_alone_differ(fine, rough):
    surface, level = fine
    surface.vertices[:] += rough * np.random.default_rng(0).standard_normal(surface.vertices.shape)
    edges, rises, stale = surface.mesh.inner_edges(), np.empty(len(surface.mesh.origin)), ~unmarked(surface)
    module._try_stale_splits(surface, edges, 1e-4, rises, stale)
    cheapest = np.argsort(module.tried(module.try_collapses, surface, edges, 1e-4), kind="stable")[:40]
    assert module._collapse_all(surface, edges[cheapest], level, 1e-4, stale) > 1
    assert 0 < np.count_nonzero(stale) < len(stale)
    edges = surface.mesh.inner_edges()
    module._try_stale_splits(surface, edges, 1e-4, rises, stale)
    np.testing.assert_array_equal(rises[edges], module.tried(module._try_splits, surface, edges, 1e-4))


def test_an_exchange_lowers_the_energy_with_as_many_vertices(fine):
    surface, level = fine
    before, topology, faces = energy(surface, 1e-4), topology_of(surface.mesh.faces()), len(surface.mesh.faces())
    exchange(surface, level, 1e-4)
    assert energy(surface, 1e-4) < 0.8 * before
    assert np.count_nonzero(surface.mesh.leaving >= 0) == len(np.unique(level)) == 120
    assert len(surface.mesh.faces()) == faces
    assert topology_of(surface.mesh.faces()) == topology
    assert faults(surface.mesh) == []


def test_a_draft_is_left_as_it_was_and_another_one_is_nearer():
    points, _, _ = ball(4000)
    dense = DensePoints.from_points(points, 300, np.empty(0, dtype=np.int64))
    level = np.arange(0, 3900, 13)
    draft = Draft.of(dense, True, level, np.zeros(300, dtype=bool), hull(dense.places[level]))
    assigned = draft.flip()
    vertices, faces, before = draft.vertices.copy(), draft.mesh.faces().copy(), assigned.mean_square()
    other, after = draft.exchanged(assigned)
    assert np.array_equal(draft.vertices, vertices)
    assert np.array_equal(draft.mesh.faces(), faces)
    assert other.used() == 300
    assert after.mean_square() < 0.5 * before
    assert other.assigned().mean_square() <= after.mean_square() * (1 + 1e-9)
