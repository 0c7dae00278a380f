import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from gppcs.gp.spectral.kernel import Hyperparameters, kernel_features, log_spectrum, spectral_weights
from gppcs.gp.spectral.laplacian import eigenpairs, local_triangles, surface_laplacian
from shapes import on_sphere

EIGENVALUES = np.array([0.0, 25.1, 25.2, 75.0, 260.0])


@given(st.floats(-3, 3), st.floats(-2, 2.5))
def test_spectrum_is_that_of_equation_6_and_slopes_are_its_differences(log_lengthscale, log_nu):
    def plain(a, b):
        lengthscale, nu = np.exp([a, b])
        logs = (-nu - 1) * np.log(2 * nu / lengthscale**2 + EIGENVALUES)
        return logs - logs[0]

    found = log_spectrum(EIGENVALUES, np.exp(log_lengthscale), np.exp(log_nu))
    step = 1e-5
    np.testing.assert_allclose(found[0], plain(log_lengthscale, log_nu), rtol=1e-9, atol=1e-10)
    for slope, (a, b) in zip(found[1:], ((step, 0), (0, step)), strict=True):
        difference = plain(log_lengthscale + a, log_nu + b) - plain(log_lengthscale - a, log_nu - b)
        np.testing.assert_allclose(slope, difference / (2 * step), rtol=1e-5, atol=1e-5)


def test_large_nu_tends_to_the_heat_kernel():
    heat = log_spectrum(EIGENVALUES, 0.4, np.inf)
    np.testing.assert_allclose(heat[0], -0.08 * EIGENVALUES)
    for nu in (1e7, 1e300, 1.7e308):
        for values, limit in zip(log_spectrum(EIGENVALUES, 0.4, nu), heat, strict=True):
            np.testing.assert_allclose(values, limit, rtol=1e-5, atol=1e-5 * np.abs(heat[0]).max())


@pytest.fixture(scope="module")
def pairs(bracket):
    return eigenpairs(bracket, 20)


@pytest.mark.parametrize("nu", [0.5, 1.5, 2.5, 10_000.0, np.inf])
def test_the_kernel_is_positive_with_the_variance_asked_for(bracket, pairs, nu):
    """The published start, nu = 10,000 and lengthscale 1, is among them."""
    eigenvalues, functions = pairs
    _, areas = surface_laplacian(bracket, local_triangles(bracket))
    theta = Hyperparameters(variance=0.7, lengthscale=1.0, nu=nu, noise=1e-3)
    weights = spectral_weights(eigenvalues, theta)
    assert np.isfinite(weights).all()
    assert (weights > 0).all()
    assert (np.diff(weights) <= 0).all()
    phi = kernel_features(functions.at(bracket), weights)
    assert np.average((phi**2).sum(axis=1), weights=areas) == pytest.approx(0.7, rel=1e-9)
    kernel = phi[:300] @ phi[:300].T
    np.linalg.cholesky(kernel + 1e-10 * np.eye(300))


@pytest.mark.oracle
@pytest.mark.parametrize("nu", [0.5, 1.5, 2.5, np.inf])
def test_equals_geometric_kernels(nu):
    """Their Karhunen-Loève Matérn kernel on a mesh, given that mesh's own eigenpairs."""
    kernels = pytest.importorskip("geometric_kernels.kernels", reason="needs geometric-kernels: the extra 'oracles'")
    spaces = pytest.importorskip("geometric_kernels.spaces")
    vertices = on_sphere(200)
    mesh = spaces.Mesh(vertices, ConvexHull(vertices).simplices)
    oracle = kernels.MaternKarhunenLoeveKernel(mesh, 20, normalize=True)
    parameters = oracle.init_params()
    parameters["nu"], parameters["lengthscale"] = np.array([nu]), np.array([0.4])
    rows = np.arange(len(vertices))[:, None]
    expected = oracle.K(parameters, rows, rows)
    functions = np.asarray(mesh.get_eigenfunctions(20)(rows))
    weights = spectral_weights(np.asarray(mesh.get_eigenvalues(20)).ravel(), Hyperparameters(1.0, 0.4, nu, 0.1))
    phi = kernel_features(functions, weights)
    variance = (phi**2).sum(axis=1).mean()  # theirs has a mean of one over the vertices, ours over the surface
    np.testing.assert_allclose(phi @ phi.T / variance, expected, rtol=1e-8, atol=1e-10)
