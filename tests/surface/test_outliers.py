"""Outliers: found where there are some, and nowhere else."""

import numpy as np
import pytest

import gppcs


@pytest.mark.parametrize("name", ["bracket", "fan", "medallion"])
def test_clean_scans_have_none_also_at_their_borders(name):
    assert not gppcs.find_outliers(gppcs.sample(name, n_points=5000)).any()


@pytest.mark.parametrize("name", ["bracket", "fan"])
def test_most_stray_points_are_found_and_no_others(name):
    cloud = gppcs.sample(name, n_points=10_000, outliers=0.01)
    stray, found = cloud.attributes["outlier"] == 1, gppcs.find_outliers(cloud)
    assert (found & stray).sum() >= 0.6 * stray.sum()
    assert (found & ~stray).sum() <= 0.02 * found.sum()


def test_a_sparse_part_of_a_scan_is_no_outlier():
    """A plane of which one half has a hundredth of the points."""
    rng = np.random.default_rng(0)
    places = [rng.random((n, 2)) + np.array([left, 0]) for n, left in ((10_000, 0), (100, 1))]
    points = np.column_stack([np.concatenate(places), np.zeros(10_100)])
    assert not gppcs.find_outliers(points).any()


def test_a_clump_of_outliers_does_not_explain_itself():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.random((4000, 2)), np.zeros(4000)])
    clump = [0.5, 0.5, 0.7] + 1e-3 * rng.random((6, 3))
    assert np.flatnonzero(gppcs.find_outliers(np.concatenate([points, clump]))).tolist() == list(range(4000, 4006))


def test_repeats_and_points_that_are_not_finite():
    points = np.concatenate([gppcs.sample("sphere", n_points=1000).points, [[0, 0, 900.0]] * 3, [[np.nan, 0, 0]]])
    assert np.flatnonzero(gppcs.find_outliers(points)).tolist() == [1000, 1001, 1002]
    assert not gppcs.find_outliers(np.random.default_rng(0).random((17, 3))).any()
    assert not gppcs.find_outliers(np.empty((0, 3))).any()
