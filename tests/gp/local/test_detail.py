"""The variation of attributes about linear functions of the place."""

import numpy as np
import pytest

from gppcs.gp.local.detail import Detail, residuals
from gppcs.gp.local.settings import DETAIL_ROUGHNESS
from gppcs.spatial.kdtree import KdTree

RNG = np.random.default_rng(0)
POINTS = RNG.random((400, 3)) * [1.0, 1.0, 0.2]
RADIUS = 0.3


def test_residuals_are_those_of_a_least_squares_fit():
    tree, values = KdTree.build(POINTS), RNG.normal(size=(400, 2))
    places, expected = tree.points.T, np.empty((400, 2))
    for i, place in enumerate(places):
        near = np.flatnonzero(((places - place) ** 2).sum(axis=1) <= RADIUS**2)
        x, y = places[near] - places[near].mean(axis=0), values[near] - values[near].mean(axis=0)
        covariance = x.T @ x / len(near) + 1e-3 * RADIUS**2 * np.eye(3)
        across = x.T @ y / len(near)
        left = (y**2).mean(axis=0) - (across * np.linalg.solve(covariance, across)).sum(axis=0)
        expected[i] = left * len(near) / (len(near) - 4)
    assert residuals(tree, values, RADIUS) == pytest.approx(expected, rel=1e-9)


def test_a_step_counts_as_rough_as_it_is_near():
    points = np.c_[RNG.random((30_000, 2)), np.zeros(30_000)]
    step = (points[:, :1] < 0.5).astype(np.float32)
    tree = KdTree.build(points)
    detail = Detail.measure(tree, np.arange(len(points)), step, 0.05 / 1.5)
    far = np.abs(points[:, 0] - 0.5) > 0.05
    assert (detail.variation[far] == 0.0).all()
    at_step = detail.variation[np.abs(points[:, 0] - 0.5) < 0.005].mean()
    left = 1 / 4 - 16 / (9 * np.pi**2)  # of the variance of a step through the middle of a disc, by its linear fit
    assert at_step == pytest.approx(DETAIL_ROUGHNESS * left, rel=0.05)


def test_noise_lowers_what_an_attribute_counts():
    points = np.c_[RNG.random((30_000, 2)), np.zeros(30_000)]
    tree, rows = KdTree.build(points), np.arange(30_000)
    step, noise = (points[:, :1] < 0.5).astype(np.float32), RNG.normal(0.0, 0.4, (30_000, 1)).astype(np.float32)
    clean, noisy = (Detail.measure(tree, rows, each, 0.03) for each in (step, step + noise))
    assert 0.98 < np.ptp(clean.values) <= 1.0
    assert (noisy.values[:, 0] / (step + noise)[:, 0]).max() < 0.8
    with pytest.warns(UserWarning, match="only noise"):
        assert Detail.measure(tree, rows, noise, 0.03) is None


@pytest.mark.parametrize("within", [4, 8, 20])
def test_what_is_only_noise_counts_for_nothing_beside_what_is_not(within):
    """At any number of points within the radius of the fits: numbers, and classes of which each is rare."""
    points = np.c_[RNG.random((10_000, 2)), np.zeros(10_000)]
    step = (points[:, :1] < 0.5).astype(np.float32)
    labels = RNG.integers(0, 12, 10_000)[:, np.newaxis] == np.arange(12)
    attributes = np.concatenate([step, RNG.normal(size=(10_000, 1)), labels], axis=1, dtype=np.float32)
    edge = np.sqrt(within / (np.pi * 10_000)) / 1.5
    tree, indices = KdTree.build(points), np.arange(10_000)
    alone, beside = (Detail.measure(tree, indices, each, edge) for each in (step, attributes))
    assert not beside.values[:, 1:].any()
    assert (beside.values[:, :1] == alone.values).all()
    assert (beside.variation == alone.variation).all()
