import numpy as np
import pytest

import dense
import gppcs
from gppcs.gp.spectral.laplacian import eigenpairs
from gppcs.gp.spectral.posterior import posterior


@pytest.mark.parametrize("active", [0, 1, 7, 50, 399])
def test_equals_equations_3_and_4(active):
    """Without data it is the prior."""
    points = gppcs.sample("medallion", n_points=400, seed=5).points
    y, noise = gppcs.estimate_features(points).surface_variation, 1e-2
    phi = 0.03 * eigenpairs(points, 20)[1].at(points)
    chosen = np.random.default_rng(active).permutation(400)[:active]
    mean, covariance = posterior(phi[chosen], y[chosen], noise)
    found = phi @ mean, np.einsum("nl,lm,nm->n", phi, covariance, phi)
    expected = dense.posterior(phi, y, noise, chosen) if active else (0, (phi**2).sum(axis=1))
    np.testing.assert_allclose(found, np.broadcast_arrays(*expected), rtol=1e-9)
