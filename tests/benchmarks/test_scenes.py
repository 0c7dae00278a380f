"""Scenes: rays against formulas and against following each ray to each surface; sensors; points on known surfaces."""

from dataclasses import replace

import numpy as np
import pytest

import gppcs
from scans import SCENES, room, sample, street, terrain
from scans.scene import NO_SURFACE, Rays
from scans.surfaces import Look, box, cylinder, foliage, polygon, relief, sphere

EVERY = pytest.mark.parametrize("name", SCENES)
LOOK = Look((200, 100, 50), 64)
SQUARE = [(-1.0, -1.0, 0.5), (1.0, -1.0, 0.5), (1.0, 1.0, 0.5), (-1.0, 1.0, 0.5)]
HOLE = [(0.5 * x, 0.5 * y, z) for x, y, z in SQUARE]
START, END = np.array([0.2, -0.3, -1.0]), np.array([0.4, 0.5, 1.2])
CENTRE = np.array([0.1, 0.2, -0.3])


def in_square(points):
    """Whether points are on the square: height, and the parts of the ring around the hole."""
    far = np.abs(points[:, :2]).max(axis=1)
    return np.where((far <= 1.0) & (far >= 0.5), points[:, 2] - 0.5, np.nan)


def in_tube(points):
    """Distances from the tube, NaN beyond its ends."""
    axis = (END - START) / np.linalg.norm(END - START)
    along = (points - START) @ axis
    inside = (along >= 0.0) & (along <= np.linalg.norm(END - START))
    return np.where(inside, np.linalg.norm(np.cross(points - START, axis), axis=1) - 0.6, np.nan)


# Each surface, and a function that is zero on it, changes its sign across it, and is NaN beside it.
SURFACES = {
    "polygon with a hole": (polygon(SQUARE, LOOK, [HOLE]), in_square),
    "cylinder": (cylinder(tuple(START), tuple(END), 0.6, LOOK), in_tube),
    "sphere": (sphere(tuple(CENTRE), 0.9, LOOK), lambda points: np.linalg.norm(points - CENTRE, axis=1) - 0.9),
}


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rays_of(scene, count):
    grid = scene.grid(count)
    return scene.rays(grid, np.arange(np.prod(grid)))


def random_rays(count, seed=0):
    rng = np.random.default_rng(seed)
    return Rays(rng.uniform(-3, 3, (count, 3)), unit(rng.standard_normal((count, 3))))


@pytest.mark.parametrize("name", SURFACES)
def test_rays_end_on_the_surface_and_cross_it_nowhere_before(name):
    (surface, beside), (origins, directions) = SURFACES[name], random_rays(4000)
    reached = surface.meet(origins, directions, np.random.default_rng(0))
    met = np.isfinite(reached)
    assert 50 < met.sum() < 3950
    ends = origins[met] + reached[met, None] * directions[met]
    normals = surface.normals(ends)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    slope = (beside(ends + 1e-5 * normals) - beside(ends - 1e-5 * normals)) / 2e-5
    assert np.nanmax(np.abs(beside(ends))) < 1e-9
    assert np.nanmin(np.abs(slope)) > 1 - 1e-6
    assert np.linalg.norm(ends - surface.centre, axis=1).max() <= surface.radius + 1e-9
    before = np.linspace(0.0, 1.0, 401)[:-1, None] * np.where(met, reached, 10.0)
    on_the_way = beside((origins + before[..., None] * directions).reshape(-1, 3)).reshape(before.shape)
    assert not (np.sign(on_the_way[:-1]) * np.sign(on_the_way[1:]) < 0).any()


def test_ways_among_leaves_follow_the_law_of_beer_and_lambert():
    leaves = foliage((0.0, 0.0, 0.0), 1.0, LOOK, 0.5)
    origins = np.tile([-3.0, 0.0, 0.0], (40_000, 1))
    reached = leaves.meet(origins, np.tile([1.0, 0.0, 0.0], (40_000, 1)), np.random.default_rng(1))
    assert np.isinf(reached).mean() == pytest.approx(np.exp(-2.0 / 0.5), rel=0.1)
    assert np.mean(reached - 2.0 < 0.5) == pytest.approx(1.0 - np.exp(-1.0), rel=0.02)


def test_a_relief_is_met_at_its_height():
    ground = relief(terrain.ground, 50.0, (-5.0, 9.0), LOOK)
    rng = np.random.default_rng(2)
    aims = np.column_stack([rng.uniform(-45, 45, (3000, 2)), np.zeros(3000)])
    origins = np.tile([5.0, -10.0, 400.0], (3000, 1))
    directions = unit(aims - origins)
    ends = origins + ground.meet(origins, directions, rng)[:, None] * directions
    np.testing.assert_allclose(ends[:, 2], terrain.ground(ends[:, 0], ends[:, 1])[0], atol=1e-9)


def test_the_slopes_of_the_ground_are_its_derivatives():
    x, y = np.random.default_rng(3).uniform(-60, 60, (2, 2000))
    step = 1e-5
    _, along_x, along_y = terrain.ground(x, y)
    rises = [
        (terrain.ground(x + dx, y + dy)[0] - terrain.ground(x - dx, y - dy)[0]) / (2.0 * step)
        for dx, dy in ((step, 0.0), (0.0, step))
    ]
    np.testing.assert_allclose([along_x, along_y], rises, atol=1e-7)


def test_a_box_is_closed():
    faces = box((1.0, 2.0), (0.5, 0.8), (0.1, 0.9), LOOK, 0.3)
    inside = Rays(np.tile([1.0, 2.0, 0.5], (500, 1)), random_rays(500).directions)
    reached = [face.meet(*inside, np.random.default_rng(0)) for face in faces]
    assert (np.isfinite(reached).sum(axis=0) == 1).all()


@EVERY
def test_each_ray_ends_at_the_first_of_all_surfaces(name):
    scene = SCENES[name]
    solid = replace(scene, surfaces=tuple(s for s in scene.surfaces if s.normals(np.ones((1, 3))).any()))  # no leaves
    all_rays = rays_of(solid, 6_000)
    some = np.random.default_rng(4).permutation(len(all_rays.origins))[:2000]
    rays = Rays(all_rays.origins[some], all_rays.directions[some])
    expected = np.min([surface.meet(*rays, np.random.default_rng(0)) for surface in solid.surfaces], axis=0)
    distances, met = solid.follow(all_rays, np.random.default_rng(0))
    np.testing.assert_allclose(distances[some], expected, rtol=1e-9)
    assert ((met == NO_SURFACE) == np.isinf(distances)).all()


def test_equal_rays_end_at_the_same_place():
    down = Rays(np.tile([1.0, 1.0, 2.0], (20_000, 1)), np.tile([0.0, 0.0, -1.0], (20_000, 1)))
    distances, met = SCENES["room"].follow(down, np.random.default_rng(0))
    assert len(np.unique(distances)) == len(np.unique(met)) == 1
    assert met[0] != NO_SURFACE


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


@pytest.mark.slow
@EVERY
def test_a_scene_has_what_a_scan_has(name):
    cloud = sample(name, 1001, seed=2)
    assert len(cloud) == 1001
    assert {key: values.dtype.name for key, values in cloud.attributes.items()} == {
        **dict.fromkeys(("nx", "ny", "nz"), "float32"),
        **dict.fromkeys(("red", "green", "blue", "classification"), "uint8"),
    }
    assert set(np.unique(cloud.attributes["classification"])) <= {2, 5, 6, 11, 14, 15, 64}
    again = sample(name, 1001, seed=2)
    assert again.points.tobytes() == cloud.points.tobytes()
    assert sample(name, 1001, seed=3).points.tobytes() != cloud.points.tobytes()
    assert len(sample(name, 1)) == 1


def test_a_scene_of_several_blocks_is_the_same_for_any_number_of_threads(monkeypatch):
    monkeypatch.setattr("scans.scene.BLOCK", 500)
    clouds = []
    for threads in (1, 3):
        gppcs.set_threads(threads)
        clouds.append(sample("forest", 2_001))
    gppcs.set_threads(None)
    assert len(clouds[0]) == 2_001
    assert clouds[0].points.tobytes() == clouds[1].points.tobytes()


def test_depths_of_the_room_are_multiples_of_a_step_and_their_noise_grows_with_distance():
    cloud = sample("room", 20_000)
    axis = unit(room.LOOKS_AT - room.CAMERA)
    depth = (cloud.points - room.CAMERA) @ axis
    disparity = 1.0 / (2.85e-3 * depth)
    np.testing.assert_allclose(disparity, np.round(disparity), atol=0.01)
    floor = cloud.attributes["classification"] == 2
    error = np.abs(cloud.points[:, 2])
    near, far = floor & (depth < 2.5), floor & (depth > 3.4)
    assert error[far].mean() > 1.4 * error[near].mean()


def test_every_laser_of_the_street_turns():
    rays = rays_of(street.STREET, 50_000)
    elevations, counts = np.unique(np.round(np.degrees(np.arcsin(rays.directions[:, 2])), 6), return_counts=True)
    np.testing.assert_allclose(elevations, np.degrees(street.LASERS), atol=1e-5)
    assert len(set(counts)) == 1
    assert np.all(np.diff(rays.origins[:, 0]) >= 0.0)
