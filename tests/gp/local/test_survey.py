import numpy as np
import pytest

from gppcs.engine.timer import Timer
from gppcs.gp.local.candidates import RANDOM_BITS, nested_candidates, sample, sharpness_of, survey
from gppcs.spatial.cells import greatest_in_cells
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.samples import short_hashes
from gppcs.spatial.spacing import surface_area
from gppcs.surface.noise import Noise
from gppcs.surface.surface_variation import features_in_radius
from shapes import rotation, square


def test_a_survey_measures_sharpness_or_noise(sphere):
    """Noisy points would pass for sharp ones."""
    area, noise, ranks, *_ = survey(sphere, 1_000, 8.0, Timer())
    assert area == pytest.approx(4 * np.pi, rel=0.1)
    assert noise.is_negligible
    assert (ranks >> RANDOM_BITS > 0).all()
    noisy = sphere + 0.01 * np.random.default_rng(9).standard_normal(sphere.shape)
    _, noise, ranks, *_ = survey(noisy, 1_000, 8.0, Timer())
    assert not noise.is_negligible
    assert noise.sigma == pytest.approx(0.01, rel=0.3)
    assert (ranks >> RANDOM_BITS == 0).all()


def test_noise_and_stages_share_one_area(sphere):
    """The number of occupied cells corrects it where most of the points lie in a dot."""
    points = np.concatenate([sphere[:300], 1e-4 * sphere[300:30_000]])
    area, noise, ranks, *_ = survey(points, 500, 8.0, Timer())
    assert area != pytest.approx(surface_area(KdTree.build(points)), rel=0.5)
    assert noise.spacing == np.sqrt(area / 500)
    assert nested_candidates(points, ranks, 500, area, 8.0)[-1].area == area


def test_the_sharpest_points_of_cells_are_those_on_the_edge():
    """Two half-planes meet at a right angle. First points of cells near the edge lie half a cell off it on average."""
    by_chance, chosen, edge = [], [], np.sqrt(2.0 / 1_000)
    for seed in range(8):
        points = np.random.default_rng(seed).random((40_000, 3)) * [1.0, 1.0, 0.0]
        points[::2] = points[::2, [2, 1, 0]]
        points[:, 1] -= 0.5
        variation = sharpness_of(features_in_radius(KdTree.build(points), edge).surface_variation)
        sharpness = variation.astype(np.float32).view(np.uint32)
        for off, values in ((by_chance, np.zeros_like(sharpness)), (chosen, sharpness)):
            kept = greatest_in_cells(points, edge, values)
            distance = np.maximum(points[kept, 0], points[kept, 2])
            off.append(distance[distance < edge].mean() / edge)
    assert np.mean(by_chance) > 0.45
    assert max(chosen) < 0.2  # found 0.12 to 0.18


def test_faces_have_no_sharp_points():
    """Rounding, which changes with where the cloud lies, would tell points on a face that is along no axis apart."""
    points = square(20_000) @ rotation(0)
    variation = features_in_radius(KdTree.build(points), 0.016).surface_variation
    np.testing.assert_array_equal(sharpness_of(variation), 0.0)


def test_area_and_noise_of_millions_are_judged_by_some():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.random((200_000, 2)), 0.0005 * rng.standard_normal(200_000)])

    def sampled(n_points):
        rows = sample(short_hashes(points, RANDOM_BITS), n_points)
        assert (np.diff(rows) > 0).all()
        return KdTree.build(points[rows])

    every, some = sampled(5_129), sampled(500)  # 26 for each of 5,129 are two thirds of them
    assert len(every.order) == 200_000
    assert len(some.order) == pytest.approx(100_000, rel=0.01)
    assert len(sampled(5_000).order) == pytest.approx(26 * 5_000, rel=0.01)
    assert surface_area(some) == pytest.approx(1.0, rel=0.1)
    levels = [Noise.measure(tree, 500, 0.045).sigma for tree in (every, some)]
    assert levels[1] == pytest.approx(levels[0], rel=0.1)
