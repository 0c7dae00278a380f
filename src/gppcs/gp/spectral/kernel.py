"""The Matérn kernel on a manifold, truncated to L eigenfunctions (paper, Eq. 6; Borovitskiy et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.blas import one_blas_thread

DIMENSION = 2  # d in Eq. 6: the manifold is a surface


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
        Smoothness of the kernel; infinity means the heat kernel.
    noise : float
        sigma_y^2, in squared units of the modelled function.
    """

    variance: float
    lengthscale: float
    nu: float
    noise: float


def log_spectrum(eigenvalues: NDArray[np.float64], lengthscale: float, nu: float) -> NDArray[np.float64]:
    """Return the log of (2 nu / kappa^2 + lambda_n)^(-nu - d/2) in Eq. 6, minus its value at lambda = 0.

    The value at lambda = 0 would cancel with C_nu in Eq. 6 anyway. Without subtracting it, the power underflows for
    nu above about 40. As nu grows, the result tends to -kappa^2 lambda / 2, the spectrum of the heat kernel.

    Shapes: eigenvalues (L,); returns (L,).
    """
    if np.isinf(nu):
        return -0.5 * lengthscale**2 * eigenvalues
    return -(nu + DIMENSION / 2) * np.log1p(lengthscale**2 * eigenvalues / 2 / nu)


def log_spectrum_slopes(
    eigenvalues: NDArray[np.float64], lengthscale: float, nu: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the derivatives of `log_spectrum`.

    Shapes: returns by_lengthscale, by_nu (L,).
    """
    if np.isinf(nu):
        return -(lengthscale**2) * eigenvalues, np.zeros_like(eigenvalues)
    x = lengthscale**2 * eigenvalues / 2 / nu  # 2 nu could overflow
    share = x / (1 + x)
    power = nu + DIMENSION / 2
    return -power * (2 * share), power * share - nu * np.log1p(x)


@one_blas_thread()
def spectral_weights(
    eigenvalues: NDArray[np.float64], mean_squares: NDArray[np.float64], theta: Hyperparameters
) -> NDArray[np.float64]:
    """Return the weights w_n of the kernel k(x, x') = sum_n w_n f_n(x) f_n(x') (paper, Eq. 6).

    They are scaled by C_nu so that the mean prior variance over the cloud is sigma^2.

    Shapes: eigenvalues (L,), mean_squares (L,); returns (L,).
    """
    weights = np.exp(log_spectrum(eigenvalues, theta.lengthscale, theta.nu))
    return theta.variance * weights / (weights @ mean_squares)


def kernel_features(eigenfunctions: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the feature matrix Phi of the kernel, so that K = Phi Phi^T.

    Shapes: eigenfunctions (N, L), weights (L,); returns (N, L).
    """
    return eigenfunctions * np.sqrt(weights)
