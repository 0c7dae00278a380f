import numpy as np
import pytest
from scipy.spatial import cKDTree

from gppcs.kdtree import KdTree
from gppcs.noise import FEWEST, MOST, QUIET, Noise, residuals

RANDOM = np.random.default_rng(0)


def rough_plane(sigma, n=20_000):
    return np.column_stack([RANDOM.random((n, 2)), sigma * RANDOM.standard_normal(n)])


def test_smooth_surfaces_are_quiet(sphere):
    """Found, in the unit of the sphere's radius: 2.5e-7, and 1e-4 for a twentieth of the points."""
    for points, n_points, spacing, most in (
        (sphere, 500, 0.01, 1e-6), (sphere[::20], 100, 0.05, 5e-4), (rough_plane(0.0), 500, 0.01, 1e-12),
    ):  # fmt: skip
        noise = Noise.measure(KdTree.build(points), n_points, spacing)
        assert noise.quiet
        assert noise.level <= most
        assert (noise.variances(points) == 0).all()


@pytest.mark.parametrize("sigma", [0.001, 0.002, 0.005, 0.01])
def test_the_level_is_about_that_of_the_noise(sigma):
    """Found: 0.92 to 1.00 of it, as a point pulls its quadric along; balls of 40 points have a radius of 0.025."""
    level = Noise.measure(KdTree.build(rough_plane(sigma)), 400, 0.02).level
    assert 0.85 * sigma < level < 1.1 * sigma


def test_each_point_has_the_square_of_its_residual_whatever_the_order_of_the_tree():
    """A half of the target spacing counts as one, and so does more; correlation with the true distance: 0.88."""
    points = rough_plane(0.005)
    tree = KdTree.build(points)
    found = Noise.measure(tree, 500, 0.02).variances(points)
    of_each = residuals(tree, points, MOST)
    np.testing.assert_allclose(found, np.minimum(of_each / 0.5, 0.02) ** 2, rtol=1e-12)
    assert 0 < (found == 0.02**2).mean() < 0.1
    assert np.corrcoef(of_each, np.abs(points[:, 2]))[0, 1] > 0.8
    shuffled = RANDOM.permutation(len(points))
    other = Noise.measure(KdTree.build(points[shuffled]), 500, 0.02)
    np.testing.assert_allclose(other.variances(points), found, rtol=1e-5)


def test_residuals_equal_least_squares():
    points = rough_plane(0.01, 400)
    tree = KdTree.build(points)
    _, near = cKDTree(points).query(points, MOST)
    found = residuals(tree, points, MOST)
    for i in range(0, 400, 7):
        local = points[near[i]] - points[i]
        local /= np.linalg.norm(local, axis=1).max()
        z, u, v = (local @ np.linalg.eigh(np.cov(local.T))[1]).T
        terms = np.column_stack([np.ones(MOST), u, v, u * u, u * v, v * v])
        root = np.exp(-(u * u + v * v) / 2)
        a, b, c = np.linalg.lstsq(terms * root[:, None], z * root, rcond=None)[0][:3]
        reach = np.linalg.norm(points[near[i, -1]] - points[i])
        assert found[i] == pytest.approx(abs(a) * reach / np.sqrt(1 + b * b + c * c), abs=1e-6)


def test_noise_counts_where_it_is_large_beside_the_target_spacing():
    tree = KdTree.build(rough_plane(0.002))
    level = Noise.measure(tree, 500, 1.0).level
    assert Noise.measure(tree, 500, 1.02 * level / QUIET).quiet
    assert not Noise.measure(tree, 500, 0.98 * level / QUIET).quiet


def test_noise_is_not_told_from_detail_where_few_points_lie_within_the_target_spacing():
    points = rough_plane(0.01, 4_000)
    most = int(np.pi * len(points) / FEWEST)
    assert not Noise.measure(KdTree.build(points), most - 5, 0.02).quiet
    assert Noise.measure(KdTree.build(points), most + 5, 0.02).level == 0


def test_a_point_off_the_surface_stands_out():
    points = rough_plane(0.002)
    points[77] = [0.5, 0.5, 0.02]
    found = Noise.measure(KdTree.build(points), 50, 0.045).variances(points)
    assert found.argmax() == 77
    assert np.sqrt(found[77]) * 0.5 == pytest.approx(0.02, rel=0.25)


@pytest.mark.parametrize("n", [1, 2, 5, 6, 39])
def test_small_clouds(n):
    points = RANDOM.random((n, 3))
    found = residuals(KdTree.build(points), points, MOST)
    assert (found == 0).all() if n < 6 else (found > 0).all()
    assert Noise.measure(KdTree.build(points), n, 1.0).quiet
