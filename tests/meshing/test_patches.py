"""Patches of a surface tell each other the signs of their normals."""

import numpy as np

from gppcs.meshing.fans import turned_patches
from gppcs.spatial.kdtree import KdTree
from shapes import sheet


def patches(wrong):
    """The points of a sheet, whose normals are turned where that is wanted, and what is turned back."""
    points, _, faces = sheet(400)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    turned = wrong(points)
    normals[turned] *= -1
    triangles = faces[turned[faces].all(axis=1) | ~turned[faces].any(axis=1)]
    near, _ = KdTree.build(points).nearest_of(points, 9)
    return turned, turned_patches(triangles, points, normals, near[:, 1:])


def test_the_smaller_patch_is_turned():
    turned, found = patches(lambda points: points[:, 0] > 0.6)
    assert np.array_equal(found, turned)


def test_points_that_no_triangle_joins_follow_their_neighbours():
    turned, found = patches(lambda points: np.arange(len(points)) % 40 == 7)
    assert np.array_equal(found, turned)


def test_patches_that_meet_nowhere_keep_their_signs():
    points, _, faces = sheet(100)
    n = len(points)
    both = np.concatenate([points, points + np.array([3.0, 0.0, 0.0])])
    normals = np.repeat([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], n, axis=0)
    near, _ = KdTree.build(both).nearest_of(both, 9)
    assert not turned_patches(np.concatenate([faces, faces + n]), both, normals, near[:, 1:]).any()
