"""What is put together is an oriented manifold; gaps are filled, holes are not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.clouds.topology import topology_of
from gppcs.meshing.assembly import are_taken, bridged, gap_fillings
from gppcs.meshing.filling import holes_filled
from gppcs.meshing.halfedges import HalfEdges, without_bow_ties
from meshing.test_coverage import cover_of
from shapes import ball, faults, sheet


@given(seed=st.integers(0, 10_000))
def test_any_triangles_become_a_manifold(seed):
    """Triangles of several triangulations of the same points, in any order, and random ones."""
    rng = np.random.default_rng(seed)
    _, _, faces = ball(60, seed)
    soup = np.concatenate([faces, rng.permutation(60)[faces][:30], rng.integers(0, 60, (100, 3))])
    soup = soup[(soup[:, 0] != soup[:, 1]) & (soup[:, 1] != soup[:, 2]) & (soup[:, 2] != soup[:, 0])]
    soup = rng.permutation(soup)
    chosen = without_bow_ties(HalfEdges.from_faces(soup[are_taken(soup, 60)], 60)).faces()
    assert faults(HalfEdges.from_faces(chosen, 60)) == []
    assert topology_of(chosen)[:2] == (0, 0)
    assert len(np.unique(np.sort(chosen), axis=0)) == len(chosen)


@pytest.mark.parametrize("seed", range(3))
def test_a_gap_that_points_cover_is_filled(seed):
    points, normals, faces = sheet(400, seed)
    inner = np.argmin(np.linalg.norm(points[:, :2] - 0.5, axis=1))
    mesh, (cover, _) = HalfEdges.from_faces(faces[(faces != inner).all(axis=1)], 400), cover_of(points, normals)
    filled = mesh.changed(new=gap_fillings(mesh, points, normals, cover.radii, cover, 12))
    assert faults(filled) == []
    assert topology_of(filled.faces()) == topology_of(faces)
    assert len(filled.faces()) == len(faces) - 2  # of a vertex less


def test_only_covered_gaps_are_filled_unless_the_holes_shall_be():
    points, normals, faces = sheet(2000, hole=0.3)
    mesh, (cover, _) = HalfEdges.from_faces(faces, len(points)), cover_of(points, normals)
    assert len(gap_fillings(mesh, points, normals, cover.radii, cover, 1000)) == 0
    closed = holes_filled(mesh, points, normals, 0.9)
    assert topology_of(closed.faces()).boundary_loops == 1
    assert faults(closed) == []
    assert np.array_equal(holes_filled(mesh, points, normals, 0.5).faces(), faces)


def parted(seed, lines):
    """A sheet cut along lines of constant x: its points, normals and triangles, and those that cross a line."""
    points, normals, faces = sheet(400, seed)
    strip = np.searchsorted(lines, points[:, 0])[faces]
    whole = (strip == strip[:, :1]).all(axis=1)
    return points, normals, without_bow_ties(HalfEdges.from_faces(faces[whole], len(points))).faces(), faces[~whole]


def joined_faces(faces, triangles, points, normals):
    """The triangles of a mesh whose pieces are joined."""
    cover, _ = cover_of(points, normals)
    mesh = HalfEdges.from_faces(faces, len(points))
    return bridged(mesh, triangles, points, normals, cover.radii, cover).faces()


@pytest.mark.parametrize("lines", [[0.5], [0.3, 0.6]])
@pytest.mark.parametrize("seed", range(3))
def test_pieces_side_by_side_become_one_without_holes_and_handles(seed, lines):
    points, normals, faces, crossing = parted(seed, lines)
    assert topology_of(faces).pieces > len(lines)
    joined = joined_faces(faces, crossing, points, normals)
    assert np.array_equal(joined[: len(faces)], faces)
    assert len(joined) == len(faces) + 2 * (topology_of(faces).pieces - 1)
    topology = topology_of(joined)
    assert (topology.pieces, topology.boundary_loops, topology.genus) == (1, 1, 0)
    assert faults(HalfEdges.from_faces(joined, len(points))) == []
    a, b, c = points[joined].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_a_gap_that_no_points_cover_stays_open():
    points, normals, faces, crossing = parted(0, [0.5])
    points[points[:, 0] > 0.5, 0] += 0.5
    assert np.array_equal(joined_faces(faces, crossing, points, normals), faces)
