"""How points are divided among the levels and nodes of a COPC file."""

import numpy as np
import pytest

from gppcs.io import copc_levels
from gppcs.io.copc_levels import Cube, by_node, level_and_cell, levels_of

N, ROOT, MOST = 30_000, 500, 1500


@pytest.fixture(autouse=True)
def small_nodes(monkeypatch):
    monkeypatch.setattr(copc_levels, "ROOT", ROOT)
    monkeypatch.setattr(copc_levels, "MOST", MOST)


def uneven(rng):
    """Points of which a third is in a cluster that is a hundredth as wide as the others."""
    return np.concatenate([rng.normal(0.3, 0.01, (N // 3, 3)), rng.random((N - N // 3, 3))]).clip(0, 1)


def with_outlier(rng):
    """Points that all lie in one cell of the first eleven levels but one."""
    return np.concatenate([rng.random((N - 1, 3)), [[3000.0, 3000.0, 3000.0]]])


@pytest.mark.parametrize("ranked", [N, N // 4, 10])
@pytest.mark.parametrize("cloud", [uneven, with_outlier])
def test_levels_follow_the_ranking_and_nodes_do_not_overflow(cloud, ranked):
    rng = np.random.default_rng(0)
    points, ranking = cloud(rng), rng.permutation(N)[:ranked]
    codes = Cube.around(points.min(axis=0), points.max(axis=0)).codes(points)
    level = levels_of(codes, ranking)
    keys, order, starts = by_node(codes, level)
    assert sorted(order) == list(range(N))
    assert np.diff(starts, append=N).max() <= MOST
    assert [level_and_cell(key)[0] for key in keys.tolist()] == level[order[starts]].tolist()
    assert (np.diff(level[ranking[: min(ranked, 4 * ROOT)]].astype(int)) >= 0).all()
    assert (level[ranking[:ROOT]] == 0).all()
    if ranked > ROOT:
        assert (level == 0).sum() == ROOT


def test_points_that_are_not_ranked_are_spread_evenly():
    """On a level, each node that is not the last in its place takes the same share of them."""
    rng = np.random.default_rng(0)
    points = rng.random((N, 2)) * [1, 3]
    codes = Cube.around(np.zeros(3), np.array([1.0, 3.0, 0.0])).codes(np.column_stack([points, np.zeros(N)]))
    level = levels_of(codes, rng.permutation(N)[:ROOT])
    on_second, _ = np.histogram(points[level == 1, 1], bins=4, range=(0, 3))
    assert (level == 1).sum() == pytest.approx(3 * ROOT, rel=0.1)
    np.testing.assert_allclose(on_second, on_second.mean(), atol=4 * np.sqrt(on_second.mean()))


def test_points_at_one_place_fill_level_after_level():
    codes = np.zeros(10 * MOST, np.int64)
    counts = np.bincount(levels_of(codes, np.arange(ROOT)))
    assert counts.max() <= MOST


def test_codes_name_cells_within_cells():
    points = np.random.default_rng(0).uniform(-50, 20, (100, 3))
    codes = Cube.around(np.full(3, -50.0), np.full(3, 30.0)).codes(points)
    _, order, starts = keys = by_node(codes, np.full(100, 5, np.uint8))
    for key, row in zip(keys[0].tolist(), order[starts], strict=True):
        assert level_and_cell(key) == (5, tuple(np.floor((points[row] + 50) / 2.5).astype(int)))
        assert level_and_cell(key >> 3) == (4, tuple(np.floor((points[row] + 50) / 5).astype(int)))


def test_the_last_cells_reach_the_highest_corner():
    """As copclib adds up their borders, from the corners that the file states."""
    rng = np.random.default_rng(0)
    for _ in range(2000):
        low = np.rint(rng.uniform(-1, 1, 3) * 10.0 ** rng.integers(2, 9, 3)) * 0.01
        high = low + np.rint(rng.uniform(0.999, 1, 3) * 10.0 ** rng.integers(2, 9)) * 0.01
        cube = Cube.around(low, high)
        last_place = np.spacing(np.abs([low, high]).max())
        assert (high <= cube.high).all()
        assert (cube.high <= high + 4 * last_place).all()
        for level in range(copc_levels.DEEPEST + 1):
            step = (cube.high - cube.low).max() / 2**level
            assert (low + step * (2**level - 1) + step >= high).all()
