import numpy as np
import pytest
from scipy.spatial.distance import cdist

import gppcs
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import areas_of_points, nearest_distances, neighbourhood_radius, paper_radius, surface_area
from gppcs.surface.surface_variation import features_in_radius


def test_paper_radius_is_cloudcompares_rule():
    points = np.array([[0, 0, 0], [2, 3, 4], [1, 1, 1]], dtype=float)
    assert paper_radius(points, 25) == pytest.approx(np.sqrt(25 * 24 ** (2 / 3) / 3), rel=1e-14)


def test_the_radius_is_the_papers_unless_its_box_misleads(bracket):
    tree = KdTree.build(bracket)
    assert neighbourhood_radius(tree) == paper_radius(bracket)
    for misled in (np.vstack([bracket, [[1e5, 1e5, 1e5]]]), bracket * [1, 1, 0] + [0, 0, 7]):
        tree = KdTree.build(misled)
        radius = neighbourhood_radius(tree)
        assert radius != paper_radius(misled)
        counts = features_in_radius(tree, radius).neighbours
        assert 15 <= np.median(counts) <= 35


def test_a_rhythm_of_the_file_does_not_mislead():
    """Every third point is of a dense patch, and so would be all that are measured in the order of the file."""
    lattice = np.indices((64, 64, 1)).reshape(3, -1).T
    interleaved = np.stack([lattice / 1024, lattice + 10.0, lattice + 100.0], axis=1).reshape(-1, 3)
    assert np.median(nearest_distances(KdTree.build(interleaved), 1)) == 1.0


@pytest.mark.parametrize("density", [1, 30])
def test_the_area_is_that_of_the_surface_whatever_the_density(density):
    """A unit square of which one half has many times as many points as the other, and a few far strays."""
    rng = np.random.default_rng(0)
    square = rng.random((40_000, 2))
    kept = (square[:, 0] < 0.5) | (rng.random(40_000) < 1 / density)
    points = np.concatenate([np.c_[square, np.zeros(len(square))][kept], 50 * rng.random((20, 3))])
    assert surface_area(KdTree.build(points)) == pytest.approx(1, rel=0.1)


def test_areas_are_an_eighth_of_the_discs_to_the_eighth_neighbour():
    points = gppcs.sample("bracket", 1500).points
    discs = np.pi / 8 * np.sort(cdist(points, points), axis=1)[:, 8] ** 2
    areas = areas_of_points(KdTree.build(points))
    np.testing.assert_allclose(areas, np.minimum(discs, np.quantile(discs, 0.99)), rtol=1e-9)
    assert areas.sum() == pytest.approx(surface_area(KdTree.build(points)), rel=1e-9)
