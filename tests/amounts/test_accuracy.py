"""The fewest points that reach an accuracy."""

import math

import numpy as np
import pytest

import gppcs
from gppcs.clouds.quantities import MEASURES

CLOUD = gppcs.sample("bracket", n_points=4000)
BALL = gppcs.sample("sphere", n_points=1200)
DIAGONAL = gppcs.info(CLOUD).diagonal


def error(kept, measure="max"):
    """What `gppcs.evaluate` says of some of the points."""
    return getattr(gppcs.evaluate(CLOUD, kept), f"surface_{measure}")


@pytest.mark.parametrize("measure", MEASURES)
def test_a_tolerance_is_reached_and_five_per_cent_fewer_points_of_the_ranking_miss_it(measure):
    tolerance = {"mean": 0.3, "rms": 0.6, "p95": 1.0, "max": 4.0}[measure]
    result = gppcs.simplify(CLOUD, tolerance=f"{tolerance}:{measure}")
    reached = error(result.cloud, measure)
    assert reached <= tolerance
    assert result.diagnostics[f"surface_{measure}"] == pytest.approx(reached, rel=1e-9)
    fewer = result.prefix(math.floor(0.95 * len(result.indices)))
    assert error(fewer.cloud, measure) > tolerance


@pytest.mark.parametrize("method", ["fps", "random", "voxel"])
def test_other_methods_reach_it_too(method):
    result = gppcs.simplify(CLOUD, tolerance="1:p95", method=method)
    assert error(result.cloud, "p95") <= 1.0
    assert error(gppcs.simplify(CLOUD, n_points=round(0.94 * len(result.indices)), method=method).cloud, "p95") > 1.0


def test_a_tolerance_alone_bounds_the_largest_error_of_all_but_outliers():
    stray = np.vstack([CLOUD.points, [[500.0, 0.0, 0.0], [0.0, 0.0, 700.0]]])
    result = gppcs.simplify(stray, tolerance=4.0)
    aside = gppcs.find_outliers(stray)
    kept = result.cloud.points
    assert gppcs.evaluate(stray[~aside], kept).surface_max <= 4.0
    assert result.diagnostics["largest_error"] <= 4.0
    assert result.diagnostics["points_set_aside"] == aside.sum() >= 2
    assert result.diagnostics["surface_max"] == pytest.approx(gppcs.evaluate(stray, kept).surface_max)
    clean = gppcs.simplify(CLOUD, tolerance=4.0).diagnostics
    assert clean["largest_error"] == pytest.approx(clean["surface_max"])
    assert "points_set_aside" not in clean


def test_lengths_with_units_and_shares_mean_the_same():
    kept = [
        gppcs.simplify(CLOUD, method="fps", **wanted).indices.tolist()
        for wanted in (
            {"tolerance": 1.0},
            {"tolerance": "0.1 cm", "unit": "mm"},
            {"tolerance": f"{100 / DIAGONAL!r}%"},
        )
    ]
    assert all(each == kept[0] for each in kept)


def test_a_tiny_tolerance_takes_all_points_and_a_large_one_a_single_point():
    assert len(gppcs.simplify(BALL, tolerance="1e-12:max").indices) == len(BALL)
    assert len(gppcs.simplify(CLOUD, tolerance=1e6).indices) == 1
    assert gppcs.simplify([[0.0, 0.0, 0.0]], tolerance=1.0).indices.tolist() == [0]
