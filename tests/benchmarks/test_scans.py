"""The solids and scenes that only benchmarks and tests use."""

from dataclasses import replace

import numpy as np
import pytest

from scans import OBJECTS, SCENES, sample
from scans.implicit import Solid, limbs, scan_of
from scans.scene import NO_SURFACE, Rays

SOLIDS = [name for name, scan in OBJECTS.items() if isinstance(scan.patches[0], Solid)]
EVERY = pytest.mark.parametrize("name", SCENES)


@pytest.mark.parametrize("name", ["bracket", "fan", "sphere", "statue", *SOLIDS])
def test_closed_scans_are_closed_and_normals_point_outward(name):
    """Over a closed surface the normals add up to nothing, and their products with the places to the volume (Gauss)."""
    cloud = sample(name, 20_000 if name in SOLIDS else 100_000, seed=3)
    normals = cloud.normals()
    assert np.all(np.abs(normals.mean(axis=0)) < 4.0 * normals.std(axis=0) / np.sqrt(len(normals)))
    products = normals * cloud.points
    by_axis = products.mean(axis=0)
    np.testing.assert_allclose(by_axis, by_axis.mean(), atol=4.0 * products.std(axis=0).max() / np.sqrt(len(normals)))
    assert by_axis.min() > 0.4


@pytest.mark.parametrize("name", SOLIDS)
def test_points_of_solids_lie_on_their_surface_and_their_normals_leave_it(name):
    function, cloud = OBJECTS[name].patches[0].function, sample(name, 3000)
    normals = cloud.normals()
    assert np.abs(function(cloud.points)).max() < 1e-4
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    ahead, behind = (function(cloud.points + step * normals) for step in (0.005, -0.005))
    assert np.mean((ahead > 0.0) & (behind < 0.0)) > 0.998  # a step may cross an edge


def test_a_ball_of_limbs_has_its_curvature_and_is_uniform_by_height():
    ball = scan_of(limbs([[0, 0, 0, 5, 1e-9, 0, 0, 5]], 1.0), ((-5,) * 3, (5,) * 3), 1.5, (0, 0, 0)).patches[0]
    drawn = ball.draw(20_000, np.random.default_rng(1))
    np.testing.assert_allclose(np.linalg.norm(drawn.points, axis=1), 5.0, atol=1e-5)
    np.testing.assert_allclose(drawn.normals, drawn.points / 5.0, atol=1e-5)
    np.testing.assert_allclose(drawn.curvature, 0.2, atol=1e-4)
    counts, _ = np.histogram(drawn.points[:, 2], 10, (-5.0, 5.0))  # equal areas (Archimedes)
    assert ((counts - counts.mean()) ** 2 / counts.mean()).sum() < 27.9  # chi-square, 9 degrees of freedom, p = 0.001


@EVERY
def test_each_ray_ends_at_the_first_of_all_surfaces(name):
    scene = SCENES[name]
    solid = replace(scene, surfaces=tuple(s for s in scene.surfaces if s.normals(np.ones((1, 3))).any()))  # no leaves
    grid = solid.grid(6_000)
    all_rays = solid.rays(grid, np.arange(np.prod(grid)))
    some = np.random.default_rng(4).permutation(len(all_rays.origins))[:2000]
    rays = Rays(all_rays.origins[some], all_rays.directions[some])
    expected = np.min([surface.meet(*rays, np.random.default_rng(0)) for surface in solid.surfaces], axis=0)
    distances, met = solid.follow(all_rays, np.random.default_rng(0))
    np.testing.assert_allclose(distances[some], expected, rtol=1e-9)
    assert ((met == NO_SURFACE) == np.isinf(distances)).all()


@EVERY
def test_without_noise_the_points_are_where_the_rays_end_and_normals_look_back(name):
    scene = replace(SCENES[name], measured=lambda rays, distances, rng: distances)
    points, normals, *_ = scene.scan(1500, np.random.default_rng(5))
    solid = normals.any(axis=1)
    assert solid.mean() > 0.5
    points, normals = points[solid].astype(float), normals[solid].astype(float)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    # A ray back along the normal, from a millimetre in front, ends at the point.
    back = Rays(points + 1e-3 * normals, -normals)
    distances = np.min([surface.meet(*back, np.random.default_rng(0)) for surface in scene.surfaces], axis=0)
    assert np.mean(np.abs(distances - 1e-3) < 1e-4) > 0.98
