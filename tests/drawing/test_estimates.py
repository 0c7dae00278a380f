"""What pictures and pages show of the surface of any cloud."""

import numpy as np
import pytest

import gppcs
from gppcs.drawing.estimates import Estimates

POINTS = gppcs.sample("sphere", 2000).points


def test_they_are_the_features_of_the_cloud():
    found, expected = Estimates.of(POINTS), gppcs.estimate_features(POINTS)
    assert found.variation == pytest.approx(expected.surface_variation)
    assert np.abs(np.einsum("ij,ij->i", found.normals, expected.normals)) == pytest.approx(np.ones(len(POINTS)))


@pytest.mark.parametrize("exponent", [-600, 600])
def test_the_unit_of_length_makes_no_difference(exponent):
    found, expected = Estimates.of(np.ldexp(POINTS, exponent)), Estimates.of(POINTS)
    assert np.array_equal(found.variation, expected.variation, equal_nan=True)
    assert np.array_equal(found.normals, expected.normals)


def test_repeats_count_once():
    found, expected = Estimates.of(np.repeat(POINTS, 3, axis=0)), Estimates.of(POINTS)
    assert np.array_equal(found.variation[::3], expected.variation, equal_nan=True)


def test_the_variation_is_unknown_where_fewer_than_four_points_are_near():
    assert np.isnan(Estimates.of(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])).variation).all()


def test_a_plane_has_no_relief_of_rounding_errors():
    plane = np.random.default_rng(0).random((30, 3)) * [1, 1, 0]
    assert (Estimates.of(plane).variation == 0).all()
    tilted = plane @ np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    assert (Estimates.of(tilted).variation == 0).all()
