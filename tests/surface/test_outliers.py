"""Outliers: found where there are some, and nowhere else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gppcs
from gppcs.spatial.scaling import normalised


def outliers_by_all_pairs(points):
    """The definition, word by word: all pairs of places, round after round."""
    places, back = np.unique(normalised(points)[0], axis=0, return_inverse=True)
    outside, left = np.zeros(len(places), dtype=bool), np.arange(len(places))
    while len(left) > 17:
        near = places[left]
        squared = ((near[:, None] - near) ** 2).sum(axis=2)
        np.fill_diagonal(squared, np.inf)
        nearest = np.sort(squared, axis=1)[:, :16]
        means, new = np.sqrt(nearest).mean(axis=1), np.zeros(len(left), dtype=bool)
        for i, place in enumerate(near):
            others = np.flatnonzero(squared[i] <= nearest[i, -1])
            around = np.median(means[others])
            if means[i] > 2 * around:
                new[i] = means[i] > 10 * around or beside_plane(place, near[others]) > around
        if not new.any():
            break
        outside[left[new]] = True
        left = left[~new]
    return outside[back.ravel()]


def beside_plane(place, others):
    """The distance to the plane of others, added in order of z, y, x: if they lie like a ball, this decides."""
    others = others[np.lexsort(others.T)]
    centre = sum(others) / len(others)
    moments = sum(np.outer(away, away) for away in others - centre)
    return abs(np.linalg.eigh(moments)[1][:, 0] @ (place - centre))


def cloud_with_strays(seed, kind, n, strays):
    """A volume, a noisy plane, or points of grids with many equal distances; some points repeat others."""
    rng = np.random.default_rng(seed)
    points = rng.random((n, 3)) * [20, 20, 20 * (kind == "volume")]
    if kind == "plane":
        points[:, 2] = 0.1 * rng.standard_normal(n)
    stray = 20 * rng.standard_normal((strays, 3)) + [0, 0, 40]
    points = np.concatenate([points, points[: n // 7], stray])
    if kind == "volume grid":
        points[:n, 2] = rng.integers(0, 4, n)
    return np.round(points) if kind.endswith("grid") else points


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    kind=st.sampled_from(["volume", "plane", "grid", "volume grid"]),
    n=st.integers(5, 160),
    strays=st.integers(0, 12),
)
def test_the_definition(seed, kind, n, strays):
    """In any order of the points, also where many distances are equal."""
    points = cloud_with_strays(seed, kind, n, strays)
    expected = outliers_by_all_pairs(points)
    order = np.random.default_rng(seed).permutation(len(points))
    np.testing.assert_array_equal(gppcs.find_outliers(points), expected)
    np.testing.assert_array_equal(gppcs.find_outliers(points[order]), expected[order])


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


def test_repeats_and_points_that_are_not_finite():
    points = np.concatenate([gppcs.sample("sphere", n_points=1000).points, [[0, 0, 900.0]] * 3, [[np.nan, 0, 0]]])
    assert np.flatnonzero(gppcs.find_outliers(points)).tolist() == [1000, 1001, 1002]
    assert not gppcs.find_outliers(np.random.default_rng(0).random((17, 3))).any()
    assert not gppcs.find_outliers(np.empty((0, 3))).any()
