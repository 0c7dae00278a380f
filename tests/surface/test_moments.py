import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.spatial.kdtree import KdTree
from gppcs.surface.moments import (
    AT_ONCE,
    MOMENTS,
    flattest,
    flattest_side_by_side,
    middle,
    moments_in_ball,
    node_moments,
)


def moments_of(points):
    products = np.einsum("ni,nj->ij", points, points)[np.triu_indices(3)]
    return np.concatenate([[len(points)], points.sum(axis=0), products])


def solved(neighbourhoods):
    """Variation, normals and whether they are sure, of AT_ONCE neighbourhoods side by side."""
    moments = np.stack([moments_of(points) for points in neighbourhoods], axis=1)
    variation, normals, sure = np.empty(AT_ONCE), np.empty((3, AT_ONCE)), np.empty(AT_ONCE)
    flattest_side_by_side(moments, variation, normals, sure)
    return variation, normals, sure


@given(st.integers(0, 999), st.floats(-6, 0), st.floats(-6, 0))
def test_side_by_side_equals_one_at_a_time_and_the_eigensolver(seed, flat, thin):
    rng = np.random.default_rng(seed)
    turned = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    neighbourhoods = (rng.standard_normal((AT_ONCE, 20, 3)) * [10**flat, 10**thin, 1.0]) @ turned
    variation, normals, sure = solved(neighbourhoods)
    for p, points in enumerate(neighbourhoods):
        covariance = np.cov(points.T, bias=True)
        values, vectors = np.linalg.eigh(covariance)
        normal = np.empty(3)
        alone = flattest(*covariance[np.triu_indices(3)], normal)
        if sure[p]:
            # good to the root of the rounding error where the two smallest eigenvalues coincide
            assert variation[p] == pytest.approx(values[0] / values.sum(), abs=1e-8)
            assert variation[p] == pytest.approx(alone, abs=1e-8)
            assert np.linalg.norm(normals[:, p]) == pytest.approx(1.0, abs=1e-12)
            if values[1] - values[0] > 1e-4 * values.sum():
                assert abs(normals[:, p] @ vectors[:, 0]) == pytest.approx(1.0, abs=1e-9)


def test_what_is_not_sure_is_told():
    rng = np.random.default_rng(0)
    ball = np.stack(np.meshgrid(*[np.arange(3.0)] * 3), axis=-1).reshape(-1, 3) - 1.0
    plane = rng.random((9, 3)) * [1.0, 1.0, 0.0]
    _, _, sure = solved([ball, np.zeros((4, 3)), plane] + [rng.random((9, 3)) for _ in range(AT_ONCE - 3)])
    np.testing.assert_array_equal(sure, [0, 0] + [1] * (AT_ONCE - 2))


@pytest.mark.parametrize("n", [1, 2, 33, 1_000])
def test_moments_of_nodes_are_those_of_their_points(n):
    points = np.random.default_rng(n).random((n, 3))
    tree = KdTree.build(points)
    moments = np.empty((len(tree.low), MOMENTS))
    node_moments(tree.points, tree.low, tree.high, moments)
    for node in range(1, len(tree.low)):
        level = node.bit_length() - 1
        j = node - (1 << level)
        inside = tree.points.T[n * j >> level : n * (j + 1) >> level]
        expected = moments_of(inside - middle(tree.low[node], tree.high[node]))
        np.testing.assert_allclose(moments[node], expected, atol=1e-12)


@pytest.mark.parametrize("count", [0, 1, 16, 500])
def test_moments_in_a_ball(count):
    rng = np.random.default_rng(count)
    packed, centre = rng.random((3, count + 5)), rng.random(3)
    moments = np.full((MOMENTS, AT_ONCE), np.nan)
    moments_in_ball(packed, count, *centre, 0.2, moments, 3)
    local = packed[:, :count].T - centre
    np.testing.assert_allclose(moments[:, 3], moments_of(local[(local**2).sum(axis=1) <= 0.2]), atol=1e-10)
    assert np.isnan(np.delete(moments, 3, axis=1)).all()
