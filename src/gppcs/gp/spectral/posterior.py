"""The posterior of a Gaussian process with K = Phi Phi^T (paper, Eqs. 3 and 4), computed for its L weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from gppcs.engine.blas import one_blas_thread
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges


@dataclass(frozen=True)
class Posterior:
    """The Gaussian posterior of the weights w in f = Phi w; the prior is w ~ N(0, I).

    Attributes
    ----------
    mean : (L,) array, float64
    covariance : (L, L) array, float64
    """

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @classmethod
    @one_blas_thread()
    def given(cls, phi: NDArray[np.float64], y: NDArray[np.float64], noise: float) -> Posterior:
        """Return the posterior given n observations.

        Shapes: phi (n, L), y (n,).
        """
        precision = np.eye(phi.shape[1]) + phi.T @ phi / noise
        factor = scipy.linalg.cho_factor(precision)
        covariance = scipy.linalg.cho_solve(factor, np.eye(phi.shape[1]))
        return cls(scipy.linalg.cho_solve(factor, phi.T @ y / noise), covariance)

    @one_blas_thread()
    def predict(self, phi: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the posterior mean (Eq. 3) and variance (diagonal of Eq. 4) of f.

        Shapes: phi (N, L); returns mean, variance (N,).
        """
        mean, variance = np.empty(len(phi)), np.empty(len(phi))
        on_ranges(_predict, len(phi), phi, self.mean, np.linalg.cholesky(self.covariance), mean, variance, least=32)
        return mean, variance


@kernel(fastmath={"contract", "reassoc", "nsz"})
def _predict(begin, end, phi, weight_mean, factor, mean, variance):
    """Fill `mean` and `variance`, (N,), from `phi` (N, L), `weight_mean` (L,) and a Cholesky factor (L, L)."""
    count = phi.shape[1]
    for i in range(begin, end):
        total = 0.0
        for c in range(count):
            total += phi[i, c] * weight_mean[c]
        mean[i] = total
        squares = 0.0
        for c in range(count):
            part = 0.0
            for r in range(c, count):
                part += phi[i, r] * factor[r, c]
            squares += part * part
        variance[i] = squares
