"""Triangles are covered where the points are, and only there."""

import numpy as np
import pytest

from gppcs.meshing.coverage import RANK, SPAN, Cover, are_covered
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others


def cover_of(points, normals):
    tree = KdTree.build(points)
    reaches = np.sqrt(nearest_others(tree, RANK)[1][:, -1])
    return Cover(tree.points, tree.lower, tree.upper, np.ascontiguousarray(normals[tree.order]), reaches), tree


@pytest.fixture(scope="module")
def with_hole():
    """A random square of spacing 0.007 with a round hole of radius 0.25."""
    plane = np.random.default_rng(0).random((20_000, 2))
    plane = plane[np.linalg.norm(plane - 0.5, axis=1) > 0.25]
    points = np.column_stack([plane, np.zeros(len(plane))])
    cover, tree = cover_of(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))
    return np.ascontiguousarray(tree.points.T), cover


def test_triangles_over_a_hole_are_not_covered(with_hole):
    points, cover = with_hole
    rng = np.random.default_rng(1)
    first = rng.integers(0, len(points), 3000)
    near = KdTree.build(points).nearest_of(points[first], 400)[0]
    small = np.column_stack([first, near[np.arange(3000), rng.integers(1, 400, 3000)], near[:, 399]])
    triangles = np.concatenate([small, rng.integers(0, len(points), (3000, 3))])
    covered = are_covered(cover, triangles, points, cover.radii)
    share = rng.dirichlet(np.ones(3), 200)
    places = np.einsum("sk,tkx->tsx", share, points[triangles])[..., :2]
    inside = 0.25 - np.linalg.norm(places - 0.5, axis=2).min(axis=1)  # how far the hole reaches into a triangle
    outside = inside < -0.02
    reach = SPAN * cover.radii.max()
    assert outside.sum() > 500
    assert (inside > 2 * reach).sum() > 50
    assert covered[outside].mean() > 0.999  # random samples have gaps, but hardly any of this size
    assert not covered[inside > 2 * reach].any()
