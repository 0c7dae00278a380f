"""Pieces of a mesh that lie side by side are joined where points cover the gap."""

import numpy as np
import pytest

from gppcs.clouds.topology import topology_of
from gppcs.meshing.assembly import bridged
from gppcs.meshing.halfedges import HalfEdges, without_bow_ties
from meshing.test_coverage import cover_of
from shapes import faults, sheet


def parted(seed, lines):
    """A sheet cut along lines of constant x: its points, normals and triangles, and those that cross a line."""
    points, normals, faces = sheet(400, seed)
    strip = np.searchsorted(lines, points[:, 0])[faces]
    whole = (strip == strip[:, :1]).all(axis=1)
    return points, normals, without_bow_ties(faces[whole], len(points)).faces(), faces[~whole]


def joined_faces(faces, triangles, points, normals):
    """The triangles of a mesh whose pieces are joined."""
    cover, _ = cover_of(points, normals)
    mesh = HalfEdges.from_faces(faces, len(points))
    return bridged(mesh, triangles, points, normals, cover.reaches, cover).faces()


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
