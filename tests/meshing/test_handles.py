"""Small false handles are cut, true ones stay."""

import numpy as np
import pytest

import gppcs
from gppcs.clouds.topology import topology_of
from gppcs.meshing.coverage import RANK, Cover
from gppcs.meshing.halfedges import HalfEdges
from gppcs.meshing.handles import without_small_handles
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from shapes import drilled_plate, torus


def grid(n, first=0):
    """The triangles of a square of n x n vertices, numbered from `first`."""
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()[:, None]
    return first + np.concatenate([corner + np.array([0, 1, n + 1]), corner + np.array([0, n + 1, n])])


def bridged(places, n=20):
    """Two square sheets, one above the other, which triangular tubes join at some triangles; vertices and normals."""
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    low = np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])
    above, below = grid(n, n * n), grid(n)[:, ::-1]
    walls = []
    for place in places:
        for a, b in zip(above[place], np.roll(above[place], -1), strict=True):
            walls += [[a, b, b - n * n], [a, b - n * n, a - n * n]]
    whole = np.delete(above, places, axis=0), np.delete(below, places, axis=0)
    up = np.repeat([[0.0, 0, -1], [0, 0, 1]], n * n, axis=0)
    return np.concatenate([*whole, walls]), np.concatenate([low, low + np.array([0, 0, 1])]), up


def cut(faces, vertices, normals):
    """The triangles of the mesh without its small handles, where the vertices are all points."""
    tree = KdTree.build(vertices)
    reaches = np.sqrt(nearest_others(tree, RANK)[1][:, -1])
    cover = Cover(tree.points, tree.lower, tree.upper, normals[tree.order], reaches)
    mesh = HalfEdges.from_faces(faces, len(vertices))
    return without_small_handles(mesh, vertices, normals, reaches[np.argsort(tree.order)], cover).faces()


def noisy(name, n, level=1e-3):
    """A sample with noise, in diagonals of the box around it."""
    points = gppcs.sample(name, n_points=n).points
    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    return points + level * diagonal * np.random.default_rng(1).standard_normal(points.shape)


@pytest.mark.parametrize("tubes", [1, 2, 3, 6])
def test_of_the_tubes_between_two_sheets_all_but_one_are_cut(tubes):
    faces, vertices, normals = bridged(50 * np.arange(1, tubes + 1))
    assert topology_of(faces)[3:] == (1, tubes - 1)
    left = cut(faces, vertices, normals)
    assert topology_of(left) == (0, 0, 2 + 2 * (tubes - 1), 1, 0)
    assert len(faces) - len(left) < 20 * tubes
    if tubes == 1:
        assert np.array_equal(left, faces)


def test_a_noisy_relief_has_no_handle():
    """A false handle of a few edges was there."""
    result = gppcs.mesh(noisy("medallion", 20_000), n_points=500)
    assert topology_of(result.mesh.faces) == (0, 0, 1, 1, 0)
    assert len(result.mesh.vertices) == 500


@pytest.mark.parametrize("n_points", [100, 500])
def test_drilled_holes_stay_though_they_are_a_few_edges_wide(n_points):
    assert gppcs.mesh(noisy("bracket", 5_000), n_points=n_points).diagnostics.genus == 5


@pytest.mark.parametrize(("radius", "thickness"), [(1.0, 3), (1.2, 2), (1.2, 3)])
def test_narrow_holes_of_a_thin_plate_stay(radius, thickness):
    """In spacings of the first mesh. Of the 16 holes, 3, 14 and 12 stayed."""
    spacing = np.sqrt(2 / (8 * 300))
    points = drilled_plate(20_000, 4, radius * spacing, thickness * spacing)
    assert topology_of(gppcs.mesh(points, n_points=300).mesh.faces) == (0, 0, 0, 1, 16)


@pytest.mark.parametrize(("radius", "n"), [(0.4, 4000), (0.06, 1000), (0.04, 1500)])
def test_a_ring_has_one_handle_though_it_is_noisy_and_a_few_spacings_thick(radius, n):
    """The second ring had two handles."""
    points = torus(n, radius=radius)[0]
    points += 0.05 * radius * np.random.default_rng(0).standard_normal(points.shape)
    assert gppcs.mesh(points, n_points=300).diagnostics.genus == 1
