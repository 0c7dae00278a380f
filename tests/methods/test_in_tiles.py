"""Methods other than `gp` on clouds on disk."""

from pathlib import Path

import numpy as np
import pytest

import gppcs
from gppcs.engine.stages import Stages
from gppcs.methods.voxel import tiles as voxel_tiles
from gppcs.spatial import farthest_in_tiles, stored
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.scaling import normalised

N = 3_000
SCAN = normalised(gppcs.sample("bracket", N, seed=1).points)[0]
TWICE = np.concatenate([SCAN[: N // 2], SCAN[: N // 2]])
FEW = SCAN[:50][np.random.default_rng(0).integers(0, 50, 1_800)]
METHODS = [gppcs.Random(seed=3), gppcs.FarthestPoint(), gppcs.Voxel(), gppcs.Voxel(place="mean")]


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch):
    monkeypatch.setattr(voxel_tiles, "TILE", 600)
    monkeypatch.setattr(farthest_in_tiles, "TILE", 600)
    monkeypatch.setattr(farthest_in_tiles, "FIRST", 100)
    monkeypatch.setattr(stored, "BOX", 200)


def in_tiles(method, points, n_points, folder, parts=4):
    folder = Path(folder) / str(len(list(Path(folder).iterdir())))
    folder.mkdir()
    chunked = ChunkedPoints(len(points), lambda: np.array_split(points, parts))
    return method.in_tiles(chunked, n_points, folder, Stages())


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("points", [SCAN, TWICE, FEW, FEW[:1].repeat(400, axis=0)], ids=["scan", "twice", "few", "one"])
def test_exactly_m_points_whatever_the_chunks(tmp_path, method, points):
    places = len(np.unique(points, axis=0))
    for n_points in (1, 51, 700):
        if n_points >= len(points):
            continue
        found = in_tiles(method, points, n_points, tmp_path)
        assert len(np.unique(found.indices)) == len(found.indices) == n_points
        assert len(np.unique(points[found.indices], axis=0)) == min(n_points, places)
        again = in_tiles(method, points, n_points, tmp_path, parts=13)
        np.testing.assert_array_equal(again.indices, found.indices)


@pytest.mark.parametrize("place", ["representative", "mean"])
@pytest.mark.parametrize("points", [SCAN, TWICE], ids=["scan", "twice"])
def test_voxel_is_the_same_as_in_memory(tmp_path, place, points):
    method = gppcs.Voxel(place=place)
    for n_points in (60, 700):
        expected = gppcs.simplify(points, n_points=n_points, method=method)
        found = in_tiles(method, points, n_points, tmp_path)
        np.testing.assert_array_equal(found.indices, expected.indices)
        if place == "mean":
            np.testing.assert_allclose(found.points, expected.cloud.points, atol=1e-15)


@pytest.mark.slow
def test_farthest_points_are_as_far_as_in_memory(tmp_path):
    points = normalised(gppcs.sample("bracket", 20_000, seed=1).points)[0]
    for n_points in (500, 3_000):
        kept = [
            points[rows]
            for rows in (
                in_tiles(gppcs.FarthestPoint(), points, n_points, tmp_path).indices,
                gppcs.simplify(points, n_points=n_points, method="fps").indices,
            )
        ]
        covering, apart = [], []
        for places in kept:
            tree = gppcs.KdTree.build(places)
            covering.append(np.sqrt(tree.nearest_of(points, 1)[1].max()))
            apart.append(np.sqrt(tree.nearest_of(places, 2)[1][:, 1].min()))
        assert covering[0] < 1.04 * covering[1]
        assert apart[0] > 0.96 * apart[1]


def test_random_places_are_equally_likely(tmp_path):
    """Of 100 places, the first is there a hundred times; all are kept in about a quarter of the runs."""
    points = np.concatenate([SCAN[:100], SCAN[:1].repeat(99, axis=0)])
    kept = np.zeros(100)
    for seed in range(400):
        rows = in_tiles(gppcs.Random(seed=seed), points, 25, tmp_path).indices
        assert rows.max() < 100
        kept[rows] += 1
    assert abs(kept - 100).max() < 4.5 * np.sqrt(400 * 0.25 * 0.75)
    one, other = (in_tiles(gppcs.Random(seed=0), SCAN, size, tmp_path).indices for size in (50, 100))
    np.testing.assert_array_equal(one, other[:50])
