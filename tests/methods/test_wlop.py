import numpy as np
import pytest
from scipy.spatial import cKDTree

from gppcs.methods.wlop.projection import project
from gppcs.spatial.kdtree import KdTree


def plain_project(points, samples, radius, iterations, mu, require_uniform):
    """The same with matrices of all pairs."""

    def squared(a, b):
        return ((a[:, None] - b) ** 2).sum(axis=2) / radius**2

    def theta(t):
        return np.where(t <= 1, np.exp(-4 * t), 0)

    def mean(weights, values):
        total = weights.sum(axis=1, keepdims=True)
        return np.einsum("ij,ijk->ik", weights, values) / np.where(total > 0, total, 1)

    weights = 1 / theta(squared(points, points)).sum(axis=1) if require_uniform else np.ones(len(points))
    for _ in range(iterations):
        t, own = squared(samples, points), squared(samples, samples)
        alpha = np.where(t < 1e-10, 0, theta(t) * weights)
        omega = 1 + theta(own).sum(axis=1)
        beta = np.where(own < 1e-10, 0, omega * theta(own) / np.maximum(own, 1e-10))
        beta[(own <= 1).sum(axis=1) < 3] = 0
        step = mean(alpha, points - samples[:, None]) + mu * mean(beta, samples[:, None] - samples)
        samples = samples + step
    return samples


def cgal_wlop(points, percentage, radius, iterations=35, require_uniform=False):
    kernel = pytest.importorskip("CGAL.CGAL_Kernel")
    from CGAL.CGAL_Point_set_3 import Point_set_3
    from CGAL.CGAL_Point_set_processing_3 import wlop_simplify_and_regularize_point_set

    given_points, moved = Point_set_3(), Point_set_3()
    for x, y, z in points.tolist():
        given_points.insert(kernel.Point_3(x, y, z))
    wlop_simplify_and_regularize_point_set(given_points, moved, percentage, radius, iterations, require_uniform)
    return np.array([[point.x(), point.y(), point.z()] for point in moved.points()])


@pytest.mark.parametrize("require_uniform", [False, True])
@pytest.mark.parametrize(("n", "m", "radius"), [(500, 60, 0.15), (500, 60, 0.5), (300, 300, 0.2), (5, 2, 0.1)])
def test_equals_the_plain_algorithm(n, m, radius, require_uniform):
    points = np.random.default_rng(n).random((n, 3))
    moved = project(KdTree.build(points), points[:m], radius, 5, 0.45, require_uniform)
    np.testing.assert_allclose(moved, plain_project(points, points[:m], radius, 5, 0.45, require_uniform), atol=1e-10)


@pytest.mark.oracle
@pytest.mark.parametrize("require_uniform", [False, True])
@pytest.mark.parametrize(("n", "radius"), [(12, 0.35), (60, 0.3), (60, 0.6), (500, 0.2)])
def test_equals_cgal_where_all_points_are_samples(n, radius, require_uniform):
    """Then there is no chance in the start, and five iterations must agree to rounding."""
    points = np.random.default_rng(0).random((n, 3))
    theirs = cgal_wlop(points, 100.0, radius, 5, require_uniform)
    ours = project(KdTree.build(points), points, radius, 5, require_uniform=require_uniform)
    assert len(theirs) == len(ours)
    assert cKDTree(theirs).query(ours)[0].max() < 1e-10
