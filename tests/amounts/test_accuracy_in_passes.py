"""Errors of a cloud in chunks, of which few distances are held."""

import numpy as np
import pytest

import gppcs
from gppcs.amounts import accuracy_in_passes
from gppcs.amounts.accuracy import Original
from gppcs.engine.journal import Journal
from gppcs.engine.stages import Stages
from gppcs.methods import Selection
from gppcs.spatial.chunks import ChunkedPoints

POINTS = gppcs.sample("bracket", 2_000, seed=5).points / 100.0
FLAT = np.random.default_rng(6).random((2_000, 3)) * [1.0, 1.0, 0.0]


@pytest.fixture
def judge_of(tmp_path):
    def judge_of(points):
        chunked = ChunkedPoints(len(points), lambda: np.array_split(points, 7))
        some = Original.of(points[np.random.default_rng(0).permutation(len(points))[:50]])
        return accuracy_in_passes._ChunkJudge(chunked, some, Stages(), Journal(tmp_path))

    return judge_of


@pytest.mark.parametrize("n", [1, 2, 3, 20, 21, 1_000, 1_007])
def test_the_percentile_of_the_largest_distances_is_that_of_all(n):
    distances = np.sort(np.random.default_rng(n).random(n))
    for held in {n - accuracy_in_passes._rank(n), n}:
        found = accuracy_in_passes._percentile(np.random.default_rng(0).permutation(distances[n - held :]), n)
        assert found == np.quantile(distances, 0.95)


@pytest.mark.parametrize("near", [(0.94, 0.8, 0.0), (0.999, 0.8, 0.0), (0.999, 0.0)])
@pytest.mark.parametrize("points", [POINTS, FLAT], ids=["part", "plane"])
def test_errors_are_those_of_all_points_in_memory(judge_of, monkeypatch, points, near):
    """Also where a small sample tells too large a distance first."""
    monkeypatch.setattr(accuracy_in_passes, "NEAR", near)
    for kept in (points[:40], points[::4]):
        expected = Original.of(points).errors(kept)
        found = judge_of(points).judged(kept)
        assert found["mean"] == pytest.approx(expected["mean"], rel=1e-12)
        assert found["rms"] == pytest.approx(expected["rms"], rel=1e-12)
        assert (found["p95"], found["max"]) == (expected["p95"], expected["max"])


def test_few_distances_are_held_where_most_are_alike():
    surface, points = accuracy_in_passes.surface_of(FLAT[:100]), np.tile(FLAT[:100], (20, 1))
    found = accuracy_in_passes._measured(surface, 0.0, 0, points)
    assert found.ties + len(found.farther) == len(points)
    assert found.ties > 1_900


def test_points_that_a_method_has_moved_are_judged_where_they_are(judge_of):
    moved = Selection(np.arange(5), points=POINTS[:5] + 1.0)
    assert judge_of(POINTS).places(moved) is moved.points
