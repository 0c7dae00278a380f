"""Flips never raise the energy, and keep the mesh a manifold of the same topology."""

import numpy as np
import pytest

from gppcs.clouds.topology import topology_of
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.flips import THIN_IN_FLIPS, flip, flip_edge, is_flippable, qualities
from gppcs.meshing.halfedges import HalfEdges
from shapes import ball, faults, random_mesh, room_around, sheet


@pytest.mark.parametrize("seed", range(9))
def test_any_flip_that_is_allowed_keeps_the_topology(seed):
    points, normals, mesh = random_mesh(seed)
    before = topology_of(mesh.faces())
    halves, flips = room_around()[0], 0
    for h in np.random.default_rng(seed).integers(0, len(mesh.origin), 200):
        if is_flippable(mesh, points, normals, h, halves):
            flip_edge(mesh, h)
            flips += 1
    assert flips > 10
    assert faults(mesh) == []
    assert topology_of(mesh.faces()) == before
    assert len(np.unique(np.sort(mesh.faces()), axis=0)) == before.pieces * len(mesh.faces())


def energy(mesh, vertices, assigned, extra):
    """What flips lower."""
    lack = np.maximum(0.0, 1.0 - qualities(mesh, vertices) / THIN_IN_FLIPS)
    return assigned.squared.sum() + extra * lack.sum()


@pytest.mark.parametrize("extra", [0.0, 1e-3, 0.1])
@pytest.mark.parametrize("shape", [ball, sheet])
def test_flips_lower_the_energy_that_they_say(shape, extra):
    points, normals, faces = shape(150)
    mesh = HalfEdges.of(faces, len(points))
    halves, _ = room_around()
    for h in np.random.default_rng(2).integers(0, len(mesh.origin), 30):  # so that something is to be mended
        if is_flippable(mesh, points, normals, h, halves):
            flip_edge(mesh, h)
    dense, dense_normals, _ = shape(3000, seed=1)
    start = np.argmin(((dense[:, None] - points) ** 2).sum(axis=2), axis=1)
    assigned = Assignment.of(mesh, points, dense, dense_normals, start)
    before = energy(mesh, points, assigned, extra)
    flips = flip(mesh, points, normals, dense, assigned, extra)
    after = energy(mesh, points, assigned, extra)
    assert flips > 0
    assert after < before
    assert faults(mesh) == []
    again = Assignment.of(mesh, points, dense, dense_normals, start)
    assert energy(mesh, points, again, extra) <= after * (1 + 1e-9)  # each point at its nearest triangle: no more
    flip(mesh, points, normals, dense, again, extra)
    assert energy(mesh, points, again, extra) <= after * (1 + 1e-9)
