"""Fans equal SciPy's Delaunay triangulation where the neighbourhood is plane."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from gppcs.meshing.fans import fans_of, turned_patches
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from shapes import sheet


def neighbours(points, k):
    tree = KdTree.build(points)
    near = np.empty((len(points), k), dtype=np.int64)
    near[tree.order] = tree.order[nearest_others(tree, k)[0]]
    return near


def canonical(triangles):
    """A set of triangles, each beginning at its lowest corner."""
    return {tuple(np.roll(t, -int(np.argmin(t)))) for t in triangles.tolist()}


@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_fans_in_a_plane_are_the_delaunay_triangulation(tilt):
    plane = np.random.default_rng(1).random((400, 2))
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
    points = np.column_stack([plane, np.zeros(400)]) @ turn
    normals = np.tile([0.0, 0.0, 1.0] @ turn, (400, 1))
    triangles, votes, radii = fans_of(points, normals, neighbours(points, 40))
    delaunay = Delaunay(plane).simplices
    inner = ((plane[delaunay] > 0.15) & (plane[delaunay] < 0.85)).all(axis=(1, 2))
    a, b, c = (plane[corner] for corner in delaunay.T)
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    delaunay[ux * vy < uy * vx] = delaunay[ux * vy < uy * vx][:, ::-1]
    assert canonical(delaunay[inner]) <= canonical(triangles[votes == 3])
    within = ((plane[triangles] > 0.15) & (plane[triangles] < 0.85)).all(axis=(1, 2))
    assert canonical(triangles[within]) <= canonical(delaunay)
    sides = np.linalg.norm(np.roll(points[triangles], 1, axis=1) - points[triangles], axis=2).prod(axis=1)
    areas = np.linalg.norm(np.cross(*(points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))), axis=1) / 2
    assert radii == pytest.approx(sides / (4 * areas))


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_fans_agree_on_grids(angle):
    """The corners of each square lie on a circle: all fans have the same of the two diagonals."""
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    points = np.column_stack([np.column_stack([x.ravel(), y.ravel()]) @ turn, np.zeros(400)])
    points = points[np.random.default_rng(0).permutation(400)]
    _, votes, _ = fans_of(points, np.tile([0.0, 0.0, 1.0], (400, 1)), neighbours(points, 24))
    assert (votes == 3).sum() == 2 * 19 * 19


def patches(wrong):
    """The points of a sheet, whose normals are turned where that is wanted, and what is turned back."""
    points, _, faces = sheet(400)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    turned = wrong(points)
    normals[turned] *= -1
    triangles = faces[turned[faces].all(axis=1) | ~turned[faces].any(axis=1)]
    near, _ = KdTree.build(points).nearest_of(points, 9)
    return turned, turned_patches(triangles, points, normals, near[:, 1:])


@pytest.mark.parametrize("wrong", [lambda points: points[:, 0] > 0.6, lambda points: np.arange(len(points)) % 40 == 7])
def test_the_smaller_patch_is_turned_and_points_that_no_triangle_joins_follow_their_neighbours(wrong):
    turned, actual = patches(wrong)
    assert np.array_equal(actual, turned)


@pytest.mark.parametrize("outside", [1.0, -1.0])
def test_fans_join_the_sides_of_a_sharp_edge(outside):
    """A right angle, seen from both sides: no cosine between the normals of its sides is above 0."""
    rng, n = np.random.default_rng(0), 800
    points, upright = rng.random((n, 3)), np.arange(n) % 2 == 0
    points[~upright, 2], points[upright, 0] = 0.0, 0.0
    points[upright, 2] *= -1.0
    normals = outside * np.where(upright[:, None], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    triangles, _, _ = fans_of(points, normals, neighbours(points, 24))
    across = triangles[np.ptp(upright[triangles].astype(int), axis=1) == 1]
    along = points[across].mean(axis=1)[:, 1]
    assert np.histogram(along, bins=10, range=(0.0, 1.0))[0].min() > 0
