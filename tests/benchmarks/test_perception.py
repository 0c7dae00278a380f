"""The stand-in for the eye sees a mesh from all sides, and tells a good copy of it from a bad one."""

import numpy as np
import pytest

from meshes import hull_mesh

pytest.importorskip("pyvista")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def perception(script):
    return script("perception.py")


@pytest.fixture(scope="module")
def egg():
    directions = np.random.default_rng(0).standard_normal((2000, 3))
    return hull_mesh(directions / np.linalg.norm(directions, axis=1, keepdims=True) * [1, 2, 3])


def test_each_view_shows_what_faces_it(perception, egg):
    """Of a convex body only faces turned to the camera are seen; an old picture in new axes shows others."""
    maps = perception.normal_maps(egg, egg)
    covered = [normals.any(axis=2) for normals in maps]
    assert len({mask.tobytes() for mask in covered}) == perception.VIEWS
    for normals, mask in zip(maps, covered, strict=True):
        assert np.quantile(normals[mask][:, 2], 0.01) > 0
        np.testing.assert_allclose(np.linalg.norm(normals[mask], axis=1), 1, atol=1e-6)


def test_the_differences_grow_with_the_damage(perception, egg):
    original = perception.normal_maps(egg, egg)
    assert perception.looks(original, original) == pytest.approx((0, 0), abs=1e-3)
    pairs = [
        perception.looks(perception.normal_maps(hull_mesh(egg.vertices[:kept]), egg), original) for kept in (500, 50)
    ]
    assert 0 < pairs[0][0] < pairs[1][0]
    assert 0 < pairs[0][1] < pairs[1][1]
