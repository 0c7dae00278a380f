"""Scenes: rays against formulas and against following each ray to each surface; sensors; points on known surfaces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import gppcs
from gppcs.errors import ParameterError
from gppcs.scans.scenes import SCENES, room, street, terrain
from gppcs.scans.scenes.scene import NO_SURFACE, Rays
from gppcs.scans.scenes.surfaces import Cylinder, Foliage, Look, Polygon, Relief, Sphere, box

EVERY = pytest.mark.parametrize("name", SCENES)
LOOK = Look((200, 100, 50), 64)
SQUARE = [(-1.0, -1.0, 0.5), (1.0, -1.0, 0.5), (1.0, 1.0, 0.5), (-1.0, 1.0, 0.5)]
HOLE = [(-0.5, -0.5, 0.5), (0.5, -0.5, 0.5), (0.5, 0.5, 0.5), (-0.5, 0.5, 0.5)]
SURFACES = {
    "polygon": Polygon(SQUARE, LOOK),
    "polygon with a hole": Polygon(SQUARE, LOOK, [HOLE]),
    "cylinder": Cylinder((0.2, -0.3, -1.0), (0.4, 0.5, 1.2), 0.6, LOOK),
    "sphere": Sphere((0.1, 0.2, -0.3), 0.9, LOOK),
}
vectors = hnp.arrays(float, 3, elements=st.floats(-3, 3, width=32))


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def random_rays(count, seed=0):
    rng = np.random.default_rng(seed)
    return Rays(rng.uniform(-3, 3, (count, 3)), unit(rng.standard_normal((count, 3))))


@pytest.mark.parametrize("name", SURFACES)
def test_rays_end_on_the_surface_and_reach_it_nowhere_before(name):
    surface, (origins, directions) = SURFACES[name], random_rays(4000)
    reached = surface.meet(origins, directions, np.random.default_rng(0))
    met = np.isfinite(reached)
    assert 50 < met.sum() < 3950
    ends = origins[met] + reached[met, None] * directions[met]
    assert surface.distances(ends).max() < 1e-9
    for share in np.linspace(0.05, 0.95, 10):  # no side is changed on the way
        step = np.where(met, share * reached, share * 10.0)[:, None]
        assert (surface.distances(origins + step * directions) > 1e-6).all()


@pytest.mark.parametrize("name", SURFACES)
def test_steps_along_the_normal_leave_the_surface_and_steps_aside_do_not(name):
    surface, (origins, directions) = SURFACES[name], random_rays(4000)
    reached = surface.meet(origins, directions, np.random.default_rng(0))
    met = np.isfinite(reached)
    ends = origins[met] + reached[met, None] * directions[met]
    normals = surface.normals(ends)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    np.testing.assert_allclose(surface.distances(ends + 1e-4 * normals), 1e-4, rtol=1e-6)
    aside = unit(np.cross(normals, directions[met]))
    assert np.median(surface.distances(ends + 1e-4 * aside)) < 1e-7


@pytest.mark.parametrize("name", SURFACES)
@given(point=vectors, other=vectors)
def test_a_distance_changes_by_no_more_than_the_way(name, point, other):
    first, second = SURFACES[name].distances(np.array([point, other]))
    assert abs(first - second) <= np.linalg.norm(point - other) + 1e-9


@pytest.mark.parametrize("name", SURFACES)
def test_surfaces_are_inside_their_ball(name):
    centre, radius = SURFACES[name].ball
    origins, directions = random_rays(4000)
    reached = SURFACES[name].meet(origins, directions, np.random.default_rng(0))
    ends = (origins + reached[:, None] * directions)[np.isfinite(reached)]
    assert np.linalg.norm(ends - centre, axis=1).max() <= radius + 1e-9


def test_ways_among_leaves_follow_the_law_of_beer_and_lambert():
    leaves = Foliage((0.0, 0.0, 0.0), 1.0, 0.5, LOOK)
    origins = np.tile([-3.0, 0.0, 0.0], (40_000, 1))
    reached = leaves.meet(origins, np.tile([1.0, 0.0, 0.0], (40_000, 1)), np.random.default_rng(1))
    assert np.isinf(reached).mean() == pytest.approx(np.exp(-2.0 / 0.5), rel=0.1)
    assert np.mean(reached - 2.0 < 0.5) == pytest.approx(1.0 - np.exp(-1.0), rel=0.02)


def test_a_relief_is_met_at_its_height():
    relief = Relief(terrain.ground, (-50.0, -50.0), (50.0, 50.0), (-5.0, 9.0), LOOK)
    rng = np.random.default_rng(2)
    aims = np.column_stack([rng.uniform(-45, 45, (3000, 2)), np.zeros(3000)])
    origins = np.tile([5.0, -10.0, 400.0], (3000, 1))
    directions = unit(aims - origins)
    ends = origins + relief.meet(origins, directions, rng)[:, None] * directions
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
    solid = gppcs.scans.Scene(
        "", tuple(s for s in scene.surfaces if not isinstance(s, Foliage)), scene.rays, scene.measured
    )
    all_rays = solid.rays(6_000)
    some = np.random.default_rng(4).permutation(len(all_rays.origins))[:2000]
    rays = Rays(all_rays.origins[some], all_rays.directions[some])
    expected = np.min([surface.meet(*rays, np.random.default_rng(0)) for surface in solid.surfaces], axis=0)
    distances, met = solid.follow(all_rays, np.random.default_rng(0))
    np.testing.assert_allclose(distances[some], expected, rtol=1e-9)
    assert ((met == NO_SURFACE) == np.isinf(distances)).all()


@EVERY
def test_without_noise_the_points_are_on_the_surfaces(name):
    scene = SCENES[name]
    exact = gppcs.scans.Scene("", scene.surfaces, scene.rays, lambda rays, distances, rng: distances)
    measured = exact.scan(2000, np.random.default_rng(5))
    solid = measured.classification != 5
    points = measured.points.astype(float)
    assert solid.mean() > 0.9
    assert exact.distances(points[solid]).max() < 1e-4
    normals = measured.normals[solid].astype(float)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    off = exact.distances(points[solid] + 0.01 * normals)
    assert np.mean(np.abs(off - 0.01) < 1e-3) > 0.9  # in corners and beside books something else is nearer


@pytest.mark.slow
@EVERY
def test_a_scene_has_what_a_scan_has(name):
    cloud = gppcs.sample(name, 1001, seed=2)
    assert len(cloud) == 1001
    assert {key: values.dtype.name for key, values in cloud.attributes.items()} == {
        **dict.fromkeys(("nx", "ny", "nz"), "float32"),
        **dict.fromkeys(("red", "green", "blue", "classification"), "uint8"),
    }
    assert set(np.unique(cloud.attributes["classification"])) <= {2, 5, 6, 11, 14, 15, 64}
    again = gppcs.sample(name, 1001, seed=2)
    assert again.points.tobytes() == cloud.points.tobytes()
    assert gppcs.sample(name, 1001, seed=3).points.tobytes() != cloud.points.tobytes()
    assert len(gppcs.sample(name, 1)) == 1


def test_noise_and_outliers_come_on_top():
    clean, cloud = gppcs.sample("room", 4000), gppcs.sample("room", 4000, outliers=0.1)
    stray = cloud.attributes["outlier"].astype(bool)
    assert stray.sum() == 400
    np.testing.assert_array_equal(cloud.points[~stray], clean.points[~stray])
    assert set(cloud.attributes["classification"][stray]) == {7}
    diagonal = np.linalg.norm(np.ptp(clean.points, axis=0))
    noisy = gppcs.sample("room", 4000, noise=0.01)
    np.testing.assert_allclose((noisy.points - clean.points).std(axis=0), 0.01 * diagonal, rtol=0.05)


def test_the_density_of_a_scene_is_that_of_its_sensor():
    with pytest.raises(ParameterError, match=r"uneven of 0 for the scene room, found 0\.5: its sensor decides"):
        gppcs.sample("room", 100, uneven=0.5)


def test_depths_of_the_room_are_multiples_of_a_step_and_their_noise_grows_with_distance():
    cloud = gppcs.sample("room", 20_000)
    axis = unit(room.LOOKS_AT - room.CAMERA)
    depth = (cloud.points - room.CAMERA) @ axis
    disparity = 1.0 / (room.STEP * depth)
    np.testing.assert_allclose(disparity, np.round(disparity), atol=0.01)
    error = SCENES["room"].distances(cloud.points)
    near, far = depth < 2.2, depth > 3.4
    assert error[far].mean() > 1.7 * error[near].mean()


def test_every_laser_of_the_street_turns():
    rays = street.STREET.rays(50_000)
    elevations, counts = np.unique(np.round(np.degrees(np.arcsin(rays.directions[:, 2])), 6), return_counts=True)
    np.testing.assert_allclose(elevations, np.degrees(street.LASERS), atol=1e-5)
    assert len(set(counts)) == 1
    assert np.all(np.diff(rays.origins[:, 0]) >= 0.0)


def test_the_street_is_denser_near_the_car():
    points = gppcs.sample("street", 5_000).points
    road = (np.abs(points[:, 1]) < 1.5) & (np.abs(points[:, 2]) < 0.1)
    ahead = points[road, 0] - street.DRIVE[1]
    assert np.sum((ahead > 0) & (ahead < 6)) > 3 * np.sum((ahead > 10) & (ahead < 16))


def test_the_ground_is_seen_between_leaves():
    cloud = gppcs.sample("terrain", 40_000)
    codes = cloud.attributes["classification"]
    wood = np.linalg.norm(cloud.points[:, :2] - [-32.0, 28.0], axis=1) < 8.0
    assert (codes[wood] == 5).sum() > 40
    assert (codes[wood] == 2).sum() > 40
    assert {14, 15} <= set(codes)
