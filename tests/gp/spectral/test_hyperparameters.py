import numpy as np
import pytest

import dense
import gppcs
from gppcs.gp.spectral.hyperparameters import fit, log_marginal_likelihood
from gppcs.gp.spectral.kernel import Hyperparameters, kernel_features, spectral_weights
from gppcs.gp.spectral.laplacian import eigenpairs


@pytest.fixture(scope="module")
def problem():
    points = gppcs.sample("bracket", n_points=400, seed=2).points
    eigenvalues, functions = eigenpairs(points, 20)
    y = gppcs.estimate_features(points).surface_variation
    return eigenvalues, functions.at(points), y


THETAS = [
    Hyperparameters(1e-3, 0.3, 1.5, 2e-4),
    Hyperparameters(5e-2, 0.05, 0.5, 1e-5),
    Hyperparameters(1e-3, 1.0, 10_000.0, 1e-3),
    Hyperparameters(2e-3, 0.2, np.inf, 1e-4),
]


@pytest.mark.parametrize("theta", THETAS)
def test_equals_equation_5_and_its_gradient_the_differences(problem, theta):
    eigenvalues, functions, y = problem

    def plain(logarithms):
        moved = Hyperparameters(*np.exp(logarithms))
        phi = kernel_features(functions, spectral_weights(eigenvalues, moved))
        return dense.log_marginal_likelihood(phi, y, moved.noise)

    start = np.log([theta.variance, theta.lengthscale, theta.nu, theta.noise])
    value, gradient = log_marginal_likelihood(eigenvalues, functions, y, theta)
    assert value == pytest.approx(plain(start), rel=1e-9)
    for slope, step in zip(gradient, 1e-4 * np.eye(4), strict=True):
        if np.isinf(start[step > 0][0]):
            assert slope == 0
        else:
            difference = (plain(start + step) - plain(start - step)) / 2e-4
            assert slope == pytest.approx(difference, rel=1e-4, abs=1e-7 * abs(value))


@pytest.mark.parametrize("fit_nu", [False, True])
def test_the_fit_is_a_maximum(problem, fit_nu):
    eigenvalues, functions, y = problem
    theta, converged = fit(eigenvalues, functions, y, 1.5, fit_nu)
    assert converged
    best, _ = log_marginal_likelihood(eigenvalues, functions, y, theta)
    assert fit_nu or theta.nu == 1.5
    rng = np.random.default_rng(0)
    for _ in range(50):
        factors = np.exp(rng.normal(0, 0.3, 3))
        near = Hyperparameters(
            theta.variance * factors[0], theta.lengthscale * factors[1], theta.nu, theta.noise * factors[2]
        )
        assert log_marginal_likelihood(eigenvalues, functions, y, near)[0] <= best + 1e-6


def test_more_iterations_never_fit_worse_and_soon_change_nothing(problem):
    eigenvalues, functions, y = problem
    with pytest.warns(UserWarning, match="converged"):
        fits = [fit(eigenvalues, functions, y, 2.5, iterations=count)[0] for count in (1, 3, 100, 200)]
    values = [log_marginal_likelihood(eigenvalues, functions, y, theta)[0] for theta in fits]
    assert values[0] < values[1] < values[2]
    assert fits[2] == fits[3]
    of_zeros, _ = fit(eigenvalues, functions, np.zeros_like(y), 2.5)
    assert np.isfinite([of_zeros.variance, of_zeros.lengthscale, of_zeros.noise]).all()


@pytest.mark.filterwarnings("ignore:the fit of the hyperparameters")
@pytest.mark.parametrize(("iterations", "expected"), [(1, 1.0), (200, None)])
def test_a_fit_that_does_not_converge_is_in_the_diagnostics(iterations, expected):
    method = gppcs.SpectralGP(iterations=iterations)
    result = gppcs.simplify(gppcs.sample("bracket", n_points=400), n_points=40, method=method)
    assert result.diagnostics.get("unconverged") == expected
