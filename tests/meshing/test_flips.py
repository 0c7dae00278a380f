"""Flips never raise the energy, and keep the mesh a manifold of the same topology."""

import numpy as np
import pytest

from gppcs.clouds.topology import topology_of
from gppcs.meshing.cuts import TriangleTree
from gppcs.meshing.flips import flip_all, flipped, is_flippable
from gppcs.meshing.halfedges import HalfEdges, replace_triangles, room_for_ring
from meshes import energy, fitted_mesh
from shapes import ball, faults, random_mesh, sheet


@pytest.mark.parametrize("seed", range(9))
def test_any_flip_that_is_allowed_keeps_the_topology(seed):
    points, normals, mesh = random_mesh(seed)
    before = topology_of(mesh.faces())
    halves, flips = room_for_ring()[0], 0
    for h in np.random.default_rng(seed).integers(0, len(mesh.origin), 200):
        if is_flippable(mesh, points, normals, h, halves):
            replace_triangles(mesh, *flipped(mesh, h))
            flips += 1
    assert flips > 10
    assert faults(mesh) == []
    assert topology_of(mesh.faces()) == before
    assert len(np.unique(np.sort(mesh.faces()), axis=0)) == before.pieces * len(mesh.faces())


@pytest.mark.parametrize("thin_cost", [0.0, 1e-3, 0.1])
@pytest.mark.parametrize("shape", [ball, sheet])
def test_flips_lower_the_energy(shape, thin_cost):
    points, normals, faces = shape(150)
    mesh = HalfEdges.from_faces(faces, len(points))
    halves, _ = room_for_ring()
    for h in np.random.default_rng(2).integers(0, len(mesh.origin), 30):  # so that something is to be mended
        if is_flippable(mesh, points, normals, h, halves):
            replace_triangles(mesh, *flipped(mesh, h))
    dense, dense_normals, _ = shape(3000, seed=1)
    fitted, tree = fitted_mesh(points, mesh.faces(), dense, dense_normals), TriangleTree.empty()
    before = energy(fitted, thin_cost)
    assert flip_all(fitted, tree, normals, thin_cost, 8) > 0
    after = energy(fitted, thin_cost)
    assert after < before
    assert faults(fitted.mesh) == []
    again = fitted_mesh(points, fitted.mesh.faces(), dense, dense_normals)
    assert energy(again, thin_cost) <= after * (1 + 1e-9)  # each point at its nearest triangle: no more
    flip_all(again, tree, normals, thin_cost, 8)
    assert energy(again, thin_cost) <= after * (1 + 1e-9)
