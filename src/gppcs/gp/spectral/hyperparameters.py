"""Fit the hyperparameters by maximum marginal likelihood (paper, Eq. 5), for a kernel of L features."""

import warnings

import numpy as np
import scipy.linalg
import scipy.optimize

from gppcs.engine.arrays import Floats
from gppcs.engine.blas import one_blas_thread
from gppcs.gp.spectral.kernel import Hyperparameters, kernel_features, log_spectrum, spectral_weights

AT_LIMIT = 1  # the status of L-BFGS-B after the last iteration that it may take
STARTS = (0.03, 0.1, 0.3, 1.0)  # lengthscales to start from, since the likelihood has several maxima


@one_blas_thread()
def log_marginal_likelihood(
    eigenvalues: Floats, eigenfunctions: Floats, y: Floats, theta: Hyperparameters
) -> tuple[float, Floats]:
    """Return log p(y | theta, sigma_y^2) (paper, Eq. 5) and its gradient, in O(n L^2) for n points.

    Shapes: eigenvalues (L,), eigenfunctions (n, L), y (n,); returns gradient (4,).
    """
    n, count = eigenfunctions.shape
    noise = theta.noise
    weights = spectral_weights(eigenvalues, theta)
    phi = kernel_features(eigenfunctions, weights)
    inner = scipy.linalg.cho_factor(noise * np.eye(count) + phi.T @ phi)
    # alpha = (K + sigma_y^2 I)^-1 y, and the trace of that inverse, both by the matrix inversion lemma
    alpha = (y - phi @ scipy.linalg.cho_solve(inner, phi.T @ y)) / noise
    trace = (n - count) / noise + np.trace(scipy.linalg.cho_solve(inner, np.eye(count)))
    log_determinant = (n - count) * np.log(noise) + 2 * np.log(np.diag(inner[0])).sum()
    value = -0.5 * (y @ alpha + log_determinant + n * np.log(2 * np.pi))

    gram = eigenfunctions.T @ eigenfunctions
    quadratic = np.diag(np.linalg.solve(noise * np.eye(count) + gram * weights, gram))
    by_weight = 0.5 * ((eigenfunctions.T @ alpha) ** 2 - quadratic)
    fractions = weights / theta.variance
    by_lengthscale, by_nu = (
        by_weight @ (weights * (slope - fractions @ slope))
        for slope in log_spectrum(eigenvalues, theta.lengthscale, theta.nu)[1:]
    )
    by_noise = 0.5 * noise * (alpha @ alpha - trace)
    return float(value), np.array([by_weight @ weights, by_lengthscale, by_nu, by_noise])


@one_blas_thread()
def fit(
    eigenvalues: Floats,
    eigenfunctions: Floats,
    y: Floats,
    nu: float,
    fit_nu: bool = False,
    iterations: int = 200,
) -> tuple[Hyperparameters, bool]:
    """Maximise the marginal likelihood (paper, Eq. 5) over variance, lengthscale and noise, and optionally nu.

    L-BFGS-B optimises the logarithms. It starts from four lengthscales. Returns the best result, and whether that
    converged.
    """
    scale = float(np.mean(y**2)) or 1.0
    free = [0, 1, 3] if not fit_nu else [0, 1, 2, 3]
    # The lower bound of the noise keeps the posterior well conditioned.
    bounds = np.log([(1e-4 * scale, 1e4 * scale), (1e-3, 1e2), (0.1, 1e3), (1e-6 * scale, 1e2 * scale)])

    def theta_of(logarithms: Floats) -> Hyperparameters:
        variance, lengthscale, free_nu, noise = np.exp(logarithms).tolist()
        return Hyperparameters(variance, lengthscale, free_nu if fit_nu else nu, noise)

    def loss(moved: Floats, fixed: Floats) -> tuple[float, Floats]:
        logarithms = fixed.copy()
        logarithms[free] = moved
        value, gradient = log_marginal_likelihood(eigenvalues, eigenfunctions, y, theta_of(logarithms))
        return -value, -gradient[free]

    ends = []
    for lengthscale in STARTS:
        start = np.log([scale, lengthscale, min(nu, 1e3), 0.5 * scale])
        options = {"maxiter": iterations}
        end = scipy.optimize.minimize(
            loss, start[free], (start,), "L-BFGS-B", jac=True, bounds=bounds[free], options=options
        )
        start[free] = end.x
        ends.append((end.fun, end.status != AT_LIMIT, start))  # else no step lowers the loss, but for rounding
    _, converged, logarithms = min(ends, key=lambda end: end[0])
    if not converged:
        warnings.warn("the fit of the hyperparameters stopped before it converged", stacklevel=2)
    return theta_of(logarithms), bool(converged)
