"""The error over the number of points."""

import pickle

import numpy as np
import pytest

import gppcs
from gppcs.methods import Feature

CLOUD = gppcs.sample("bracket", n_points=3000)


def test_errors_are_those_of_evaluate_for_ranking_methods_and_others():
    for curve in gppcs.curve(CLOUD, ["gp", "fps", "hc"], sizes=[0.05, 300]):
        assert curve.sizes.tolist() == [150, 300]
        assert curve.diagonal == pytest.approx(gppcs.info(CLOUD).diagonal)
        whole = gppcs.simplify(CLOUD, n_points=300, method=curve.method).cloud
        smaller = gppcs.simplify(CLOUD, n_points=150, method=curve.method).cloud
        first = whole[:150] if Feature.RANKING in curve.method.supports else smaller
        for place, cloud in enumerate((first, whole)):
            report = gppcs.evaluate(CLOUD, cloud)
            for name, values in curve.errors.items():
                assert values[place] == pytest.approx(getattr(report, f"surface_{name}"), rel=1e-9)


def test_the_knee_is_farthest_below_the_line_between_the_ends():
    errors = np.array([1.0, 0.4, 0.1, 0.05, 0.0])
    curve = gppcs.Curve(gppcs.Random(), np.array([0, 25, 50, 75, 100]), {"p95": errors}, 1.0)
    assert curve.knee() == 50
    with pytest.raises(gppcs.ParameterError, match="measure to be"):
        curve.knee("p99")


def test_a_result_knows_its_curve_and_its_prefixes():
    result = gppcs.simplify(CLOUD, n_points=400)
    curve = result.curve(CLOUD)
    assert curve.sizes.tolist() == [12, 25, 50, 100, 200, 400]
    half = result.prefix(200)
    assert (half.indices == result.indices[:200]).all()
    assert gppcs.evaluate(CLOUD, half.cloud).surface_mean == pytest.approx(curve.errors["mean"][4], rel=1e-9)
    assert result.curve(CLOUD, sizes=[100]) == result.prefix(100).curve(CLOUD, sizes=[100])
    assert pickle.loads(pickle.dumps(result)) == result


def test_what_is_no_ranking_has_no_prefixes():
    with pytest.raises(gppcs.ParameterError, match="a method that ranks its points, found 'voxel'; use 'gp' or "):
        gppcs.simplify(CLOUD, n_points=50, method="voxel").prefix(10)
    some = CLOUD.points[:200]
    for points, wanted in (
        (some, {"ratio": 1}),
        (np.concatenate([some, some]), {"n_points": 300}),
        (np.concatenate([some, [[np.nan] * 3]]), {"n_points": 200, "invalid": "drop"}),
        (some, {"n_points": 100, "weight": np.arange(200) >= 100}),
    ):
        with pytest.raises(gppcs.ParameterError, match="all points were kept"):
            gppcs.simplify(points, **wanted).prefix(10)
    with pytest.raises(gppcs.ParameterError, match="at most 50 points, as the result has, found 51"):
        gppcs.simplify(CLOUD, n_points=50, method="fps").prefix(51)


@pytest.mark.parametrize("sizes", [[], "5", [0], [1.5], [-1], [True], 3])
def test_sizes_that_are_none_are_refused(sizes):
    with pytest.raises(gppcs.ParameterError, match="size"):
        gppcs.curve(CLOUD, ["random"], sizes=sizes)
    with pytest.raises(gppcs.InputError, match="none of the 2 points"):
        gppcs.simplify(CLOUD, n_points=20, method="fps").curve(np.full((2, 3), np.nan))


def test_sizes_that_take_all_points_but_repeats_change_no_other():
    twice = np.concatenate([CLOUD.points[:200], CLOUD.points[:200]])
    for method in ("fps", "voxel"):
        short, long = (gppcs.curve(twice, [method], sizes=sizes)[0] for sizes in ([50, 100], [50, 100, 300, 10**30]))
        assert long.sizes.tolist() == [50, 100, 300, 400]
        assert (long.errors["mean"][:2] == short.errors["mean"]).all()
        assert (long.errors["mean"][2:] == 0.0).all()


@pytest.mark.parametrize(
    "method",
    [name for name, method in gppcs.METHODS.items() if Feature.RANKING in method.supports and name != "gp"],
)
def test_the_first_points_of_a_ranking_are_those_of_a_smaller_run_or_as_evenly_spread(method):
    long, short = (gppcs.simplify(CLOUD, n_points=n, method=method).indices for n in (200, 100))
    if method == "sample-elimination":  # which orders the points by removing half of them again and again
        pick = [gppcs.evaluate(CLOUD, CLOUD[rows]).covering_radius for rows in (long[:100], short)]
        assert pick[0] < 1.2 * pick[1]
    else:
        assert (long[:100] == short).all()
