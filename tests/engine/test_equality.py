"""Equality of the public dataclasses that hold arrays."""

import dataclasses

import numpy as np
import pytest

import gppcs
from gppcs.evaluation.report import Rebuilt

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, np.nan]])


def cloud(points=POINTS, label=(1, 2, 3, 4), dtype="f4", **attributes):
    return gppcs.PointCloud(points, {"label": np.array(label), **attributes}, np.dtype(dtype))


def test_clouds_are_equal_if_all_values_are():
    """NaN equals NaN, the order of attributes does not matter."""
    rows = np.array(["a", "b", "", "d"])
    assert cloud() == cloud()
    assert cloud(rows=rows, w=np.zeros(4)) == cloud(w=np.zeros(4), rows=rows.copy())
    assert gppcs.PointCloud(np.empty((0, 3))) == gppcs.PointCloud(np.empty((0, 3)))


@pytest.mark.parametrize(
    "other",
    [
        cloud(np.nan_to_num(POINTS)),
        cloud(label=(1, 2, 3, 5)),
        cloud(label=(1.0, 2.0, 3.0, 4.0)),
        "cloud",
    ],
)
def test_clouds_are_unequal_if_anything_is(other):
    assert other != cloud()
    assert (cloud() == other) is False


def public_objects(seed):
    points = np.random.default_rng(seed).random((60, 3))
    triangle = gppcs.Mesh(points[:3], [[0, 1, 2]])
    ball = gppcs.sample("sphere", n_points=500, seed=seed)
    method = gppcs.FarthestPoint()
    return {
        "cloud": gppcs.PointCloud(points),
        "mesh": triangle,
        "features": gppcs.estimate_features(points),
        "selection": method(gppcs.Task(points, 5)),
        "result": dataclasses.replace(gppcs.simplify(points, n_points=5, method=method), seconds={}),
        "report": gppcs.evaluate(points, points),
        "summary": gppcs.info(points),
        "mesh_result": dataclasses.replace(gppcs.mesh(ball, n_points=20), seconds={}),
        "rebuilt": Rebuilt(triangle, 1.0, 2.0, seed, 4.0, 1, 0.0),
        "method": gppcs.Random(seed=seed),
    }


def test_comparing_any_public_object_gives_a_truth_value():
    for one, again, other in zip(*(public_objects(seed).values() for seed in (0, 0, 1)), strict=True):
        assert (one == again) is True
        assert (one != again) is False
        assert (one == other) is False
