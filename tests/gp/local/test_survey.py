import numpy as np
import pytest

from gppcs.engine.timer import Timer
from gppcs.gp.local.candidates import RANDOM_BITS, sharpness_of, survey
from gppcs.spatial.cells import greatest_in_cells
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.surface_variation import features_in_radius
from shapes import noisy, rotation, square


def test_a_survey_measures_sharpness_or_noise(sphere):
    """Noisy points would pass for sharp ones."""
    area, noise, ranks, *_ = survey(sphere, 1_000, 8.0, Timer())
    assert area == pytest.approx(4 * np.pi, rel=0.1)
    assert noise.is_negligible
    assert (ranks >> RANDOM_BITS > 0).all()
    _, noise, ranks, *_ = survey(noisy(sphere, 0.01, seed=9), 1_000, 8.0, Timer())
    assert not noise.is_negligible
    assert noise.sigma == pytest.approx(0.01, rel=0.3)
    assert (ranks >> RANDOM_BITS == 0).all()


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
