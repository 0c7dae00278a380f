"""A spacing, a largest gap, points to keep and weights."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import gppcs

CLOUD = gppcs.sample("bracket", n_points=4000)
BALL = gppcs.sample("sphere", n_points=20_000)
UPPER = BALL.points[:, 2] > BALL.points[:, 2].mean()


def gaps(points):
    """Distance of each point to its nearest neighbour."""
    return cKDTree(points).query(points, k=2)[0][:, 1]


def covering(kept, points=CLOUD.points):
    return cKDTree(kept).query(points)[0].max()


def test_the_mean_spacing_of_gp_is_that_asked_for():
    """The area of the sphere is known."""
    result = gppcs.simplify(BALL, spacing=4.0)
    radius = np.ptp(BALL.points[:, 2]) / 2.0
    assert len(result.indices) == pytest.approx(4.0 * np.pi * radius**2 / 16.0, rel=0.05)


def test_fps_keeps_points_that_are_as_far_apart_as_asked_and_leaves_no_larger_gap():
    kept = gppcs.simplify(CLOUD, spacing=4.0, method="fps").cloud.points
    assert gaps(kept).min() >= 4.0
    assert covering(kept) < 4.0


@pytest.mark.parametrize("method", ["gp", "voxel", "random"])
def test_points_are_added_until_no_gap_is_too_large(method):
    result = gppcs.simplify(CLOUD, n_points=200, max_gap=6.0, method=method)
    assert covering(result.cloud.points) <= 6.0
    assert len(result.indices) == 200 + result.diagnostics["added_in_gaps"]
    first = gppcs.simplify(CLOUD, n_points=200, method=method)
    assert (result.indices[:200] == first.indices).all()
    assert len(np.unique(result.indices)) == len(result.indices)


def test_a_largest_gap_alone_chooses_about_as_many_as_it_takes():
    result = gppcs.simplify(CLOUD, max_gap=6.0, scores=True)
    assert covering(result.cloud.points) <= 6.0
    assert result.diagnostics["added_in_gaps"] < 0.6 * len(result.indices)
    assert (result.cloud.attributes["score"][-1:] == 0.0).all()


def test_points_to_keep_are_kept_come_first_and_count():
    rows = np.random.default_rng(0).permutation(len(CLOUD))[:30]
    mask = np.isin(np.arange(len(CLOUD)), rows)
    result = gppcs.simplify(CLOUD, n_points=300, keep=mask)
    assert len(np.unique(result.indices)) == 300
    assert (result.indices[:30] == np.sort(rows)).all()
    assert (gppcs.simplify(CLOUD, n_points=300, keep=rows).indices == result.indices).all()
    assert (gppcs.simplify(CLOUD, n_points=30, keep=rows).indices == np.sort(rows)).all()


def test_the_others_go_where_points_to_keep_are_not():
    keep = np.flatnonzero(UPPER)[::20][:200]
    others = gppcs.simplify(BALL, n_points=400, keep=keep).indices[200:]
    assert np.median(cKDTree(BALL.points[keep]).query(BALL.points[others])[0]) > 4.0
    assert UPPER[others].mean() < 0.3


def test_points_to_keep_by_a_condition_and_without_invalid_ones():
    points = CLOUD.points.copy()
    points[7] = np.nan
    cloud = gppcs.PointCloud(points, {"kind": (np.arange(len(points)) < 20).astype(np.uint8)})
    with pytest.warns(UserWarning, match="1 of the points to keep are dropped"):
        result = gppcs.simplify(cloud, n_points=100, keep="kind == 1", invalid="drop")
    assert result.indices[:19].tolist() == [row for row in range(20) if row != 7]


def test_a_tolerance_with_points_to_keep():
    keep = np.arange(60)
    result = gppcs.simplify(CLOUD, tolerance=1.0, keep=keep)
    assert (result.indices[:60] == keep).all()
    assert gppcs.evaluate(CLOUD, result.cloud).surface_p95 <= 1.0
    assert len(gppcs.simplify(CLOUD, tolerance=1e6, keep=keep).indices) == 60


def test_a_weight_of_four_on_half_of_a_sphere_gives_four_times_the_points_there():
    """Apart from the border, where the density has to pass from one to the other."""
    upper = UPPER[gppcs.simplify(BALL, n_points=4000, weight=np.where(UPPER, 4.0, 1.0)).indices]
    assert upper.sum() / (~upper).sum() == pytest.approx(4.0, rel=0.1)


def test_weights_may_be_a_formula():
    x, y, _ = BALL.points.T
    by_array = gppcs.simplify(BALL, n_points=200, weight=1 / (1 + x * x + y * y))
    assert (gppcs.simplify(BALL, n_points=200, weight="1 / (1 + x*x + y*y)").indices == by_array.indices).all()
    by_array = gppcs.simplify(BALL[UPPER], n_points=200, weight=BALL.points[UPPER, 2])
    assert (gppcs.simplify(BALL[UPPER], n_points=200, weight="z").indices == by_array.indices).all()


def test_only_the_ratio_of_weights_counts_and_points_without_weight_are_left_out():
    weights = np.where(UPPER, 3.0, 0.0)
    result = gppcs.simplify(BALL, n_points=200, weight=weights)
    assert UPPER[result.indices].all()
    assert (gppcs.simplify(BALL, n_points=200, weight=10.0 * weights).indices == result.indices).all()
    lower = np.flatnonzero(~UPPER)[:10]
    assert (gppcs.simplify(BALL, n_points=200, weight=weights, keep=lower).indices[:10] == lower).all()


def test_repeats_have_weights_too():
    twice = np.concatenate([CLOUD.points[:200], CLOUD.points[:200]])
    weights = np.where(np.arange(400) % 2, 1e308, 1e-308)
    assert len(np.unique(gppcs.simplify(twice, n_points=300, weight=weights).indices)) == 300
    weights[::2] = 0.0
    kept = gppcs.simplify(twice, n_points=150, weight=weights, keep=[8]).indices
    assert len(np.unique(kept)) == 150
    assert (weights[kept] == 0.0).sum() == 1
    with pytest.raises(gppcs.InputError, match="at least 201 points of a weight above 0, found 200"):
        gppcs.simplify(twice, n_points=201, weight=weights)


def test_the_number_is_exact_with_repeats_too():
    twice = np.concatenate([CLOUD.points[:50]] * 2)
    for count in (30, 60, 100):
        for more in ({"keep": [3, 53]}, {"max_gap": 1e6}):
            result = gppcs.simplify(twice, n_points=count, scores=True, **more)
            assert len(np.unique(result.indices)) == len(result.cloud) == count


@pytest.mark.parametrize("length", [1e-300, 1e300, "1e-300%"])
@pytest.mark.parametrize("factor", [1e-200, 1.0, 1e200])
def test_extreme_lengths(length, factor):
    points = CLOUD.points[:300] * factor
    for name in ("tolerance", "spacing", "max_gap"):
        for method in ("gp", "fps", "sample-elimination", "voxel"):
            kept = gppcs.simplify(points, method=method, **{name: length}).indices
            assert len(np.unique(kept)) == len(kept) >= 1
            if length == "1e-300%":
                assert len(kept) > 280
