import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.gp.spectral.kernel import (
    Hyperparameters,
    kernel_features,
    log_spectrum,
    log_spectrum_slopes,
    spectral_weights,
)
from gppcs.gp.spectral.laplacian import eigenpairs

EIGENVALUES = np.array([0.0, 25.1, 25.2, 75.0, 260.0])


@pytest.mark.parametrize("nu", [0.5, 1.5, 2.5, 0.7, 12.0])
@pytest.mark.parametrize("lengthscale", [0.01, 0.3, 5.0])
def test_spectrum_is_that_of_equation_6(nu, lengthscale):
    direct = (2 * nu / lengthscale**2 + EIGENVALUES) ** (-nu - 1)
    np.testing.assert_allclose(np.exp(log_spectrum(EIGENVALUES, lengthscale, nu)), direct / direct[0], rtol=1e-12)


def test_large_nu_tends_to_the_heat_kernel():
    heat = log_spectrum(EIGENVALUES, 0.4, np.inf)
    np.testing.assert_allclose(heat, -0.08 * EIGENVALUES)
    for nu in (1e7, 1e300, 1.7e308):
        np.testing.assert_allclose(log_spectrum(EIGENVALUES, 0.4, nu), heat, rtol=1e-5)
        by_lengthscale, by_nu = log_spectrum_slopes(EIGENVALUES, 0.4, nu)
        np.testing.assert_allclose(by_lengthscale, 2 * heat, rtol=1e-5)
        np.testing.assert_allclose(by_nu, 0, atol=1e-5 * np.abs(heat).max())


@given(st.floats(-3, 3), st.floats(-2, 6))
def test_slopes_equal_finite_differences(log_lengthscale, log_nu):
    def at(a, b):
        return log_spectrum(EIGENVALUES, np.exp(a), np.exp(b))

    by_lengthscale, by_nu = log_spectrum_slopes(EIGENVALUES, np.exp(log_lengthscale), np.exp(log_nu))
    step = 1e-5
    differences = (at(log_lengthscale + step, log_nu) - at(log_lengthscale - step, log_nu)) / (2 * step)
    np.testing.assert_allclose(by_lengthscale, differences, rtol=1e-5, atol=1e-6)
    differences = (at(log_lengthscale, log_nu + step) - at(log_lengthscale, log_nu - step)) / (2 * step)
    np.testing.assert_allclose(by_nu, differences, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("nu", [0.5, 1.5, 2.5, 10_000.0, np.inf])
def test_the_kernel_is_positive_with_the_variance_asked_for(bracket, nu):
    """The published start, nu = 10,000 and lengthscale 1, is among them."""
    pairs = eigenpairs(bracket, 20)
    mean_squares = (pairs.eigenfunctions**2).mean(axis=0)
    theta = Hyperparameters(variance=0.7, lengthscale=1.0, nu=nu, noise=1e-3)
    weights = spectral_weights(pairs.eigenvalues, mean_squares, theta)
    assert np.isfinite(weights).all()
    assert (weights > 0).all()
    assert (np.diff(weights) <= 0).all()
    phi = kernel_features(pairs.eigenfunctions, weights)
    assert (phi**2).sum(axis=1).mean() == pytest.approx(0.7, rel=1e-12)
    kernel = phi[:300] @ phi[:300].T
    np.linalg.cholesky(kernel + 1e-10 * np.eye(300))


@pytest.mark.oracle
@pytest.mark.parametrize("nu", [0.5, 1.5, 2.5, np.inf])
def test_equals_geometric_kernels(nu):
    """Their Karhunen-Loève Matérn kernel on a mesh, given that mesh's own eigenpairs."""
    kernels = pytest.importorskip("geometric_kernels.kernels", reason="needs geometric-kernels: the extra 'oracles'")
    spaces = pytest.importorskip("geometric_kernels.spaces")
    vertices, faces = icosphere()
    mesh = spaces.Mesh(vertices, faces)
    oracle = kernels.MaternKarhunenLoeveKernel(mesh, 20, normalize=True)
    parameters = oracle.init_params()
    parameters["nu"], parameters["lengthscale"] = np.array([nu]), np.array([0.4])
    rows = np.arange(len(vertices))[:, None]
    expected = oracle.K(parameters, rows, rows)
    functions = np.asarray(mesh.get_eigenfunctions(20)(rows))
    weights = spectral_weights(
        np.asarray(mesh.get_eigenvalues(20)).ravel(), (functions**2).mean(axis=0), Hyperparameters(1.0, 0.4, nu, 0.1)
    )
    phi = kernel_features(functions, weights)
    np.testing.assert_allclose(phi @ phi.T, expected, rtol=1e-8, atol=1e-10)


def icosphere():
    """The convex hull of 200 points spread over the unit sphere."""
    from scipy.spatial import ConvexHull

    height = 1 - (2 * np.arange(200) + 1) / 200
    turn = np.arange(200) * np.pi * (1 + np.sqrt(5))
    ring = np.sqrt(1 - height**2)
    vertices = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])
    return vertices, ConvexHull(vertices).simplices
