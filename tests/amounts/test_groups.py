"""Groups of points, such as pulses, are kept or dropped whole."""

import numpy as np
import pytest

import gppcs


def pulses(n=3000, channels=1, seed=0):
    """Return a cloud of pulses with one to four returns each; channels have pulses at the same times."""
    random = np.random.default_rng(seed)
    returns = random.integers(1, 5, n)
    times = np.repeat(1e8 + np.arange(n) // channels, returns)
    ground = np.repeat(random.random((n, 2)), returns, axis=0)
    height = np.concatenate([np.arange(count) * 0.05 for count in returns])
    channel = np.repeat(np.arange(n) % channels, returns).astype(np.uint8)
    points = np.column_stack([ground + 0.01 * random.random(ground.shape), height])
    order = random.permutation(len(points))
    return gppcs.PointCloud(points[order], {"gps_time": times[order], "scanner_channel": channel[order]})


@pytest.mark.parametrize("method", ["gp", "fps", "random"])
@pytest.mark.parametrize("channels", [1, 2])
def test_pulses_are_whole_and_as_many_points_as_they_allow(method, channels):
    cloud = pulses(channels=channels)
    result = gppcs.simplify(cloud, n_points=1000, group="gps_time", method=method)
    key = cloud.attributes["gps_time"] * 4 + cloud.attributes["scanner_channel"]
    kept = np.zeros(len(cloud), dtype=bool)
    kept[result.indices] = True
    assert kept.sum() == len(result.indices)
    assert not np.isin(key[~kept], key[kept]).any()
    assert abs(kept.sum() - 1000) <= 2  # half of the largest pulse
    assert result.diagnostics["groups"] == len(np.unique(key[kept]))


def test_a_group_of_each_point_changes_nothing():
    cloud = gppcs.sample("bracket", n_points=3000)
    numbered = gppcs.PointCloud(cloud.points, {"id": np.random.default_rng(1).permutation(3000)})
    plain = gppcs.simplify(numbered, n_points=200)
    np.testing.assert_array_equal(gppcs.simplify(numbered, n_points=200, group="id").indices, plain.indices)


@pytest.mark.parametrize("n_points", [300, 2900])
def test_points_of_weight_0_are_left_out_of_their_groups_unless_they_are_to_be_kept(n_points):
    cloud = pulses(1500)
    weights = (np.arange(len(cloud)) % 4 > 0).astype(np.float64)
    result = gppcs.simplify(cloud, n_points=n_points, group="gps_time", weight=weights, keep=[4])
    assert result.indices[weights[result.indices] == 0.0].tolist() == [4]
    assert abs(len(result.indices) - min(n_points, weights.sum() + 1)) <= 2


def test_at_least_one_group_is_kept_and_at_most_all():
    cloud = gppcs.PointCloud(np.random.default_rng(0).random((90, 3)), {"tree": np.repeat(["oak", "elm", "ash"], 30)})
    assert len(gppcs.simplify(cloud, n_points=2, group="tree").cloud) == 30
    assert len(gppcs.simplify(cloud, n_points=44, group="tree").cloud) == 30
    assert len(gppcs.simplify(cloud, n_points=46, group="tree").cloud) == 60
    assert len(gppcs.simplify(cloud, n_points=90, group="tree").cloud) == 90


@pytest.mark.parametrize(
    ("group", "problem"),
    [("gps_tme", "no attribute 'gps_tme' to group its points by.*gps_time"), ("broken", "found 1 that are NaN")],
)
def test_attributes_that_make_no_groups(group, problem):
    cloud = pulses()
    broken = cloud.attributes["gps_time"].copy()
    broken[5] = np.nan
    cloud = gppcs.PointCloud(cloud.points, {**cloud.attributes, "broken": broken})
    with pytest.raises(gppcs.InputError, match=problem):
        gppcs.simplify(cloud, n_points=100, group=group)
