"""Half-edges: the connections and the ways around vertices, against plain searches."""

import numpy as np
import pytest

from gppcs.meshing.halfedges import HalfEdges, around, neighbours, replace_triangles, room_for_ring
from shapes import ball, random_mesh


@pytest.mark.parametrize("seed", range(3))
def test_neighbours_are_those_of_the_triangles_in_order(seed):
    _, _, mesh = random_mesh(seed)
    faces = mesh.faces()
    halves, found = room_for_ring()
    for v in range(len(mesh.leaving)):
        count, edges, closed = neighbours(mesh, v, halves, found)
        at = faces[(faces == v).any(axis=1)]
        assert set(found[:count]) == set(at.ravel()) - {v}
        assert edges == len(at)
        assert closed == (count == edges)
        for slot in range(edges):  # v and two successive neighbours are a triangle
            corners = [v, found[slot], found[(slot + 1) % count]]
            assert any(np.array_equal(np.roll(corners, k), face) for k in range(3) for face in at)
        assert around(mesh, v, halves) == (edges, closed)


@pytest.mark.parametrize("seed", range(3))
def test_dropped_and_added_triangles_are_connected_as_from_the_start(seed):
    points, _, faces = ball(80, seed)
    first, kept = faces[:100], np.random.default_rng(seed).random(100) < 0.8
    changed = HalfEdges.from_faces(first, len(points)).changed(kept, faces[100:])
    expected = HalfEdges.from_faces(np.concatenate([first[kept], faces[100:]]), len(points))
    assert all(np.array_equal(part, other) for part, other in zip(changed, expected, strict=True))


def test_removed_triangles_are_dropped_when_others_are_added():
    points, _, faces = ball(80)
    mesh, removed = HalfEdges.from_faces(faces[:100], len(points)), np.arange(0, 100, 7)
    for f in removed:
        replace_triangles(mesh, np.array([f]), np.empty((0, 3), dtype=np.int64))
    expected = HalfEdges.from_faces(np.concatenate([np.delete(faces[:100], removed, axis=0), faces[100:]]), len(points))
    assert all(np.array_equal(*parts) for parts in zip(mesh.changed(new=faces[100:]), expected, strict=True))
