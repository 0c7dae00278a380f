"""Each point stands for an area of the surface, however dense the cloud is there."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

import gppcs
from gppcs.spatial.areas import areas_of_points
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area
from shapes import square


@pytest.mark.parametrize("left", [1, 2, 20])
def test_areas_are_positive_and_sum_to_that_of_a_plane(left):
    points = square(3000, left)
    areas = areas_of_points(KdTree.build(points))
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(1, rel=0.08)  # discs reach over the border
    assert areas[points[:, 0] < 0.5].sum() == pytest.approx(0.5, rel=0.08)


def test_areas_are_an_eighth_of_the_discs_to_the_eighth_neighbour():
    points = gppcs.sample("bracket", 1500).points
    discs = np.pi / 8 * np.sort(cdist(points, points), axis=1)[:, 8] ** 2
    areas = areas_of_points(KdTree.build(points))
    np.testing.assert_allclose(areas, np.minimum(discs, np.quantile(discs, 0.99)), rtol=1e-9)
    assert areas.sum() == pytest.approx(surface_area(KdTree.build(points)), rel=1e-9)


def test_a_few_outliers_stand_for_little():
    points = np.concatenate([square(3000), 20 * np.random.default_rng(1).random((15, 3))])
    areas = areas_of_points(KdTree.build(points))
    assert areas[-15:].sum() < 0.05 * areas.sum()
