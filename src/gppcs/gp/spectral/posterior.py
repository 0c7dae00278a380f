"""The posterior of a Gaussian process with K = Phi Phi^T (paper, Eqs. 3 and 4), computed for its L weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from gppcs.engine.blas import one_blas_thread


@dataclass(frozen=True)
class Posterior:
    """The Gaussian posterior of the weights w, (L,), in f = Phi w, with the prior w ~ N(0, I)."""

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @classmethod
    @one_blas_thread()
    def given(cls, phi: NDArray[np.float64], y: NDArray[np.float64], noise: float) -> Posterior:
        """Return the posterior given n observations. Shapes: phi (n, L), y (n,)."""
        precision = np.eye(phi.shape[1]) + phi.T @ phi / noise
        factor = scipy.linalg.cho_factor(precision)
        covariance = scipy.linalg.cho_solve(factor, np.eye(phi.shape[1]))
        return cls(scipy.linalg.cho_solve(factor, phi.T @ y / noise), covariance)

    @one_blas_thread()
    def predict(self, phi: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the posterior mean (Eq. 3) and variance (diagonal of Eq. 4) of f, (N,) each, given phi, (N, L)."""
        return phi @ self.mean, ((phi @ np.linalg.cholesky(self.covariance)) ** 2).sum(axis=1)
