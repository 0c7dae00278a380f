"""Splits keep the topology, and go where the dense points are farthest off."""

import numpy as np
import pytest

from gppcs.clouds.topology import topology_of
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.halfedges import HalfEdges
from gppcs.meshing.refinement import farthest_points_of, split
from shapes import faults, random_mesh

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("seed", range(3))
def test_splits_keep_the_topology(seed):
    _, _, mesh = random_mesh(seed)
    count = len(mesh.faces())
    faces = np.flatnonzero(np.random.default_rng(seed).random(count) < 0.3)
    after = split(mesh, faces)
    assert faults(after) == []
    assert topology_of(after.faces()) == topology_of(mesh.faces())
    assert len(after.faces()) == count + 2 * len(faces)
    new = np.arange(len(mesh.leaving), len(mesh.leaving) + len(faces))
    for vertex, face in zip(new, faces, strict=True):
        ring = after.faces()[(after.faces() == vertex).any(axis=1)]
        assert set(ring.ravel()) == {*mesh.faces()[face], vertex}


def test_the_worst_triangles_come_with_their_farthest_points():
    mesh = HalfEdges.from_faces(HALVES, 4)
    points = np.array([[0.7, 0.3, 0.1], [0.6, 0.3, 0.3], [0.3, 0.7, 0.2], [0.5, 0.025, 0.9]])
    upright = np.tile([0.0, 0.0, 1.0], (4, 1))
    assigned = Assignment.on_same_sheet(mesh, SQUARE, points, upright, np.zeros(4, dtype=np.int64))
    every = np.ones(4, dtype=bool)
    assert [indices.tolist() for indices in farthest_points_of(mesh, assigned, every, 9)] == [[0, 1], [1, 2]]
    assert [indices.tolist() for indices in farthest_points_of(mesh, assigned, every, 1)] == [[0], [1]]
    without = np.array([True, False, True, True])
    assert [indices.tolist() for indices in farthest_points_of(mesh, assigned, without, 9)] == [[0, 1], [0, 2]]
