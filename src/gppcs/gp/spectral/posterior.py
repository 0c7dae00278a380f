"""The posterior of a Gaussian process with K = Phi Phi^T (paper, Eqs. 3 and 4), computed for its L weights."""

import numpy as np
import scipy.linalg

from gppcs.engine.arrays import Floats
from gppcs.engine.blas import one_blas_thread


@one_blas_thread()
def posterior(phi: Floats, y: Floats, noise: float) -> tuple[Floats, Floats]:
    """Return mean, (L,), and covariance, (L, L), of the weights w in f = Phi w, with the prior w ~ N(0, I).

    Shapes: phi (n, L) and y (n,), of the n observations.
    """
    precision = np.eye(phi.shape[1]) + phi.T @ phi / noise
    factor = scipy.linalg.cho_factor(precision)
    covariance = scipy.linalg.cho_solve(factor, np.eye(phi.shape[1]))
    return scipy.linalg.cho_solve(factor, phi.T @ y / noise), covariance
