"""Figures of single triangles."""

import numpy as np
import pytest

from gppcs.spatial.triangles import area_vector, circumradius, quality


def test_quality_is_one_for_equal_edges_and_falls_to_zero():
    height = np.sqrt(3) / 2
    assert quality((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.5, height, 0.0)) == pytest.approx(1)
    assert quality((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)) == 0
    right = quality((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (0.0, 4.0, 0.0))
    assert right == pytest.approx(4 * np.sqrt(3) * 6 / (9 + 16 + 25))  # 4 sqrt(3) area over the squared edges


def test_the_area_vector_is_upright_and_twice_as_long_as_the_area():
    assert area_vector((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 3.0, 0.0)) == (0.0, 0.0, 6.0)


def test_the_circle_through_the_corners():
    assert circumradius((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (0.0, 4.0, 0.0)) == pytest.approx(2.5)
    assert circumradius((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)) == np.inf
