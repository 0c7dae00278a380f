import numpy as np
import pytest

import dense
import gppcs
from gppcs.gp.spectral.hyperparameters import fit
from gppcs.gp.spectral.kernel import kernel_features, spectral_weights
from gppcs.gp.spectral.laplacian import eigenpairs
from gppcs.gp.spectral.posterior import Posterior


@pytest.fixture(scope="module")
def small_problem():
    """Phi, y and the fitted noise of 400 points of a scan."""
    points = gppcs.sample("medallion", n_points=400, seed=5).points
    y = gppcs.estimate_features(points).surface_variation
    pairs = eigenpairs(points, 20)
    mean_squares = (pairs.eigenfunctions**2).mean(axis=0)
    theta = fit(pairs.eigenvalues, pairs.eigenfunctions, y, mean_squares, 1.5)
    weights = spectral_weights(pairs.eigenvalues, mean_squares, theta)
    return kernel_features(pairs.eigenfunctions, weights), y, theta.noise


@pytest.mark.parametrize("active", [1, 7, 50, 399])
def test_equals_equations_3_and_4(small_problem, active):
    phi, y, noise = small_problem
    chosen = np.random.default_rng(active).permutation(400)[:active]
    mean, variance = Posterior.given(phi[chosen], y[chosen], noise).predict(phi)
    expected_mean, expected_variance = dense.posterior(phi, y, noise, chosen)
    np.testing.assert_allclose(mean, expected_mean, rtol=1e-9)
    np.testing.assert_allclose(variance, expected_variance, rtol=1e-9)


def test_without_data_it_is_the_prior(small_problem):
    phi, y, noise = small_problem
    mean, variance = Posterior.given(phi[:0], y[:0], noise).predict(phi)
    np.testing.assert_array_equal(mean, 0)
    np.testing.assert_allclose(variance, (phi**2).sum(axis=1), rtol=1e-12)
