"""Quotas get exact numbers of points, in one choice."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gppcs


@pytest.fixture(scope="module")
def cloud():
    """Return 4,000 points, a tenth of them of class 6, others of class 1 or 2; 200 points repeat others."""
    points = gppcs.sample("bracket", n_points=4000, seed=1).points.copy()
    points[3800:] = points[:200]
    classes = np.where(points[:, 0] < np.quantile(points[:, 0], 0.1), 6, 1 + np.arange(4000) % 2).astype(np.uint8)
    return gppcs.PointCloud(points, {"classification": classes})


def classes_of(result):
    """Return the number of kept points of each class, in a dictionary."""
    found, counts = np.unique(result.cloud.attributes["classification"], return_counts=True)
    return dict(zip(found.tolist(), counts.tolist(), strict=True))


@pytest.mark.parametrize("method", ["gp", "fps", "random"])
def test_each_quota_gets_its_number_and_the_others_share_the_rest(cloud, method):
    quota = {"classification == 6": 150, "classification == 2": "20%"}
    result = gppcs.simplify(cloud, n_points=400, quota=quota, method=method)
    assert classes_of(result) == {6: 150, 2: 80, 1: 170}
    assert len(np.unique(result.indices)) == 400
    all_of_one = gppcs.simplify(cloud, n_points=40, quota={"classification == 6": "100%"}, method=method)
    assert classes_of(all_of_one) == {6: 40}


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1800), st.integers(0, 400), st.integers(1, 1500))
def test_any_numbers_that_exist_are_met_exactly(twos, sixes, rest):
    points = np.random.default_rng(3).integers(0, 12, (4000, 3)).astype(float)  # most are repeats
    classes = np.where(np.arange(4000) < 400, 6, 1 + np.arange(4000) % 2).astype(np.uint8)
    cloud = gppcs.PointCloud(points, {"classification": classes})
    quota = {"classification == 6": sixes, "classification == 2": twos}
    result = gppcs.simplify(cloud, n_points=twos + sixes + rest, quota=quota, method="random")
    assert classes_of(result) == {c: n for c, n in {6: sixes, 2: twos, 1: rest}.items() if n}


def test_the_share_that_a_class_has_anyway_changes_nothing(cloud):
    plain = gppcs.simplify(cloud, n_points=400)
    quota = {"classification == 6": classes_of(plain)[6]}
    np.testing.assert_array_equal(gppcs.simplify(cloud, n_points=400, quota=quota).indices, plain.indices)


def test_a_quota_of_none_or_of_all_of_a_class(cloud):
    classes = cloud.attributes["classification"]
    everything = int((classes == 6).sum())
    result = gppcs.simplify(cloud, n_points=800, quota={"classification == 6": everything, "classification == 2": 0})
    assert classes_of(result) == {6: everything, 1: 800 - everything}


def test_points_to_keep_count_in_their_quota(cloud):
    keep = np.flatnonzero(cloud.attributes["classification"] == 6)[:40]
    result = gppcs.simplify(cloud, n_points=300, keep=keep, quota={"classification == 6": 60})
    assert set(keep) <= set(result.indices.tolist())
    assert classes_of(result)[6] == 60
    with pytest.raises(gppcs.InputError, match=r"40 points with classification == 6 are to be kept .* only 30"):
        gppcs.simplify(cloud, n_points=300, keep=keep, quota={"classification == 6": 30})


def test_one_choice_leaves_no_seam(cloud):
    """Where two classes are mixed on one surface, a choice in each alone would put their points close together."""
    quota = {"classification == 2": 150, "classification == 1": 150}
    mixed = gppcs.PointCloud(cloud.points, {"classification": (1 + np.arange(4000) % 2).astype(np.uint8)})
    together = gppcs.simplify(mixed, n_points=300, quota=quota)
    alone = np.concatenate(
        [
            gppcs.simplify(cloud.points[mixed.attributes["classification"] == each], n_points=150).cloud.points
            for each in (1, 2)
        ]
    )
    error, of_two = (gppcs.evaluate(mixed, kept).surface_mean for kept in (together.cloud, alone))
    assert error < 0.85 * of_two


@pytest.mark.parametrize(
    ("quota", "problem"),
    [
        ({"classification == 6": 4000}, "at most the 400 points asked for, found 4,000"),
        ({"classification == 7": 10}, "at least 10 points with classification == 7, found 0"),
        ({"classification >= 1": 10}, "at least 390 points of no quota, found 0"),
        ({"classification == 6": 10, "x < 1e9": 5}, "do not overlap, found .* 'classification == 6' and 'x < 1e9'"),
        ({"clasification == 6": 10}, "classification"),
    ],
)
def test_quotas_that_cannot_be_met(cloud, quota, problem):
    with pytest.raises(gppcs.GppcsError, match=problem):
        gppcs.simplify(cloud, n_points=400, quota=quota)
