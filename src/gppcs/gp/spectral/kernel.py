"""The Matérn kernel on a manifold, truncated to L eigenfunctions (paper, Eq. 6; Borovitskiy et al. 2020)."""

from dataclasses import dataclass

import numpy as np

from gppcs.engine.arrays import Floats

DIMENSION = 2  # d in Eq. 6: the manifold is a surface


@dataclass(frozen=True)
class Hyperparameters:
    """The paper's theta: sigma^2, kappa in roots of the surface's area, nu (inf: heat kernel), and noise sigma_y^2."""

    variance: float
    lengthscale: float
    nu: float
    noise: float


def log_spectrum(eigenvalues: Floats, lengthscale: float, nu: float) -> tuple[Floats, Floats, Floats]:
    """Return the log of (2 nu / kappa^2 + lambda_n)^(-nu - d/2) in Eq. 6, and its slopes by log kappa and log nu.

    The value at lambda = 0, which would cancel with C_nu in Eq. 6, is subtracted: the power underflows for nu above
    about 40. Shapes: eigenvalues (L,); returns (L,) each.
    """
    if np.isinf(nu):
        heat = -0.5 * lengthscale**2 * eigenvalues
        return heat, 2 * heat, np.zeros_like(heat)
    x = lengthscale**2 * eigenvalues / 2 / nu  # 2 nu could overflow
    logs, ratio, power = np.log1p(x), x / (1 + x), nu + DIMENSION / 2
    return -power * logs, -power * (2 * ratio), power * ratio - nu * logs


def spectral_weights(eigenvalues: Floats, theta: Hyperparameters) -> Floats:
    """Return the weights w_n of the kernel k(x, x') = sum_n w_n f_n(x) f_n(x') (paper, Eq. 6), (L,).

    They are scaled by C_nu so that the mean prior variance over the surface is sigma^2, as the eigenfunctions have mean
    squares of one. Shapes: eigenvalues (L,).
    """
    weights = np.exp(log_spectrum(eigenvalues, theta.lengthscale, theta.nu)[0])
    return theta.variance * weights / weights.sum()


def kernel_features(eigenfunctions: Floats, weights: Floats) -> Floats:
    """Return the feature matrix Phi, (N, L), of the kernel, so that K = Phi Phi^T, given the eigenfunctions, (N, L)."""
    return eigenfunctions * np.sqrt(weights)
