import numpy as np
import pytest

from gppcs.gp.local.density import roundness_of


def test_flat_faces_with_edges_are_not_round():
    for edges in (0.1, 0.5, 0.9):
        of_faces = np.where(np.arange(100) < 100 * edges, 0.29, 0.0)
        assert roundness_of(of_faces) == pytest.approx(0)
        assert roundness_of(np.where(of_faces > 0, 0.5, 0.0)) == pytest.approx(0)  # what is sharper counts no more
    assert roundness_of(np.full(9, 0.29)) == roundness_of(np.zeros(9)) == 1
    assert roundness_of(np.linspace(0, 0.29, 999)) == pytest.approx((1 - 1 / 9) ** 4, rel=0.01)
