import numpy as np
import pytest

from dense import distances_to_triangles
from gppcs.spatial.nearest_triangles import nearest_triangles


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


def test_places_on_the_mesh_are_at_no_distance():
    vertices = np.random.default_rng(0).random((30, 3))
    faces = np.arange(30).reshape(-1, 3)
    assert np.array_equal(nearest_triangles(vertices, faces, vertices)[1], np.zeros(30))
