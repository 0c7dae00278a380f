"""Gaps are filled as by farthest points among all."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.gaps import fill_gaps


@given(st.integers(0, 99), st.sampled_from([3, 12, 10_000]), st.sampled_from([0.2, 0.5, 9.0]))
@settings(max_examples=20)
def test_as_among_all_points(seed, sides, gap):
    """On a coarse grid, many points are equally far, and many repeat others."""
    points = np.random.default_rng(seed).integers(0, sides, (150, 3)) / sides
    kept = points[:3]
    expected, _ = farthest_points(points, 150, others=kept, least=np.nextafter(gap, np.inf))
    added, reached = fill_gaps(points, kept, gap)
    np.testing.assert_array_equal(added, expected)
    assert reached <= gap
    assert reached == pytest.approx(cKDTree(np.concatenate([kept, points[expected]])).query(points)[0].max())
