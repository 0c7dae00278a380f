import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

import gppcs
from gppcs.kdtree import KdTree
from gppcs.neighbourhood import surface_area
from gppcs.sample_elimination import GREATEST_RATIO, REMOVED, WHOLE, eliminate


def plain_stage(points, n_points, area):
    """Rows removed by one stage, with a table of all pairs."""
    reach = 2.0 * np.sqrt(area / (2.0 * np.sqrt(3.0) * n_points))
    dx, dy, dz = (points[:, None] - points).transpose(2, 0, 1)
    terms = np.maximum(1.0 - np.sqrt(dx * dx + dy * dy + dz * dz) / reach, 0.0)
    for _ in range(3):
        terms *= terms
    terms = np.floor(WHOLE * terms)
    np.fill_diagonal(terms, 0.0)
    weights = terms.sum(axis=1)
    removed = []
    while len(removed) < len(points) - n_points and weights.max() > 0:
        removed.append(int(np.argmax(weights)))
        weights -= terms[removed[-1]]
        weights[removed[-1]] = REMOVED
    return removed


def plain_elimination(points, n_points):
    area = surface_area(KdTree.build(points))
    kept, order = np.arange(len(points)), []
    while len(kept) > 1:
        target = max(n_points, len(kept) // GREATEST_RATIO) if len(kept) > n_points else len(kept) // 2
        removed = plain_stage(points[kept], target, area)
        order.extend(kept[removed])
        kept = np.delete(kept, removed)
        if len(kept) > target:
            area = max(4.0 * area, surface_area(KdTree.build(points[kept])))
    return np.array([*order, *kept])[::-1][:n_points]


def spacings(points):
    return cKDTree(points).query(points, 2)[0][:, 1]


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 250), st.sampled_from(["solid", "lattice", "clump"]), st.integers(0, 99), st.data())
def test_equals_the_plain_algorithm(n, shape, seed, data):
    rng = np.random.default_rng(seed)
    points = {
        "solid": rng.random((n, 3)),
        "lattice": rng.permutation(np.indices((7, 7, 7)).reshape(3, -1).T / 8)[:n],
        "clump": np.where(np.arange(n)[:, None] % 3 == 0, 1.0, 1e-9) * rng.random((n, 3)),
    }[shape]
    n_points = data.draw(st.integers(1, n))
    np.testing.assert_array_equal(eliminate(points, n_points), plain_elimination(points, n_points))


def test_stages_equal_the_plain_algorithm():
    points = np.random.default_rng(1).random((1_500, 3)) * [1.0, 1.0, 0.01]
    np.testing.assert_array_equal(eliminate(points, 7), plain_elimination(points, 7))


@pytest.mark.parametrize("n_points", [200, 4_000])
def test_is_blue_noise_and_so_is_its_beginning(sphere, n_points):
    chosen = sphere[eliminate(sphere, n_points)]
    for some in (chosen, chosen[: n_points // 2]):
        densest = 2.0 * np.sqrt(4.0 * np.pi / (2.0 * np.sqrt(3.0) * len(some)))
        assert spacings(some).min() > 0.6 * densest  # Yuksel reports 0.7 and above for whole sets
        assert spacings(some).min() > 20 * spacings(sphere[: len(some)]).min()


def test_a_clump_of_most_points_does_not_spoil_the_rest(sphere):
    clump = 1e-6 * np.random.default_rng(0).random((3_000, 3))
    points = np.concatenate([sphere[np.argsort(sphere[:2_000, 0])], clump])
    chosen = points[eliminate(points, 200)]
    assert (np.linalg.norm(chosen, axis=1) < 0.5).sum() == 1
    assert spacings(chosen).min() > 0.6 * 2.0 * np.sqrt(4.0 * np.pi / (2.0 * np.sqrt(3.0) * 200))


def test_progress_adds_up(bracket):
    steps = []
    eliminate(bracket, 1_000, steps.append)
    assert len(steps) > 1
    assert sum(steps) == 19_000


def test_spreads_the_dragon_well(shared_data):
    dragon = gppcs.read(shared_data / "dragon.ply")
    even = gppcs.simplify(dragon, ratio=0.03, method="sample-elimination").cloud.points
    random = gppcs.simplify(dragon, ratio=0.03, method="random").cloud.points
    assert spacings(even).min() > 10 * spacings(random).min()
