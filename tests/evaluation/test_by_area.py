"""The figures by area do not depend on the density of the original."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

import gppcs
from gppcs.evaluation import judge
from shapes import square

BY_AREA = ("mean_distance", "surface_mean", "surface_p95", "feature_error")  # figures with a form by area


def test_twice_the_density_of_one_half_changes_means_but_not_those_by_area():
    """A plane below a tilted one: the error grows with x, so more points on the left lower its mean."""
    rng = np.random.default_rng(5)
    kept = np.c_[rng.random((400, 2)), np.zeros(400)]
    kept[:, 2] = 0.2 * kept[:, 0]
    even, dense = (gppcs.evaluate(square(4000, left), kept) for left in (1, 2))
    for name in BY_AREA:
        assert getattr(dense, name) / getattr(even, name) < 0.98, name
        by_area = f"{name}_by_area"
        assert getattr(dense, by_area) == pytest.approx(getattr(even, by_area), rel=0.01), name


def test_one_outlier_decides_the_largest_distance_but_not_its_percentile():
    points = square(3000)
    kept = points[::10]
    before, after = (gppcs.evaluate(cloud, kept) for cloud in (points, np.concatenate([points, [[0.5, 0.5, 1]]])))
    assert after.covering_radius > 5 * before.covering_radius
    assert after.covering_p999 == pytest.approx(before.covering_p999, rel=0.1)
    distances = cdist(points, kept).min(axis=1)
    assert before.covering_p999 == pytest.approx(np.quantile(distances, 0.999))


VALUES = st.lists(st.floats(-100, 100), min_size=1, max_size=30)


@given(VALUES, st.floats(0, 1), st.floats(0.01, 100))
def test_equal_weights_give_the_usual_percentile(values, share, weight):
    found = judge._weighted_quantile(np.array(values), np.full(len(values), weight), share)
    assert found == pytest.approx(np.quantile(values, share, method="hazen"), rel=1e-9, abs=1e-9)
