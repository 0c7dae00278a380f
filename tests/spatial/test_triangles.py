"""Figures of single triangles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dense import distances_to_triangles
from gppcs.spatial.triangles import circumradius, nearest_in_triangle, quality


def test_quality_is_one_for_equal_edges_and_falls_to_zero():
    height = np.sqrt(3) / 2
    assert quality((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.5, height, 0.0)) == pytest.approx(1)
    assert quality((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)) == 0
    right = quality((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (0.0, 4.0, 0.0))
    assert right == pytest.approx(4 * np.sqrt(3) * 6 / (9 + 16 + 25))  # 4 sqrt(3) area over the squared edges


def test_the_circle_through_the_corners():
    assert circumradius((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (0.0, 4.0, 0.0)) == pytest.approx(2.5)
    assert circumradius((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)) == np.inf


coordinate = st.floats(-1, 1).map(lambda value: round(value, 3))
corner = st.tuples(coordinate, coordinate, coordinate)


@given(st.lists(corner, min_size=3, max_size=3, unique=True))
def test_the_distance_to_a_triangle_is_the_least(triangle):
    corners = np.array(triangle)
    expected = distances_to_triangles(np.zeros((1, 3)), corners[None])[0]
    v, w = nearest_in_triangle(*triangle)
    assert min(v, w, 1 - v - w) >= -1e-9
    assert np.linalg.norm(np.array([1 - v - w, v, w]) @ corners) == pytest.approx(expected, abs=1e-9)
