"""Gaps are filled as by farthest points among all, whatever the chunks and however few points are held."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from gppcs.engine.stages import Stages
from gppcs.spatial import gaps
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.gaps import fill_gaps

CUTS = st.lists(st.integers(1, 149), max_size=3, unique=True).map(sorted)


def filled(points, kept, gap, cuts=()):
    return fill_gaps(ChunkedPoints(len(points), lambda: np.split(points, cuts)), kept, gap, Stages())


@pytest.mark.parametrize("held", [2, 15, 10_000])
@given(CUTS, st.integers(0, 99), st.sampled_from([3, 12, 10_000]), st.sampled_from([0.2, 0.5, 9.0]))
@settings(max_examples=6)
def test_as_among_all_points(held, cuts, seed, sides, gap):
    """On a coarse grid, many points are equally far, and many repeat others."""
    points = np.random.default_rng(seed).integers(0, sides, (150, 3)) / sides
    kept = points[:3]
    expected, _ = farthest_points(points, 150, others=kept, least=np.nextafter(gap, np.inf))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gaps, "AT_ONCE", held)
        found = filled(points, kept, gap, cuts)
    np.testing.assert_array_equal(found.rows, expected)
    np.testing.assert_array_equal(found.places, points[expected])
    reached = cKDTree(np.concatenate([kept, points[expected]])).query(points)[0].max()
    assert found.reached <= gap
    assert found.reached == pytest.approx(reached)


def test_a_gap_as_large_as_allowed_is_none():
    points = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]])
    assert filled(points, points[:1], 5.0).reached == 5.0
    assert filled(points, points[:1], 4.9).rows.tolist() == [1]
