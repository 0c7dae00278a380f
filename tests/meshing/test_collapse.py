"""Collapses keep the link condition: the topology of random meshes does not change."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gppcs.clouds.topology import topology_of
from gppcs.meshing.collapse import is_allowed, move_triangles
from gppcs.meshing.halfedges import HalfEdges, neighbours, room_for_ring
from shapes import faults, random_mesh


@given(seed=st.integers(0, 10_000), choice=st.integers(0, 2**32))
def test_allowed_collapses_keep_the_topology(seed, choice):
    """Any allowed collapse, not only a cheap one, and many in a row."""
    _, _, mesh = random_mesh(seed)
    before = topology_of(mesh.faces())
    rng = np.random.default_rng(choice)
    halves, found = room_for_ring()
    others, beyond = room_for_ring()
    made = 0
    for v in rng.integers(0, len(mesh.leaving), 150):
        count, edges, closed = neighbours(mesh, v, halves, found)
        if count == 0:
            continue
        slot = int(rng.integers(count))
        left = np.count_nonzero(mesh.leaving >= 0)
        if is_allowed(mesh, v, slot, count, edges, closed, halves, found, others, beyond):
            move_triangles(mesh, v, found[slot], halves)
            made += 1
            assert np.count_nonzero(mesh.leaving >= 0) == left - 1
            assert faults(mesh) == []
    assert made > 10
    assert topology_of(mesh.faces()) == before


def test_collapses_that_change_the_topology_are_not_allowed():
    """Every collapse of small meshes that is refused would leave a mesh that is no manifold or has another topology."""
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    strip = np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4]])
    for faces, n in ((tetrahedron, 4), (strip, 5), (np.array([[0, 1, 2]]), 3)):
        mesh = HalfEdges.from_faces(faces, n)
        halves, found = room_for_ring()
        for v in range(n):
            count, edges, closed = neighbours(mesh, v, halves, found)
            for slot in range(count):
                u = found[slot]
                left = np.where(faces == v, u, faces)
                left = left[(left[:, 0] != left[:, 1]) & (left[:, 1] != left[:, 2]) & (left[:, 2] != left[:, 0])]
                same = len(left) > 0 and topology_of(left) == topology_of(faces)
                same = same and len(np.unique(left)) == n - 1
                same = same and len(np.unique(np.sort(left), axis=0)) == len(left)
                others, beyond = room_for_ring()
                assert is_allowed(mesh, v, slot, count, edges, closed, halves, found, others, beyond) == same, (v, u)
