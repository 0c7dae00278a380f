"""The Matérn kernel on a manifold, truncated to the eigenfunctions at hand (paper, Eq. 6; Borovitskiy et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

DIMENSION = 2  # of the manifold: d in Eq. 6


@dataclass(frozen=True)
class Hyperparameters:
    """The paper's theta = {sigma^2, kappa, nu} and its noise variance sigma_y^2.

    Attributes
    ----------
    variance : float
        sigma^2, the mean prior variance, in squared units of the modelled function.
    lengthscale : float
        kappa, in units of the square root of the surface's area.
    nu : float
        Smoothness; infinity gives the heat kernel.
    noise : float
        sigma_y^2, in squared units of the modelled function.
    """

    variance: float
    lengthscale: float
    nu: float
    noise: float


def log_spectrum(eigenvalues: NDArray[np.float64], lengthscale: float, nu: float) -> NDArray[np.float64]:
    """Return log of (2 nu / kappa^2 + lambda_n)^(-nu - d/2), relative to its value at lambda = 0.

    The constant left out is one that C_nu takes away again; with it, the power underflows from nu of about 40.
    As nu grows this tends to -kappa^2 lambda / 2, the heat kernel's.
    """
    if np.isinf(nu):
        return -0.5 * lengthscale**2 * eigenvalues
    return -(nu + DIMENSION / 2) * np.log1p(lengthscale**2 * eigenvalues / (2 * nu))


def log_spectrum_slopes(
    eigenvalues: NDArray[np.float64], lengthscale: float, nu: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the derivatives of `log_spectrum` by log kappa and by log nu."""
    if np.isinf(nu):
        return -(lengthscale**2) * eigenvalues, np.zeros_like(eigenvalues)
    x = lengthscale**2 * eigenvalues / (2 * nu)
    share = x / (1 + x)
    power = nu + DIMENSION / 2
    return -2 * power * share, power * share - nu * np.log1p(x)


def spectral_weights(
    eigenvalues: NDArray[np.float64], mean_squares: NDArray[np.float64], theta: Hyperparameters
) -> NDArray[np.float64]:
    """Return w_n such that k(x, x') = sum_n w_n f_n(x) f_n(x'), with sigma^2 as the mean prior variance.

    Parameters
    ----------
    eigenvalues : (L,) array
    mean_squares : (L,) array
        Mean of f_n^2 over the cloud; it makes C_nu exact for functions that are only nearly orthonormal.
    theta : Hyperparameters
    """
    weights = np.exp(log_spectrum(eigenvalues, theta.lengthscale, theta.nu))
    return theta.variance * weights / (weights @ mean_squares)


def kernel_features(eigenfunctions: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Phi of shape (N, L) with K = Phi Phi^T."""
    return eigenfunctions * np.sqrt(weights)
