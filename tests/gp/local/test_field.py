import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

import dense
from gppcs.gp.local.kernel import LANES, LocalField, correlate
from gppcs.gp.local.posterior import Conditioning, condition, posterior_of_all
from gppcs.spatial.kdtree import KdTree


def random_field(n, seed, normal_weight=1.0, lengthscale=1.5):
    """A field at random points of a box, with spacings from a fifth to five."""
    rng = np.random.default_rng(seed)
    field = dense.local_field(rng, rng.random((3, n)) * 4, 1.6, normal_weight)
    return field._replace(noise=10 ** (-4 * field.noise), lengthscale=lengthscale)


def conditioned(field, chosen, k):
    """What each point is conditioned on, of a field in any order."""
    tree = KdTree.build(field.positions.T)
    place = np.argsort(tree.order)
    of_point = {name: getattr(field, name)[..., tree.order] for name in ("normals", "spacings", "y", "noise", "detail")}
    sorted_field = field._replace(positions=tree.points, **of_point)
    nearest, squared = condition(sorted_field, tree, place[chosen], k)
    return Conditioning(np.where(nearest < 0, -1, tree.order[nearest]).astype(np.int32)[place], squared[place])


def of_posterior(field, conditioning):
    """Mean and variance of every point."""
    return posterior_of_all(field, conditioning, 0.0)[:2]


def kernel_of(field):
    """All pairs by the module's own kernel."""
    n = len(field.y)
    sites = np.vstack([field.positions, field.normals, field.spacings, field.y, field.noise, field.detail])
    kernel = np.empty(n * n + LANES)
    i, j = np.divmod(np.arange(len(kernel)) % n**2, n)
    for begin in range(0, n * n, LANES):
        lanes = slice(begin, begin + LANES)
        pair = np.stack([sites[:, i[lanes]], sites[:, j[lanes]]])
        correlate(pair, 0, 1, field.lengthscale, field.normal_weight, LANES, kernel[lanes])
    return kernel[: n * n].reshape(n, n)


fields = st.builds(
    random_field, st.integers(2, 25), st.integers(0, 10**6), st.sampled_from([0.0, 0.5, 3.2]), st.floats(0.3, 5)
)


@given(fields)
def test_the_kernel_is_a_correlation_and_equals_its_plain_twin(field):
    kernel = kernel_of(field)
    np.testing.assert_allclose(kernel, dense.local_kernel(field), rtol=1e-10, atol=1e-14)
    np.testing.assert_array_equal(kernel, kernel.T)
    np.testing.assert_allclose(np.diag(kernel), 1, rtol=1e-12)
    assert np.linalg.eigvalsh(kernel).min() >= -1e-10


@pytest.mark.parametrize("spacing", [0.3, 1.0, 2.0])
def test_with_one_spacing_and_one_normal_it_is_matern_of_five_halves(spacing):
    """As by its spectral definition, through the modified Bessel function."""
    from scipy.special import gamma, kv

    field = random_field(12, 0)
    field = field._replace(
        spacings=np.full(12, spacing), normals=np.tile(field.normals[:, :1], 12), detail=field.detail[:0]
    )
    a = np.sqrt(5) * cdist(field.positions.T, field.positions.T) / (1.5 * spacing)
    expected = 2 ** (1 - 2.5) / gamma(2.5) * a**2.5 * kv(2.5, np.where(a > 0, a, 1))
    np.fill_diagonal(expected, 1)
    np.testing.assert_allclose(kernel_of(field), expected, rtol=1e-10)


@given(st.integers(1, 400), st.integers(1, 12), st.sampled_from([0.0, 0.5, 3.2]), st.integers(0, 10**6), st.data())
def test_conditioning_is_on_the_nearest_in_the_field(n, k, weight, seed, data):
    field = random_field(n, seed, weight)
    chosen = np.random.default_rng(seed).permutation(n)[: data.draw(st.integers(0, n))]
    nearest, squared = conditioned(field, chosen, k)
    kept = min(k, len(chosen))
    assert (nearest[:, kept:] == -1).all()
    assert np.isinf(squared[:, kept:]).all()
    distances = dense.local_squared_distances(field)
    for i in range(n):
        expected = chosen[np.argsort(distances[i, chosen])[:k]]
        np.testing.assert_array_equal(nearest[i, :kept], expected)
        np.testing.assert_allclose(squared[i, :kept], distances[i, expected], rtol=1e-9, atol=1e-12)


@given(fields, st.integers(1, 12), st.data())
def test_posterior_equals_equations_3_and_4_given_the_nearest(field, k, data):
    """With as many neighbours as are chosen, or more, it is the whole posterior."""
    n = len(field.y)
    chosen = np.random.default_rng(n).permutation(n)[: data.draw(st.integers(0, n))]
    conditioning = conditioned(field, chosen, k)
    mean, variance = of_posterior(field, conditioning)
    kernel = dense.local_kernel(field)
    for i in range(n):
        given_points = chosen if k >= len(chosen) else conditioning.nearest[i]
        expected = dense.local_posterior(kernel, field, i, given_points)
        np.testing.assert_allclose((mean[i], variance[i]), expected, rtol=1e-9, atol=1e-9)


def test_a_point_without_noise_that_is_given_twice_is_no_failure():
    """The second pivot vanishes."""
    field = random_field(4, 0)._replace(noise=np.zeros(4))
    for array in (field.positions, field.normals, field.detail):
        array[:, 1] = array[:, 0]
    field.spacings[1], field.y[1] = field.spacings[0], field.y[0]
    mean, variance = of_posterior(field, conditioned(field, np.array([0, 1]), 2))
    alone = of_posterior(field, conditioned(field, np.array([0]), 2))
    np.testing.assert_allclose((mean, variance), alone, atol=1e-5)
    assert mean[1] == pytest.approx(field.y[1], abs=1e-9)


def test_leaves_of_chosen_points_do_not_stop_the_search_of_the_next():
    """With one neighbour, a point that is chosen is its own, at a distance of zero."""
    n = 64 * 32 * 4
    points = np.random.default_rng(0).random((n, 3)) * [1, 1, 0]
    tree = KdTree.build(points)
    leaves = len(tree.lower) // 2
    upright = np.tile([[0.0], [0.0], [1.0]], n)
    field = LocalField(tree.points, upright, np.ones(n), np.zeros(n), np.ones(n), np.empty((0, n)), 1.5, 1.0)
    chosen = np.arange(n // leaves)
    found = condition(field, tree, chosen, 1)
    nearest = cKDTree(tree.points[:, chosen].T).query(tree.points.T)[0]
    np.testing.assert_allclose(found.squared[:, 0], nearest**2, atol=1e-12)
