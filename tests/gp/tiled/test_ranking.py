"""The choice in tiles: exactly M points, as good as in memory, and no seam between tiles."""

from pathlib import Path

import numpy as np
import pytest

import gppcs
from gppcs.engine.stages import Stages
from gppcs.engine.threads import set_threads
from gppcs.gp.tiled import choice, ranking
from gppcs.spatial import stored
from gppcs.spatial.boxes import classes
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.scaling import normalised

N, M = 20_000, 2_000


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch):
    monkeypatch.setattr(ranking, "TILE", 3_000)
    monkeypatch.setattr(stored, "BOX", 250)


def bracket(n=N):
    return normalised(gppcs.sample("bracket", n, seed=1).points)[0]


def in_tiles(points, n_points, folder, parts=5, method=None):
    folder = Path(folder) / f"{n_points}-{parts}-{len(list(Path(folder).iterdir()))}"
    folder.mkdir()
    chunked = ChunkedPoints(len(points), lambda: np.array_split(points, parts))
    return (method or gppcs.LocalGP()).in_tiles(chunked, n_points, folder, Stages())


@pytest.mark.slow
def test_exactly_m_points_whatever_the_chunks_and_threads(tmp_path, monkeypatch):
    points, tiles = bracket(), []
    plain = ranking.choose_in_tiles
    monkeypatch.setattr(ranking, "choose_in_tiles", lambda *of: tiles.append(len(of[1])) or plain(*of))
    found = in_tiles(points, M, tmp_path)
    assert len(np.unique(found.indices)) == len(found.indices) == M
    assert tiles[0] == 1
    assert tiles[-1] > 5
    assert (np.diff(found.attributes["score"][M // 2 :]) <= 0).all()
    for parts, threads in ((1, 2), (40, 1)):
        set_threads(threads)
        again = in_tiles(points, M, tmp_path, parts)
        np.testing.assert_array_equal(again.indices, found.indices)
        np.testing.assert_array_equal(again.attributes["deviation"], found.attributes["deviation"])
        assert again.diagnostics == found.diagnostics
    set_threads(None)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_as_good_as_in_memory(tmp_path, noise):
    """The bounds are what three standard errors of one choice allow; benchmarks/tiles.py has narrower ones."""
    points = bracket() + 0.01 * noise * np.random.default_rng(0).standard_normal((N, 3))
    points = normalised(points)[0]
    kept = points[in_tiles(points, M, tmp_path).indices]
    expected = gppcs.simplify(points, n_points=M)
    one, other = gppcs.evaluate(points, kept), gppcs.evaluate(points, expected.cloud)
    assert one.surface_mean == pytest.approx(other.surface_mean, rel=0.05)
    assert one.mean_distance == pytest.approx(other.mean_distance, rel=0.01)
    assert one.covering_radius < 1.2 * other.covering_radius


def test_noise_is_measured_as_in_memory(tmp_path):
    points = normalised(bracket() + 0.008 * np.random.default_rng(0).standard_normal((N, 3)))[0]
    expected = gppcs.simplify(points, n_points=M).diagnostics["noise_in_spacings"]
    assert expected > 0.2
    assert in_tiles(points, M, tmp_path).diagnostics["noise_in_spacings"] == pytest.approx(expected, rel=0.05)


class Watched:
    """The last stage, chosen once more, in one tile and in many."""

    def __init__(self, monkeypatch):
        self.shares = {}
        self._plain = ranking.choose_in_tiles
        monkeypatch.setattr(ranking, "choose_in_tiles", self)

    def __call__(self, field, tiles, before, last_score, each, advanced):
        if field.stage.target == M:
            table, halo = field.stage.table, choice.HALO
            [whole] = table.boxes.tiles(table.counts, 10**9)
            expected = self._plain(field, [whole], before, last_score, each, advanced)
            for choice.HALO in (0.0, halo):
                found = self._plain(field, tiles, before, last_score, each, advanced)
                self.shares[choice.HALO] = np.isin(found.rows, expected.rows).mean()
            return found
        return self._plain(field, tiles, before, last_score, each, advanced)


def test_tiles_choose_what_the_whole_chooses(tmp_path, monkeypatch):
    """Greedy choices are chaotic: what differs is where scores rise, and a few points that follow from it."""
    watched = Watched(monkeypatch)
    in_tiles(bracket(), M, tmp_path)
    assert watched.shares[choice.HALO] > 0.96
    assert watched.shares[0.0] < 0.9


@pytest.mark.slow
def test_the_order_within_a_class_makes_no_difference(tmp_path, monkeypatch):
    points = bracket()
    expected = in_tiles(points, M, tmp_path)
    monkeypatch.setattr(choice, "classes", lambda *of: [some[::-1] for some in classes(*of)])
    np.testing.assert_array_equal(in_tiles(points, M, tmp_path).indices, expected.indices)


def test_a_level_that_is_too_high_is_lowered(tmp_path, monkeypatch):
    monkeypatch.setattr(choice, "LOWER", 2.0)
    found = in_tiles(bracket(), M, tmp_path)
    assert len(np.unique(found.indices)) == M


def odd_clouds():
    rng = np.random.default_rng(0)
    plain = bracket(3_000)
    dot = plain.copy()
    dot[:1_500] = 1e-5 * rng.random((1_500, 3))
    line = np.zeros((3_000, 3))
    line[:, 0] = rng.random(3_000)
    return {
        "twice": np.concatenate([plain[:1_500], plain[:1_500]]),
        "few places": plain[:120][rng.integers(0, 120, 3_000)],
        "one place": np.zeros((3_000, 3)),
        "half in a dot": dot,
        "a line": line,
        "a volume": rng.random((3_000, 3)),
    }


ODD = odd_clouds()


@pytest.mark.slow
@pytest.mark.parametrize("n_points", [1, 100, 1_750])
@pytest.mark.parametrize("variant", ODD)
def test_odd_clouds(tmp_path, monkeypatch, variant, n_points):
    monkeypatch.setattr(ranking, "TILE", 1_500)
    points = ODD[variant]
    found = in_tiles(points, n_points, tmp_path)
    assert len(np.unique(found.indices)) == len(found.indices) == n_points
    places = len(np.unique(points, axis=0))
    assert len(np.unique(points[found.indices], axis=0)) == min(n_points, places)
    if places < n_points:  # then the first of each place, and the first of the others
        expected = gppcs.simplify(points, n_points=n_points).indices
        assert set(found.indices) == set(expected)


@pytest.mark.slow
def test_other_settings(tmp_path):
    for method in (gppcs.LocalGP(feature_weight=1.0), gppcs.LocalGP(feature_weight=0.0, neighbours=8, candidates=3.0)):
        found = in_tiles(bracket(), M, tmp_path, method=method)
        assert len(np.unique(found.indices)) == M
