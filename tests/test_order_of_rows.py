"""The same points are kept in whatever order the rows of a cloud come."""

from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import gppcs
from gppcs.gp.local import candidates
from scans import sample
from shapes import KINDS

METHODS = ("gp", "fps", "voxel", "sample-elimination", "random")
CLOUDS = {
    "bracket": {},
    "medallion": {"noise": 0.0005},
    "sphere": {"noise": 0.01},
    "statue": {"uneven": 0.9},
    "terrain": {"outliers": 0.02},
    "avenue": {},
    "room": {},
}
OPTIONS = [
    {"detail": "intensity"},
    {"weight": "intensity"},
    {"keep": "intensity > 0.99"},
    {"tolerance": "0.5%"},
    {"spacing": "2%"},
    {"max_gap": "5%"},
    {"drop_outliers": True, "n_points": 200},
]


@cache
def cloud_of(name, n_points=8_000):
    points = np.unique(sample(name, n_points=n_points, **CLOUDS[name]).points, axis=0)
    return gppcs.PointCloud(points, {"intensity": np.modf(7.0 * points.sum(axis=1) / np.ptp(points))[0] % 1.0})


def kept(cloud, order=None, **options):
    """The rows of a cloud that are kept, and their coordinates then, ascending, if its rows come in an order."""
    order = np.arange(len(cloud)) if order is None else order
    result = gppcs.simplify(cloud.take(order), **options)
    rows = order[result.indices]
    return np.sort(rows), result.points[np.argsort(rows)]


def assert_same_in_another_order(cloud, seed=0, **options):
    expected, places = kept(cloud, **options)
    rows, permuted_places = kept(cloud, np.random.default_rng(seed).permutation(len(cloud)), **options)
    np.testing.assert_array_equal(rows, expected)
    np.testing.assert_array_equal(permuted_places, places)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", CLOUDS)
def test_methods_keep_the_same_points(name, method):
    assert_same_in_another_order(cloud_of(name), ratio=0.05, method=method)


@pytest.mark.parametrize("options", OPTIONS, ids=lambda options: next(iter(options)))
def test_options_keep_the_same_points(options):
    amount = {} if {"tolerance", "spacing", "max_gap", "n_points"} & set(options) else {"ratio": 0.05}
    assert_same_in_another_order(cloud_of("terrain"), **options, **amount)


@pytest.mark.parametrize("name", ["sphere", "medallion"])
def test_denoised_points_are_the_same(name):
    assert_same_in_another_order(cloud_of(name), ratio=0.05, method=gppcs.LocalGP(denoise=True))


@pytest.mark.parametrize("method", METHODS)
@given(
    st.integers(2, 300),
    st.sampled_from(["solid", "lattice", "lattice in a plane"]),
    st.integers(0, 99),
    st.floats(0.001, 1.0),
)
@example(42, "lattice", 41, 0.26)  # an area that differs in the last digit decides between equals
@settings(max_examples=20)
def test_small_clouds_with_ties_keep_the_same_points(method, n, shape, seed, fraction):
    points = np.unique(KINDS[shape](np.random.default_rng(seed), n), axis=0)
    n_points = int(np.ceil(fraction * len(points)))
    assert_same_in_another_order(gppcs.PointCloud(points), seed, n_points=n_points, method=method)


@pytest.mark.parametrize("name", ["bracket", "avenue"])
def test_a_sample_and_cells_of_some_points_are_the_same(name, monkeypatch):
    """So few points are kept that the survey and the placement look at some of the others only."""
    monkeypatch.setattr(candidates, "SAMPLE_SIZE", 4_000)
    assert_same_in_another_order(cloud_of(name, 30_000), n_points=100)
