from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gppcs.engine.stages import Stages
from gppcs.gp.local.candidates import (
    FEWEST,
    FIRST,
    MANY,
    MOST_TOLD,
    nested_candidates,
    sampled_tree,
    sharpness_of,
)
from gppcs.gp.local.density import graded, segregation
from gppcs.gp.local.ranking import NOISE, Criterion, _field, rank
from gppcs.spatial.cells import greatest_in_cells
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area
from gppcs.surface.noise import Noise
from gppcs.surface.surface_variation import Features

RANDOM = np.random.default_rng(0)
EVERY = 1e6  # candidates for each point wanted: no two points in one cell


def criterion(**changes):
    usual = Criterion(density_power=1.0, normal_weight=1.4, error_weight=0.025, lengthscale=1.5, neighbours=4)
    return Criterion(**{**vars(usual), **changes})


def ranked(points, n_points, seen=None, stages=None, candidates=8.0, **changes):
    area = surface_area(KdTree.build(points))
    candidates = nested_candidates(points, n_points, area, candidates, blunt(points))
    return rank(points, candidates, criterion(**changes), seen, stages)


def blunt(points):
    """All alike."""
    return np.zeros(len(points), dtype=np.float32)


class Heard:
    """What a listener hears of steps: how many a stage has, and how many are done."""

    def __init__(self):
        self.totals, self.steps = [], []

    def started(self, stage, total):
        if total is not None:
            self.totals.append(total)

    def advanced(self, steps):
        self.steps.append(steps)

    def finished(self):
        pass


def test_targets_double_and_candidates_of_a_stage_are_among_those_of_the_next(bracket):
    stages = nested_candidates(bracket, 3_001, surface_area(KdTree.build(bracket)), 9.0, blunt(bracket))
    assert [stage.target for stage in stages] == [47, 94, 188, 376, 751, 1501, 3001]
    assert stages[0].target <= FIRST
    for coarse, fine in pairwise(stages):
        assert np.isin(coarse.indices, fine.indices).all()
    for target, candidates, thinned, _ in stages:
        assert (np.diff(candidates) > 0).all()
        assert len(candidates) >= FEWEST * target
        assert thinned == (len(candidates) < 20_000)


def test_there_are_as_many_candidates_as_asked_for_or_half_as_many_again(sphere):
    """On a plane along the grid as many as asked for, on a sphere half as many again; found 9.2 and 13.0."""
    plane = np.column_stack([RANDOM.random((40_000, 2)), np.zeros(40_000)])
    for points, expected in ((plane, 9), (sphere, 13.5)):
        area = surface_area(KdTree.build(points))
        target, candidates, thinned, same = nested_candidates(points, 50, area, 9.0, blunt(points))[0]
        assert thinned
        assert same == area
        assert len(candidates) / target == pytest.approx(expected, rel=0.1)


def test_the_sharpest_point_of_a_cell_stays():
    points = np.column_stack([RANDOM.random((40_000, 2)), np.zeros(40_000)])
    for sharpness in (RANDOM.random(40_000).astype(np.float32), blunt(points)):  # or the first of those alike
        candidates = nested_candidates(points, 50, 1.0, 9.0, sharpness)[0].indices
        np.testing.assert_array_equal(candidates, sharpest_of_cells(points, np.sqrt(1 / 450), sharpness))


def test_the_sharpest_points_of_cells_are_those_on_the_edge():
    """Two half-planes meet at a right angle; the first points of cells near the edge lie half a cell off it."""
    points = RANDOM.random((40_000, 3)) * [1.0, 1.0, 0.0]
    points[::2] = points[::2, [2, 1, 0]]
    points[:, 1] -= 0.5
    tree = KdTree.build(points)
    edge = np.sqrt(2.0 / 1_000)
    sharpness = sharpness_of(tree, 2.0, 1_000.0).astype(np.float32)
    first, sharpest = (greatest_in_cells(points, edge, values) for values in (blunt(points), sharpness))
    off = [np.maximum(points[kept, 0], points[kept, 2]) for kept in (first, sharpest)]
    by_chance, chosen = (distance[distance < edge].mean() / edge for distance in off)
    assert by_chance > 0.45
    assert chosen < 0.2  # found 0.16


def test_faces_have_no_sharp_points():
    """Rounding, which changes with where the cloud lies, would tell points on a face that is along no axis apart."""
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    points = RANDOM.random((20_000, 3)) * [1.0, 1.0, 0.0] @ turn
    np.testing.assert_array_equal(sharpness_of(KdTree.build(points), 1.0, 4_000.0), 0.0)


def test_of_far_more_points_than_cells_some_are_looked_at(sphere):
    """A ball around each of all would hold a share of them that the number of points wanted alone tells."""
    tree = KdTree.build(sphere)
    sharpness = sharpness_of(tree, 4 * np.pi, 80.0)
    told = tree.order[:: len(sphere) // int(MOST_TOLD * 80)]
    assert (sharpness[told] > 0).all()
    assert np.count_nonzero(sharpness) == len(told) < 1.1 * MOST_TOLD * 80


def test_where_there_is_little_to_choose_from_all_stay():
    points = RANDOM.random((100, 3))
    for target, candidates, thinned, _ in nested_candidates(
        points, 60, surface_area(KdTree.build(points)), 9.0, blunt(points)
    ):
        assert target == 60
        assert not thinned
        np.testing.assert_array_equal(candidates, np.arange(100))


def test_points_on_a_curve_are_spread_over_all_of_it():
    """Discs around dense points of a line cover next to nothing: by that area, all places were alike."""
    line = np.sort(RANDOM.random(50_000))
    places = np.sort(line[ranked(np.outer(line, [1.0, 0, 0]), 20).indices])
    assert np.diff(places, prepend=0, append=1).max() < 0.1


def test_most_points_in_a_dot_do_not_make_all_points_candidates(sphere):
    points = np.concatenate([sphere[:400], [5, 0, 0] + 1e-3 * sphere[:39_600]])
    assert all(
        len(stage.indices) < 40 * stage.target for stage in nested_candidates(points, 2_000, 1e3, 9.0, blunt(points))
    )


def sharpest_of_cells(points, edge, sharpness):
    order = np.argsort(-sharpness, kind="stable")
    return np.sort(order[np.unique(np.floor(points[order] * (1.0 / edge)), axis=0, return_index=True)[1]])


def plain_stages(points, n_points, area, density, sharpness):
    """Double and halve the area a step at a time, each time over all points."""
    stages = []
    target, candidates, grown = n_points, np.arange(len(points)), False
    while True:
        edge = np.sqrt(area / (target * density))
        kept = candidates[sharpest_of_cells(points[candidates], edge, sharpness[candidates])]
        if len(kept) > MANY * density * target:
            area, grown = area * 2, True
        elif len(kept) < FEWEST * target and len(candidates) > MANY * density * target and not grown:
            area /= 2
        else:
            thinned = len(kept) >= FEWEST * target
            candidates = kept if thinned else candidates
            stages.append((target, candidates, thinned, area))
            if target <= FIRST:
                return stages[::-1]
            target, grown = -(-target // 2), False


@pytest.mark.parametrize("dot", [0, 2_000, 19_000, 19_990])
@pytest.mark.parametrize("area", [1e-14, 1e-3, 12.0, 1e5, 1e12])
def test_stages_are_those_of_a_step_at_a_time_over_all_points(sphere, dot, area):
    points = sphere[:20_000] + 1
    points[:dot] = 0.5 + 1e-5 * sphere[20_000 : 20_000 + dot]
    points = RANDOM.permutation(points)
    sharpness = RANDOM.integers(0, 5, len(points)).astype(np.float32)
    stages, plain = (way(points, 600, area, 9.0, sharpness) for way in (nested_candidates, plain_stages))
    for found, expected in zip(stages, plain, strict=True):
        np.testing.assert_array_equal(found.indices, expected[1])
        assert (found.target, found.thinned, found.area) == (expected[0], *expected[2:])


def test_an_area_that_is_far_off_costs_few_passes_over_all_points(sphere, monkeypatch):
    """One at a time, doubling and halving would take 40 each."""
    points = sphere + 1
    points[:39_000] = 0.5 + 1e-7 * sphere[:39_000]
    points, passes = RANDOM.permutation(points), []
    monkeypatch.setattr(
        "gppcs.gp.local.candidates.greatest_in_cells",
        lambda some, *of_grid: passes.append(len(some)) or greatest_in_cells(some, *of_grid),
    )
    for area, n_points in ((1e-14, 30), (1e5, 600)):  # 1,000 points outside the dot are too many, or too few
        passes.clear()
        nested_candidates(points, n_points, area, 9.0, blunt(points))
        assert passes.count(40_000) < 10
        assert len(passes) > 20


def field_of(variation, **changes):
    n = len(variation)
    tree = KdTree.build(RANDOM.random((n, 3)))
    normals = RANDOM.standard_normal((n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    features = Features(variation, normals, np.full(n, 9, dtype=np.int32))
    return tree, features, _field(tree, features, np.arange(float(n)), criterion(**changes))


@settings(deadline=None, max_examples=30)
@given(st.integers(2, 200), st.floats(0, 2.0), st.integers(0, 999))
def test_the_field_is_denser_where_it_is_rougher(n, power, seed):
    variation = np.random.default_rng(seed).random(n) / 3
    tree, features, field = field_of(variation, density_power=power)
    assert np.mean(field.spacings**-2) == pytest.approx(1)  # as many points as wanted on the whole
    roughness = np.sqrt(variation[tree.order])
    clipped = np.minimum(roughness, 0.29)
    alike = clipped.max() - clipped.min() < 1e-12
    segregation = 0.0 if alike else clipped.var() / (clipped.mean() * (0.29 - clipped.mean()))
    density = np.maximum(roughness, 0.05) ** (power * (1 - segregation**2) ** 4)
    density = np.maximum(density, 0.7 * density.mean())
    expected = graded(tree, np.sqrt(density.mean() / density), 0.1)
    np.testing.assert_allclose(field.spacings / field.spacings[0], expected / expected[0], rtol=1e-9)
    assert field.normal_weight == pytest.approx(1.4 * (1 - segregation**2) ** 2)
    assert np.mean(field.y) == pytest.approx(0, abs=1e-9)
    assert np.std(field.y) == pytest.approx(1)
    assert np.corrcoef(field.y, variation[tree.order])[0, 1] == pytest.approx(1)
    np.testing.assert_array_equal(field.normals.T, features.normals[tree.order])
    np.testing.assert_allclose(field.noise, NOISE + tree.order, rtol=1e-12)


@settings(deadline=None, max_examples=50)
@given(st.lists(st.floats(0, 0.6), min_size=1, max_size=50))
def test_segregation_is_a_share(roughness):
    assert 0 <= segregation(np.array(roughness)) <= 1 + 1e-9


def test_faces_and_edges_are_segregated_and_round_things_are_not():
    for edges in (0.1, 0.5, 0.9):
        of_faces = np.where(np.arange(100) < 100 * edges, 0.29, 0.0)
        assert segregation(of_faces) == pytest.approx(1)
        assert segregation(np.where(of_faces > 0, 0.5, 0.0)) == pytest.approx(1)  # what is sharper counts no more
    assert segregation(np.full(9, 0.29)) == segregation(np.zeros(9)) == 0
    assert segregation(np.linspace(0, 0.29, 999)) == pytest.approx(1 / 3, rel=0.01)


@pytest.mark.parametrize("variation", [np.zeros(20), np.full(20, 0.2), 1e-16 * RANDOM.random(20)])
def test_a_cloud_alike_everywhere_has_one_spacing_and_no_error(variation):
    """Its surface variation differs by rounding alone."""
    _, _, field = field_of(variation)
    np.testing.assert_allclose(field.spacings, 1, rtol=1e-12)
    np.testing.assert_array_equal(field.y, 0)


@pytest.mark.parametrize("n_points", [100, 101, 250])
def test_half_as_many_are_the_first_half_where_every_point_is_a_candidate(bracket, n_points):
    points = bracket[:900] / 100
    half = -(-n_points // 2)
    whole, direct = ranked(points, n_points, candidates=EVERY), ranked(points, half, candidates=EVERY)
    np.testing.assert_array_equal(whole.indices[:half], direct.indices)
    np.testing.assert_array_equal(whole.scores[:half], direct.scores)
    np.testing.assert_array_equal(whole.deviations[:half], direct.deviations)


@pytest.mark.parametrize("n_points", [1, 64, 65, 500, 900])
def test_a_ranking_has_each_point_once_and_tells_of_its_progress(bracket, n_points):
    heard = Heard()
    stages = Stages(heard)
    ranking = ranked(bracket[:900], n_points, stages=stages)
    assert heard.totals == heard.steps
    assert list(stages.seconds) == ["noise", "features", "greedy selection"]
    assert len(np.unique(ranking.indices)) == len(ranking.indices) == n_points
    assert len(ranking.scores) == len(ranking.deviations) == n_points == sum(heard.steps)
    assert ranking.deviations[0] == 1
    assert (ranking.deviations > 0).all()
    assert (ranking.deviations <= 1).all()


def test_points_of_great_variance_are_chosen_late():
    points = np.column_stack([RANDOM.random((3_000, 2)), np.zeros(3_000)])
    left = points[:, 0] < 0.5
    chosen = ranked(points, 100, lambda places: (places, np.where(places[:, 0] < 0.5, 0.0, 1.0))).indices
    assert left[chosen].mean() > 0.7
    assert 0.3 < left[ranked(points, 100).indices].mean() < 0.7


def test_features_are_those_of_where_points_belong():
    """One half is rough; told where its points came from, the choice has fewer there. Candidates lie denser there."""
    points = np.column_stack([RANDOM.random((20_000, 2)), np.zeros(20_000)])
    rough = points + np.where(points[:, [0]] < 0.5, [0.0, 0.0, 0.005], 0.0) * RANDOM.standard_normal((20_000, 1))

    def seen(places):
        return places * [1.0, 1.0, 0.0], np.zeros(len(places))

    left = [(points[ranked(rough, 300, told).indices, 0] < 0.5).mean() for told in (None, seen)]
    assert left[1] < left[0] - 0.05


def test_twice_the_size_with_four_times_the_variances_is_the_same_choice():
    points = np.round(RANDOM.random((2_000, 3)) * 1024) / 1024
    once = ranked(points, 200, lambda places: (places, places[:, 0] * 1e-3))
    twice = ranked(points * 2, 200, lambda places: (places, places[:, 0] / 2 * 4e-3))
    np.testing.assert_array_equal(once.indices, twice.indices)
    np.testing.assert_array_equal(once.deviations, twice.deviations)


def test_area_and_noise_of_millions_are_judged_by_some(monkeypatch):
    points = np.column_stack([RANDOM.random((200_000, 2)), 0.002 * RANDOM.standard_normal(200_000)])
    monkeypatch.setattr("gppcs.gp.local.candidates.MOST_SAMPLED", 20_000)
    every, of_all = sampled_tree(points, 5_129)  # 26 for each are two thirds of them
    some, indices = sampled_tree(points, 500)
    for tree, taken in ((every, of_all), (some, indices)):
        np.testing.assert_array_equal(points[taken][tree.order].T, tree.points)
    assert len(every.order) == 200_000
    assert len(some.order) == pytest.approx(20_000, rel=0.01)
    assert len(sampled_tree(points, 5_128)[0].order) == pytest.approx(26 * 5_128, rel=0.01)
    assert surface_area(some) == pytest.approx(1.0, rel=0.1)
    levels = [Noise.measure(tree, 500, 0.045).level for tree in (every, some)]
    assert levels[1] == pytest.approx(levels[0], rel=0.1)
