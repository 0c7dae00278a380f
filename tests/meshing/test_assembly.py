"""What is put together is an oriented manifold; gaps are filled, holes are not."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.clouds.topology import topology_of
from gppcs.meshing.assembly import are_taken, bridged, gap_fillings
from gppcs.meshing.filling import BEND, LENGTH, boundary_loops, holes_filled
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


def test_triangles_of_a_manifold_are_all_taken():
    _, _, faces = ball(100)
    assert np.array_equal(
        are_taken(np.concatenate([faces, faces[:, [0, 2, 1]]]), 100), np.arange(2 * len(faces)) < len(faces)
    )


@pytest.mark.parametrize("hole", [0.0, 0.2])
def test_borders_run_around_the_mesh_and_its_holes(hole):
    points, _, faces = sheet(300, hole=hole)
    loops = boundary_loops(HalfEdges.from_faces(faces, len(points)))
    edges = {(a, b) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True)}
    for loop in loops:
        for a, b in zip(loop, np.roll(loop, -1), strict=True):
            assert (b, a) in edges
            assert (a, b) not in edges
    assert len(loops) == topology_of(faces).boundary_loops == (2 if hole else 1)


def triangulations(corners):
    """All triangulations of a polygon."""
    if len(corners) < 3:
        yield []
        return
    for m in range(1, len(corners) - 1):
        for left, right in itertools.product(triangulations(corners[: m + 1]), triangulations(corners[m:])):
            yield [*left, *right, (corners[0], corners[m], corners[-1])]


def cost(points, triangle):
    a, b, c = (points[v] for v in triangle)
    product = np.cross(b - a, c - a)
    doubled = np.linalg.norm(product)
    bend = (1 - min(product[2] / doubled, 1)) ** 2
    return doubled / 2 * (1 + BEND * bend) + LENGTH * max(((b - a) ** 2).sum(), ((a - c) ** 2).sum())


@pytest.mark.parametrize("seed", range(5))
def test_a_gap_is_filled_by_the_cheapest_triangles(seed):
    points, normals, faces = sheet(400, seed)
    points[:, 2] += 0.03 * np.random.default_rng(seed).random(len(points))
    inner = np.argmin(np.linalg.norm(points[:, :2] - 0.5, axis=1))
    around = faces[(faces == inner).any(axis=1)]
    left = faces[(faces != inner).all(axis=1)]
    cover, _ = cover_of(points, normals)
    mesh = HalfEdges.from_faces(left, len(points))
    new = gap_fillings(mesh, points, normals, cover.radii, cover, 12)
    assert len(new) == len(around) - 2
    loops = boundary_loops(mesh)
    loop = next(part for part in loops if set(part) == set(around.ravel()) - {inner})
    edges = {frozenset(pair) for face in left for pair in itertools.combinations(face, 2)}
    costs = [
        sum(cost(points, t) for t in triangles)
        for triangles in triangulations(loop.tolist())
        if not any(
            frozenset(pair) in edges
            and abs(list(loop).index(pair[0]) - list(loop).index(pair[1])) not in (1, len(loop) - 1)
            for t in triangles
            for pair in itertools.combinations(t, 2)
        )
    ]
    assert sum(cost(points, t) for t in new) == pytest.approx(min(costs))


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
