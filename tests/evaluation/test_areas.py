"""Each point counts by the area of the surface that it stands for, however dense the cloud is there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

import gppcs
from gppcs.evaluation.areas import areas_of_points, weighted_quantile
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area

BY_AREA = ("mean_distance", "surface_mean", "surface_p95", "feature_error")  # figures with a form by area


def square(n, left=1, seed=0):
    """Random points of a unit square, (n, 3), whose left half is some times as dense."""
    rng = np.random.default_rng(seed)
    points = np.c_[rng.random((n, 2)), np.zeros(n)]
    more = rng.random(((left - 1) * n // 2, 3)) * [0.5, 1, 0]
    return np.concatenate([points, more])


@pytest.mark.parametrize("left", [1, 2, 20])
def test_areas_are_positive_and_sum_to_that_of_a_plane(left):
    points = square(3000, left)
    areas = areas_of_points(KdTree.build(points))
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(1, rel=0.08)  # discs reach over the border
    assert areas[points[:, 0] < 0.5].sum() == pytest.approx(0.5, rel=0.08)


def test_areas_are_an_eighth_of_the_discs_to_the_eighth_neighbour():
    points = gppcs.sample("bracket", 1500).points
    discs = np.pi / 8 * np.sort(cdist(points, points), axis=1)[:, 8] ** 2
    areas = areas_of_points(KdTree.build(points))
    np.testing.assert_allclose(areas, np.minimum(discs, np.quantile(discs, 0.99)), rtol=1e-9)
    assert areas.sum() == pytest.approx(surface_area(KdTree.build(points)), rel=1e-9)


def test_a_few_outliers_stand_for_little():
    points = np.concatenate([square(3000), 20 * np.random.default_rng(1).random((15, 3))])
    areas = areas_of_points(KdTree.build(points))
    assert areas[-15:].sum() < 0.05 * areas.sum()


@pytest.mark.parametrize("n", [1, 2, 5])
def test_few_points_have_areas(n):
    areas = areas_of_points(KdTree.build(np.cumsum(np.ones((n, 3)), axis=0)))
    assert len(areas) == n
    assert (areas > 0).all()


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


def test_on_an_even_plane_area_changes_little():
    kept = square(300, seed=2) * [1, 1, 0] + [0, 0, 0.05]
    report = gppcs.evaluate(square(4000), kept)
    for name in BY_AREA[:3]:
        assert getattr(report, f"{name}_by_area") == pytest.approx(getattr(report, name), rel=0.05), name


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
    found = weighted_quantile(np.array(values), np.full(len(values), weight), share)
    assert found == pytest.approx(np.quantile(values, share, method="hazen"), rel=1e-9, abs=1e-9)


@given(VALUES, st.floats(0, 1), st.integers(0, 99))
def test_weight_moves_a_percentile_towards_its_value(values, share, seed):
    values = np.array(values)
    weights = np.random.default_rng(seed).uniform(0.1, 1, len(values))
    found = weighted_quantile(values, weights, share)
    assert values.min() <= found <= values.max()
    heavier = weights + np.where(values == values.max(), 1.0, 0.0)
    assert weighted_quantile(values, heavier, share) >= found - 1e-9
    assert weighted_quantile(values, 7 * weights, share) == pytest.approx(found, rel=1e-6, abs=1e-6)
