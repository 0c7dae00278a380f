"""Each point stands for an area of the surface, however dense the cloud is there."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

import gppcs
from gppcs.spatial.areas import areas_of_points
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area


def test_areas_are_an_eighth_of_the_discs_to_the_eighth_neighbour():
    points = gppcs.sample("bracket", 1500).points
    discs = np.pi / 8 * np.sort(cdist(points, points), axis=1)[:, 8] ** 2
    areas = areas_of_points(KdTree.build(points))
    np.testing.assert_allclose(areas, np.minimum(discs, np.quantile(discs, 0.99)), rtol=1e-9)
    assert areas.sum() == pytest.approx(surface_area(KdTree.build(points)), rel=1e-9)
