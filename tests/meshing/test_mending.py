"""A mended mesh has no triangles that cut others, is a manifold, and keeps the handles and borders of the surface."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from gppcs.clouds.topology import topology_of
from gppcs.meshing import mending
from gppcs.meshing.cuts import TriangleTree, cutting
from gppcs.meshing.filling import boundary_loops, fillings, holes_filled
from gppcs.meshing.halfedges import HalfEdges
from gppcs.meshing.mending import cut_out, mend, relax
from scans import sample
from shapes import ball, faults, random_mesh, sheet


def no_vertex(points):
    return np.zeros(len(points), dtype=bool)


def crumpled(seed):
    """A ball some of whose points lie so far inside that their triangles cut others."""
    points, normals, faces = ball(300, seed)
    points = points.copy()
    points[::60] *= -0.95
    return points, normals, faces


def two_sheets():
    """A sheet over another, with a spike that goes through that one."""
    points, normals, faces = sheet(400)
    lower = points - [0.0, 0.0, 0.3]
    spike = np.argmin(np.linalg.norm(points[:, :2] - 0.5, axis=1))
    points = points.copy()
    points[spike, 2] -= 0.5
    return np.concatenate([points, lower]), np.concatenate([normals, normals]), np.concatenate([faces, faces + 400])


def torn_border():
    """A sheet with a hole, of which a point lies far from its neighbours."""
    points, normals, faces = sheet(400, hole=0.2)
    points[np.argmin(np.linalg.norm(points[:, :2] - 0.15, axis=1)), :2] += 0.5
    return points, normals, faces


@pytest.mark.parametrize(
    ("damaged", "lost"), [*((crumpled(seed), 30) for seed in range(4)), (two_sheets(), 1), (torn_border(), 1)]
)
def test_mending_keeps_the_topology_and_leaves_no_cut(damaged, lost):
    points, normals, faces = damaged
    mesh = HalfEdges.from_faces(faces, len(points))
    assert len(cutting(mesh, points)) > 0
    into, _ = mend(mesh, points, normals, no_vertex(points), TriangleTree.from_mesh(mesh, points))
    used = np.unique(mesh.faces())
    assert faults(mesh) == []
    assert topology_of(mesh.faces()) == topology_of(faces)
    assert len(points) - lost <= len(used) < len(points)
    assert set(into) == set(used)
    assert len(cutting(mesh, points)) == 0


def folded_strip():
    """A strip of two rows of points, one of which lies so far ahead that its triangles cut those there."""
    x, y = np.meshgrid(np.arange(12.0), [0.0, 1.0], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(24)])
    row = 2 * np.arange(11)[:, None]
    faces = (row + np.array([[0, 2, 1, 1, 2, 3]])).reshape(-1, 3)
    points[8] = 9.0, 1.5, 0.0
    return points, np.tile([0.0, 0.0, 1.0], (24, 1)), faces


def test_relaxed_corners_cut_nothing_where_no_patch_does_and_the_mesh_stays_whole():
    points, normals, faces = folded_strip()
    mesh, kept = HalfEdges.from_faces(faces, len(points)), no_vertex(points)
    _, cut = mend(mesh, points, normals, kept, TriangleTree.from_mesh(mesh, points))
    assert topology_of(cut_out(mesh, points, normals)[0].faces()).pieces > 1
    for _ in range(12):
        relax(mesh, points, np.unique(mesh.corners()[cut]))
        _, cut = mend(mesh, points, normals, kept, TriangleTree.from_mesh(mesh, points))
    assert len(cut) == 0
    assert topology_of(mesh.faces()) == topology_of(faces)


def test_a_mesh_without_cuts_is_not_changed():
    points, normals, faces = ball(200)
    mesh = HalfEdges.from_faces(faces, 200)
    mend(mesh, points, normals, no_vertex(points), TriangleTree.from_mesh(mesh, points))
    left, holes = cut_out(mesh, points, normals)
    assert np.array_equal(mesh.faces(), faces)
    assert np.array_equal(left.faces(), faces)
    assert holes == 0


@given(seed=st.integers(0, 10_000), share=st.floats(0.01, 0.5), depth=st.floats(-2.0, 2.0))
def test_planted_cuts_all_go(seed, share, depth):
    """Points of balls and sheets leave their places, so that their triangles cut others in any way."""
    points, normals, mesh = random_mesh(seed)
    rng = np.random.default_rng(seed)
    some = rng.random(len(points)) < share
    points = points + depth * some[:, None] * rng.standard_normal(points.shape)
    mend(mesh, points, normals, no_vertex(points), TriangleTree.from_mesh(mesh, points))
    assert faults(mesh) == []
    mended, holes = cut_out(mesh, points, normals)
    topology = topology_of(mended.faces())
    assert faults(mended) == []
    assert topology[:2] == (0, 0)
    assert len(cutting(mended, points)) == 0
    assert holes == 0 or topology.boundary_loops > 0


def test_a_hole_is_not_closed_through_another_part():
    points, normals, faces = sheet(2000, hole=0.2)
    flap = np.array([[0.5, 0.5, -0.2], [0.45, 0.55, 0.3], [0.55, 0.55, 0.3]])
    both = np.concatenate([points, flap]), np.concatenate([normals, np.tile([0.0, -1.0, 0.0], (3, 1))])
    mesh = HalfEdges.from_faces(faces, len(points))
    assert topology_of(holes_filled(mesh, points, normals, 0.9).faces()).boundary_loops == 1
    pierced = np.concatenate([faces, [[len(points), len(points) + 1, len(points) + 2]]])
    mesh = HalfEdges.from_faces(pierced, len(both[0]))
    loops = [loop for loop in boundary_loops(mesh) if len(loop) > 3]
    assert len(fillings(mesh, *both, loops)[0]) > 0
    after = holes_filled(mesh, *both, 0.9).faces()
    assert np.array_equal(after[: len(pierced)], pierced)
    assert topology_of(after).boundary_loops == topology_of(pierced).boundary_loops


@pytest.mark.parametrize("n_points", [400, 500])
def test_vertices_are_added_by_distances_from_triangles_as_they_are_after_relaxation(monkeypatch, n_points):
    add, calls = mending._add, []

    def checked(draft, assigned, count):
        covered = assigned.face >= 0
        a, b, c = draft.vertices[draft.mesh.corners()[assigned.face[covered]]].transpose(1, 0, 2)
        v, w = assigned.weights[covered].T[:, :, None]
        steps = a + v * (b - a) + w * (c - a) - draft.dense.positions[covered]
        np.testing.assert_allclose((steps**2).sum(axis=1), assigned.squared[covered], rtol=1e-9, atol=1e-15)
        calls.append(count)
        add(draft, assigned, count)

    monkeypatch.setattr(mending, "_add", checked)
    gppcs.mesh(sample("room", 10_000), n_points=n_points, moved=True)
    assert calls
