"""Figures of single triangles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dense import distances_to_triangles
from gppcs.spatial.triangles import approach, circumradius, nearest_in_triangle, nearest_triangles, quality


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
    points, squared = np.array([[0.0, 5.0], [0.0, 5.0], [0.0, 5.0]]), np.array([np.inf, 1e-4])
    approach(points, squared, *triangle)
    assert np.sqrt(squared) == pytest.approx([expected, 0.01], abs=1e-8)


@pytest.mark.parametrize("n_faces", [1, 5, 300])
def test_the_nearest_triangle_is_that_of_brute_force_also_without_area(n_faces):
    """Corners repeat in some triangles, and some lie on a line."""
    rng = np.random.default_rng(n_faces)
    vertices = np.concatenate([rng.random((40, 3)), np.linspace(0, 1, 9)[:, None] * np.ones(3)])
    faces, places = rng.integers(0, len(vertices), (n_faces, 3)), 2.0 * rng.random((700, 3)) - 0.5
    faces[n_faces // 2] = [40, 44, 48]
    nearest, squared, weights = nearest_triangles(vertices, faces, places)
    expected = distances_to_triangles(places, vertices[faces])
    np.testing.assert_allclose(np.sqrt(squared), expected, atol=1e-14)
    a, b, c = vertices[faces[nearest]].transpose(1, 0, 2)
    feet = a + weights[:, :1] * (b - a) + weights[:, 1:] * (c - a)
    np.testing.assert_allclose(np.linalg.norm(places - feet, axis=1), expected, atol=1e-14)
