import numpy as np
import pytest
from scipy.spatial import cKDTree

from gppcs.kdtree import KdTree
from gppcs.noise import NEIGHBOURS, residuals, variances

RANDOM = np.random.default_rng(0)


def rough_plane(sigma, n=20_000):
    return np.column_stack([RANDOM.random((n, 2)), sigma * RANDOM.standard_normal(n)])


def test_smooth_surfaces_are_quiet(sphere):
    """Found, in the unit of the sphere's radius: 2.5e-7, and 1e-4 for a twentieth of the points."""
    assert variances(KdTree.build(sphere), 0.01) == (None, pytest.approx(0, abs=1e-6))
    assert variances(KdTree.build(sphere[::20]), 0.05) == (None, pytest.approx(0, abs=5e-4))
    assert variances(KdTree.build(rough_plane(0.0)), 0.01) == (None, pytest.approx(0, abs=1e-12))


@pytest.mark.parametrize("sigma", [0.001, 0.002, 0.005, 0.01])
def test_the_level_is_about_that_of_the_noise(sigma):
    """Found: 0.92 to 1.00 of it, as a point pulls its quadric along; balls of 40 points have a radius of 0.025."""
    _, level = variances(KdTree.build(rough_plane(sigma)), 0.05)
    assert 0.85 * sigma < level < 1.1 * sigma


def test_each_point_has_the_square_of_its_residual_in_the_order_of_the_input():
    """A half of the target spacing counts as one; correlation with the true distance was found to be 0.88."""
    points = rough_plane(0.005)
    tree = KdTree.build(points)
    found, _ = variances(tree, 0.05)
    of_each = np.empty(len(points))
    of_each[tree.order] = residuals(tree, np.arange(len(points)))
    np.testing.assert_allclose(found, (of_each / 0.5) ** 2, rtol=1e-12)
    assert np.corrcoef(of_each, np.abs(points[:, 2]))[0, 1] > 0.8
    shuffled = RANDOM.permutation(len(points))
    np.testing.assert_allclose(variances(KdTree.build(points[shuffled]), 0.05)[0], found[shuffled], rtol=1e-5)


def test_residuals_equal_least_squares():
    points = rough_plane(0.01, 400)
    tree = KdTree.build(points)
    _, near = cKDTree(points).query(points, NEIGHBOURS)
    found = np.empty(400)
    found[tree.order] = residuals(tree, np.arange(400))
    for i in range(0, 400, 7):
        local = points[near[i]] - points[i]
        local /= np.linalg.norm(local, axis=1).max()
        z, u, v = (local @ np.linalg.eigh(np.cov(local.T))[1]).T
        terms = np.column_stack([np.ones(NEIGHBOURS), u, v, u * u, u * v, v * v])
        root = np.exp(-(u * u + v * v) / 2)
        a, b, c = np.linalg.lstsq(terms * root[:, None], z * root, rcond=None)[0][:3]
        reach = np.linalg.norm(points[near[i, -1]] - points[i])
        assert found[i] == pytest.approx(abs(a) * reach / np.sqrt(1 + b * b + c * c), abs=1e-6)


def test_noise_counts_from_a_fiftieth_of_the_target_spacing():
    tree = KdTree.build(rough_plane(0.002))
    _, level = variances(tree, 1.0)
    assert variances(tree, level * 51)[0] is None
    assert variances(tree, level * 49)[0] is not None


def test_a_point_off_the_surface_stands_out():
    points = rough_plane(0.001)
    points[77] = [0.5, 0.5, 0.02]
    found, _ = variances(KdTree.build(points), 0.02)
    assert found.argmax() == 77
    assert np.sqrt(found[77]) * 0.5 == pytest.approx(0.02, rel=0.25)


@pytest.mark.parametrize("n", [1, 2, 5, 6, 39])
def test_small_clouds(n):
    _, level = variances(KdTree.build(RANDOM.random((n, 3))), 1.0)
    assert level == 0 if n < 6 else 0 < level < 1
