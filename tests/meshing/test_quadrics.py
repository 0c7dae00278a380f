"""Quadrics equal the sums that they stand for."""

import numpy as np
import pytest

from gppcs.meshing.assignment import nearest_vertices
from gppcs.meshing.collapse import dense_quadrics
from gppcs.surface.error_quadrics import NUMBERS, add_moved, add_plane, value


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def units(rng, n):
    normals = rng.standard_normal((n, 3))
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def test_a_quadric_is_the_sum_of_squared_distances_to_planes(rng):
    points, normals, vertices = rng.random((50, 3)), units(rng, 50), rng.random((4, 3))
    nearest = rng.integers(-1, 4, 50)
    quadrics = dense_quadrics(points, normals, vertices, nearest)
    for v, place in enumerate(rng.random((4, 3))):
        mine = nearest == v
        expected = (np.einsum("ij,ij->i", place - points[mine], normals[mine]) ** 2).sum()
        assert value(quadrics[v], tuple(place - vertices[v])) == pytest.approx(expected)


def test_a_quadric_that_moves_to_another_vertex_keeps_its_values(rng):
    first, second = np.zeros(NUMBERS), np.zeros(NUMBERS)
    planes = list(zip(units(rng, 5), rng.standard_normal(5), rng.random(5), strict=True))
    for normal, height, weight in planes:
        add_plane(first, tuple(normal), height, weight)
    step = rng.standard_normal(3)
    add_plane(second, (0.0, 0.0, 1.0), 0.25, 2.0)
    add_moved(first, tuple(step), second)
    place = rng.standard_normal(3)  # relative to the second vertex
    expected = sum(w * (h + n @ (place + step)) ** 2 for n, h, w in planes) + 2 * (0.25 + place[2]) ** 2
    assert value(second, tuple(place)) == pytest.approx(expected)


def test_the_nearest_vertex_is_one_with_a_fitting_normal(rng):
    points, normals, vertices, of_vertices = rng.random((300, 3)), units(rng, 300), rng.random((60, 3)), units(rng, 60)
    members = np.arange(0, 60, 2)
    found = nearest_vertices(points, normals, vertices, of_vertices, members)
    for point, normal, v in zip(points, normals, found, strict=True):
        near = members[np.argsort(((vertices[members] - point) ** 2).sum(axis=1))[:4]]
        fitting = [w for w in near if normal @ of_vertices[w] > 0]
        assert v == (fitting[0] if fitting else -1)
