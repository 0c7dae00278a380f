"""The surface that a cloud spans: against closed forms, convex hulls and plain geometry."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay
from scipy.spatial.distance import cdist

from dense import distances_to_triangles
from gppcs.surface.local_surface import LocalSurface
from shapes import rotation


def triangles(surface):
    """All triangles once, as sorted triples of input indices."""
    order = surface.tree.order
    return {
        tuple(sorted(order[[i, *pair]].tolist()))
        for i, fan in enumerate(surface.corners)
        for pair in fan
        if pair[0] >= 0
    }


def test_in_a_plane_the_fans_are_the_delaunay_triangulation():
    """Along the border of a strip 16 times as dense as what lies beyond, the nearest thirty are all in the strip."""
    rng = np.random.default_rng(0)
    strip = rng.random((1600, 2)) * [0.1, 1]
    points = np.concatenate([strip, rng.random((1000, 2)) + np.array([0.101, 0])])
    points = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
    inner = {i for i in range(len(points)) if 0.03 < points[i, 0] < 0.8 and abs(points[i, 1] - 0.5) < 0.3}
    expected = {tuple(sorted(triangle)) for triangle in Delaunay(points[:, :2]).simplices.tolist()}
    found = triangles(LocalSurface.from_points(points))
    found, expected = ({triangle for triangle in each if inner.issuperset(triangle)} for each in (found, expected))
    assert any(len({i < 1600 for i in triangle}) == 2 for triangle in expected)
    assert found == expected


@pytest.mark.slow
def test_on_a_sphere_the_distance_is_that_to_the_inscribed_hull(sphere):
    points, queries = sphere[:2000], sphere[2000:12_000]
    equations = ConvexHull(points).equations
    expected = (queries @ equations[:, :3].T + equations[:, 3]).max(axis=1)
    distances, _ = LocalSurface.from_points(points).nearest_to(queries)
    assert distances.mean() == pytest.approx(expected.mean(), rel=0.02)
    assert np.median(np.abs(distances - expected)) < 1e-12


def test_the_sagitta_and_the_normals_of_a_lattice_on_a_cylinder():
    """Between lines along the axis, the farthest point is 1 - cos of half their angle above, and the normal halfway."""
    angles, heights = np.linspace(0, 2 * np.pi, 40, endpoint=False), np.arange(20) * 0.1
    angle, height = (grid.ravel() for grid in np.meshgrid(angles, heights))
    points = np.stack([np.cos(angle), np.sin(angle), height], axis=1)
    half = np.pi / 40
    between = np.stack([np.cos(angles + half), np.sin(angles + half), np.full(40, 1.0)], axis=1)
    turn = rotation(0)
    distances, normals = LocalSurface.from_points(points @ turn).nearest_to(between @ turn)
    np.testing.assert_allclose(distances, 1 - np.cos(half), rtol=1e-9)
    cosines = np.einsum("ij,ij->i", normals, between * [1, 1, 0] @ turn) / np.linalg.norm(normals, axis=1)
    assert np.abs(cosines).min() > np.cos(np.radians(1))


@pytest.mark.parametrize("spread", [0.0, 0.01, 3.0])
def test_the_foot_is_the_nearest_on_the_fans_of_the_five_nearest_points(spread):
    """Also on wide fans around a hub, on slivers, of queries at a point, and of queries far from each other."""
    rng = np.random.default_rng(0)
    turns = np.arange(0, 2 * np.pi, 2 * np.pi / 14)
    wheel = np.stack([5 + np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    sliver = rng.random((15, 3)) * [1, 1e-4, 1e-9] + [0, 3, 0]
    points = np.concatenate([rng.random((50, 3)) * [1, 1, 0.1], wheel, [[5, 0, 0.2]], sliver])
    surface = LocalSurface.from_points(points)
    queries = np.repeat(points, 2, axis=0) + rng.normal(0, spread, (2 * len(points), 3))
    feet, vertices = surface.find(queries), surface.tree.points.T
    near = np.argsort(cdist(queries, vertices), axis=1)[:, :5]
    for q, query in enumerate(queries):
        faces = [(i, *pair) for i in near[q] for pair in surface.corners[i] if pair[0] >= 0]
        expected = distances_to_triangles(query[np.newaxis], vertices[np.array(faces)])
        assert feet.distances[q] == pytest.approx(min(expected, default=np.inf), rel=1e-9, abs=1e-12)


def test_two_sheets_are_not_joined():
    points = np.random.default_rng(0).random((2000, 3)) * [1, 1, 0]
    points[1000:, 2] = 0.2  # six spacings
    between = np.concatenate([0.2 + 0.6 * np.random.default_rng(1).random((500, 2)), np.full((500, 1), 0.1)], axis=1)
    np.testing.assert_allclose(LocalSurface.from_points(points).nearest_to(between)[0], 0.1)


@pytest.mark.parametrize("n", [1, 2, 9])
def test_points_of_a_line_span_no_more_than_the_line(n):
    points = np.outer(np.arange(float(n)), [1, 2, 3])
    queries = 20 * np.random.default_rng(0).random((100, 3))
    line = distances_to_triangles(queries, points[None, [0, -1, -1]])
    distances = LocalSurface.from_points(points).nearest_to(queries)[0]
    assert (distances >= line - 1e-9).all()
    assert (distances <= cdist(queries, points).min(axis=1)).all()
