import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import dense
from gppcs.gp.spectral import greedy
from gppcs.gp.spectral.posterior import posterior


@given(
    st.integers(2, 80),
    st.integers(1, 20),
    st.sampled_from([1, 3, 40]),
    st.sampled_from([1e-3, 0.1, 10.0]),
    st.sampled_from([1, 7, 200]),
    st.sampled_from([1.0, 10.0]),
    st.floats(0, 0.99),
    st.floats(0, 1),
    st.integers(0, 999),
)
@example(80, 20, 1, 1e-3, 200, 10.0, 0.05, 0.6, 0)  # where each bucket is one point, its bound is the tightest
def test_order_is_that_of_a_dense_algorithm_1(n, features, k_add, noise, buckets, largest, start, more, seed):
    rng = np.random.default_rng(seed)
    phi, y = rng.standard_normal((n, features)), largest * rng.standard_normal(n)
    k_init = 1 + int(start * (n - 1))
    n_points = k_init + int(more * (n - k_init))
    initial = rng.permutation(n)[:k_init]
    order = rng.permutation(n)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(greedy, "BUCKETS", buckets)
        initial_places = np.argsort(order)[initial]
        chosen = greedy.select(phi[order], y[order], noise, initial_places, n_points, k_add, order)
    np.testing.assert_array_equal(order[chosen], dense.greedy(phi, y, noise, initial, n_points, k_add))


def test_ties_go_to_the_smallest_index():
    phi, y, order = np.ones((50, 1)), np.full(50, 2.0), np.random.default_rng(0).permutation(50)
    chosen = greedy.select(phi, y, 0.5, np.array([30]), 50, order=order)
    np.testing.assert_array_equal(order[chosen[1:]], np.delete(np.arange(50), order[30]))


@pytest.mark.slow
@pytest.mark.parametrize(("k_init", "noise"), [(1, 1e-6), (1, 1.0), (30, 1e-3), (6_500, 1e-6)])
def test_after_13000_updates_the_posterior_equals_one_computed_anew(k_init, noise, monkeypatch):
    """Also from one observation on, where the first updates shrink the variance by up to ten orders of magnitude."""
    rng = np.random.default_rng(0)
    n_points, states = 13_000 + k_init, []
    phi = 100 * rng.standard_normal((n_points + 100, 20))
    y = phi @ rng.standard_normal(20) + np.sqrt(noise) * rng.standard_normal(len(phi))
    choose = greedy._choose

    def listening(points, buckets, mean, covariance, *others):
        states[:] = [mean, covariance]
        return choose(points, buckets, mean, covariance, *others)

    monkeypatch.setattr(greedy, "_choose", listening)
    indices = greedy.select(phi, y, noise, np.arange(k_init), n_points, k_add=20)  # fewer scans, as many updates
    anew = posterior(phi[indices], y[indices], noise)
    mean, covariance = states
    np.testing.assert_allclose(mean, anew[0], rtol=1e-8)
    np.testing.assert_allclose(covariance, anew[1], rtol=0, atol=1e-8 * np.abs(anew[1]).max())
    np.testing.assert_allclose(phi @ mean, phi @ anew[0], rtol=1e-8)
    variances = [((phi @ np.linalg.cholesky(each)) ** 2).sum(axis=1) for each in (covariance, anew[1])]
    np.testing.assert_allclose(*variances, rtol=1e-8)
