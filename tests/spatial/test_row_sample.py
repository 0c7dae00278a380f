"""Samples of rows are random."""

import numpy as np
import pytest
from scipy.stats import kstest

from gppcs.spatial.row_sample import HASHES, drawn, hashes


def test_hashes_are_uniform_and_differ():
    found = hashes(np.arange(100_000, dtype=np.uint64))
    assert len(np.unique(found)) == 100_000
    assert kstest(found / HASHES, "uniform").pvalue > 0.01
    assert abs(np.corrcoef(found[:-1] / HASHES, found[1:] / HASHES)[0, 1]) < 0.01


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 1.0])
def test_the_share_that_is_drawn(share):
    found = drawn(np.arange(100_000), share).mean()
    assert found == pytest.approx(share, abs=0.005)
    assert found == share or share not in (0.0, 1.0)
