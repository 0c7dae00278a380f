"""Samples of rows: random, and the same for any chunks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest

from gppcs.spatial.row_sample import LARGEST, RowSample, drawn, row_hashes


def test_hashes_are_uniform_and_differ():
    hashes = row_hashes(np.arange(100_000))
    assert len(np.unique(hashes)) == 100_000
    assert kstest(hashes / LARGEST, "uniform").pvalue > 0.01
    assert abs(np.corrcoef(hashes[:-1] / LARGEST, hashes[1:] / LARGEST)[0, 1]) < 0.01


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 1.0])
def test_the_share_that_is_drawn(share):
    found = drawn(np.arange(100_000), share).mean()
    assert found == pytest.approx(share, abs=0.005)
    assert found == share or share not in (0.0, 1.0)


@given(st.lists(st.integers(0, 500), max_size=8).map(sorted), st.sampled_from([1, 20, 499, 500, 1_000]))
@settings(max_examples=40)
def test_a_sample_does_not_depend_on_the_chunks(cuts, size):
    points = np.random.default_rng(0).random((500, 3))
    sample = RowSample(size)
    for part in np.split(points, cuts):
        sample.add(part)
    expected = np.argsort(row_hashes(np.arange(500)))[:size]
    np.testing.assert_array_equal(sample.points, points[expected])
