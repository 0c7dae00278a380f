"""An exchange costs and gains what was computed, and keeps the number of vertices and the topology."""

import numpy as np
import pytest

from gppcs.clouds.topology import topology_of
from gppcs.meshing import exchange as module
from gppcs.meshing.cuts import TriangleTree
from gppcs.meshing.exchange import changes, collapse_all, exchange, split_edge
from gppcs.meshing.halfedges import HalfEdges
from meshes import energy, fitted_mesh
from shapes import ball, faults, random_mesh, sheet

NO_TREE, THIN_COST = TriangleTree.empty(), 1e-4


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
        split_edge(mesh, h, len(points) + k, np.array([h // 3, free, mesh.opposite[h] // 3, free + 1]))
    assert faults(mesh) == []
    assert topology_of(mesh.faces()) == before
    assert len(mesh.faces()) == size + 20
    assert np.count_nonzero(mesh.leaving >= 0) == len(points) + 10


@pytest.fixture(params=[ball, sheet])
def fine(request):
    """A mesh of 120 vertices with dense points, and a point for each vertex."""
    points, _, faces = request.param(120)
    dense, normals, _ = request.param(4000, seed=1)
    return fitted_mesh(points, faces, dense, normals), np.arange(120)


def collapse_cheapest(fitted, dense_index, count):
    """Collapse the cheapest edges; return their costs, how many were collapsed, and what has changed."""
    edges, changed = fitted.mesh.inner_edges(), np.zeros(len(fitted.vertices), dtype=np.bool_)
    costs = np.full(len(fitted.mesh.origin), np.inf)
    costs[edges] = changes(fitted, edges, THIN_COST, split=False)
    best = edges[np.argsort(costs[edges], kind="stable")[:count]]
    expected = costs[best]
    return expected, collapse_all(fitted, NO_TREE, best, dense_index, THIN_COST, costs, changed), changed


@pytest.mark.parametrize("change", [1, -1])
def test_one_collapse_and_one_split_change_the_energy_as_computed(fine, change):
    fitted, dense_index = fine
    before, n_vertices = energy(fitted, THIN_COST), np.count_nonzero(fitted.mesh.leaving >= 0)
    if change == -1:  # a split takes the numbers of removed triangles
        collapse_cheapest(fitted, dense_index, 1)
        before, n_vertices = energy(fitted, THIN_COST), n_vertices - 1
        edges, changed = fitted.mesh.inner_edges(), np.zeros(len(fitted.vertices), dtype=np.bool_)
        rises = changes(fitted, edges, THIN_COST, split=True)
        best = np.argsort(rises, kind="stable")[:1]
        expected = rises[best]
        assert module._split_all(fitted, NO_TREE, edges[best], dense_index, THIN_COST, 1, changed) == 1
        assert expected[0] < 0
    else:
        expected, count, _ = collapse_cheapest(fitted, dense_index, 1)
        assert count == 1
    assert np.count_nonzero(fitted.mesh.leaving >= 0) == n_vertices - change
    of_boundaries = expected[0] - (energy(fitted, THIN_COST) - before)
    assert -1e-9 <= of_boundaries < 0.05 * before + 1e-9
    assert faults(fitted.mesh) == []


def test_an_exchange_lowers_the_energy_with_as_many_vertices(fine):
    fitted, dense_index = fine
    before, topology, faces = energy(fitted, THIN_COST), topology_of(fitted.mesh.faces()), len(fitted.mesh.faces())
    exchange(fitted, dense_index, THIN_COST)
    assert energy(fitted, THIN_COST) < 0.8 * before
    assert np.count_nonzero(fitted.mesh.leaving >= 0) == len(np.unique(dense_index)) == 120
    assert len(fitted.mesh.faces()) == faces
    assert topology_of(fitted.mesh.faces()) == topology
    assert faults(fitted.mesh) == []
