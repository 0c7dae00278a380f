"""The camera, and what is up, guessed from the cloud."""

import re

import numpy as np
import pytest

import gppcs
from gppcs.drawing.camera import Camera, Viewpoint, spread_over
from gppcs.errors import ParameterError

BOX = np.random.default_rng(0).uniform(-1.0, 1.0, (4000, 3))
FRONTS = {  # at azimuth 0: what points to the right, and to the viewer
    "z": ("x", "-y"), "-z": ("x", "y"), "y": ("x", "z"), "-y": ("x", "-z"), "x": ("y", "-z"), "-x": ("y", "z"),
}  # fmt: skip


def axis(name):
    return np.eye(3)["xyz".index(name[-1])] * (-1.0 if name[0] == "-" else 1.0)


@pytest.mark.parametrize("extents", [(2.0, 1.0, 2.5), (1.0, 3.0, 1.0), (5.0, 4.0, 0.1), (1.0, 0.0, 0.0)])
@pytest.mark.parametrize("heights", [(200, 200), (50, 400)])
def test_everything_is_seen_and_fills_the_panel(extents, heights):
    points = BOX * extents
    camera = Camera.towards(points, 150, heights)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.axes) == pytest.approx(1.0)
    assert camera.size[0] == 150
    assert heights[0] <= camera.size[1] <= heights[1]
    pixels, _ = camera.pixels(points)
    assert pixels.min() >= 0
    assert (pixels < camera.shape).all()
    assert (np.ptp(pixels, axis=0) / camera.shape).max() > 0.9


@pytest.mark.parametrize("scan", ["medallion", "bracket", "fan"])
def test_a_cloud_is_seen_from_where_its_results_and_its_mesh_are(scan):
    cloud = gppcs.sample(scan, n_points=20_000)
    expected = Viewpoint().guessed(cloud.points)
    assert Viewpoint().guessed(gppcs.simplify(cloud, ratio=0.05).cloud.points) == expected
    assert Viewpoint().guessed(spread_over(gppcs.mesh(cloud, n_points=1000).mesh)) == expected


@pytest.mark.parametrize(("up", "front"), FRONTS.items())
def test_the_viewpoint_says_what_is_up_and_from_where_one_looks(up, front):
    right, to_viewer = map(axis, front)

    def axes(azimuth, elevation):
        return Camera.towards(BOX, 100, (100, 100), Viewpoint(up, (azimuth, elevation))).axes

    np.testing.assert_allclose(axes(0, 0), [right, axis(up), to_viewer], atol=1e-12)
    np.testing.assert_allclose(axes(90, 0), [-to_viewer, axis(up), right], atol=1e-12)
    np.testing.assert_allclose(axes(0, 90), [right, -to_viewer, axis(up)], atol=1e-12)
    np.testing.assert_allclose(axes(-180, -90), [-right, -to_viewer, -axis(up)], atol=1e-12)
    np.testing.assert_allclose(axes(30, 20)[2] @ axis(up), np.sin(np.radians(20)), atol=1e-12)


@pytest.mark.parametrize(
    ("count", "factor", "is_whole"), [(2000, 2.5, True), (40, 1.2, True), (40, 2.5, False), (1, 1e9, False)]
)
def test_a_scan_that_thins_out_is_seen_to_its_ends_but_a_few_strays_do_not_make_the_rest_tiny(count, factor, is_whole):
    points = np.vstack([BOX, BOX[:count] * factor])
    camera = Camera.towards(points, 100, (100, 100))
    pixels, _ = camera.pixels(points if is_whole else BOX)
    assert pixels.min() >= 0
    assert (pixels < camera.shape).all()
    assert np.ptp(pixels, axis=0).max() > 0.6 * max(camera.shape)


SCANS = {  # what is up in each, known from where it comes, or seen in its picture
    "bunny": "y", "dragon": "y", "armadillo_50k": "y", "nefertiti": "y", "face_rangemap": "y", "lion_takanawa": "z",
    "sfm_angel": "z", "sfm_bird_bath": "z", "nyu_basement": "-y", "tum_desk": "-y", "redwood_livingroom_frame": "-y",
    "pcl_table_mug_stereo": "-y", "kitti_000000": "z", "autzen_airborne": "z", "lidr_topography_airborne": "z",
    "modelnet_toilet_0001": "z",
}  # fmt: skip


@pytest.mark.parametrize(("name", "up"), SCANS.items())
def test_real_scans_stand_upright(shared_data, name, up):
    assert Viewpoint().guessed(gppcs.read(shared_data / f"{name}.ply").points)[0] == up


def test_a_depth_image_is_seen_from_beside_its_camera():
    v, u = np.mgrid[:60, :80]
    depth = 2.0 + 0.5 * np.sin(u / 9.0) + 0.8 * (v < 30)
    points = np.stack([depth * (u - 39.5) / 90.0, depth * (v - 29.5) / 90.0, depth], axis=-1).reshape(-1, 3)
    assert Viewpoint().guessed(points) == ("-y", (20.0, 20.0))
    assert Viewpoint("z").guessed(points) == ("z", (20.0, 20.0))
    assert Viewpoint().guessed(points + np.array([0.0, 0.0, 100.0]))[0] != "-y"  # in front of no camera at the origin
    fragment = points[np.abs(points[:, 0] + points[:, 1]) < 1.0]  # of several images, in the frame of the first
    assert 0.4 < len(fragment) / len(points) < 0.8
    assert Viewpoint().guessed(fragment) == ("-y", (20.0, 20.0))
    for offset in ((5.0, 0.0, 0.0), (0.0, 0.0, -fragment[:, 2].min())):  # seen from elsewhere
        assert Viewpoint().guessed(fragment + offset)[0] != "-y"


@pytest.mark.parametrize(
    ("extents", "up"),
    [((2.0, 2.0, 0.1), "z"), ((2.0, 1.0, 2.5), "z"), ((2.0, 2.5, 1.5), "y"), ((1.0, 2.0, 1.0), "y")],
)
def test_flat_things_lie_and_tall_ones_stand(extents, up):
    points = BOX * extents
    guessed, direction = Viewpoint().guessed(points)
    assert guessed == up
    assert Viewpoint(up).guessed(points) == (up, direction)
    assert Viewpoint(None, (30.0, 20.0)).guessed(points) == (up, (30.0, 20.0))
    on_ground = np.vstack([points, points[:1500] * (1, 1, 0) - (0, 0, extents[2])])
    assert Viewpoint().guessed(on_ground)[0] == "z"  # though it may be taller along y


@pytest.mark.parametrize(
    "wrong", [("w",), (3,), (None, (0.0, 91.0)), (None, (np.nan, 0.0)), (None, (1.0, 2.0, 3.0)), (None, "up")]
)
def test_a_viewpoint_that_is_none_is_refused(wrong):
    with pytest.raises(ParameterError, match=re.escape(f"found {wrong[-1]!r}")) as error:
        Viewpoint(*wrong)
    assert ("from -90 to 90, in degrees" in str(error.value)) == (len(wrong) == 2)


def test_the_camera_rises_until_half_of_the_ground_of_a_scene_is_seen():
    """Walls as high as the ground is wide hide it, but from steeply above; low ones do not, nor is it seen in a box."""
    rng = np.random.default_rng(0)
    ground = rng.random((4000, 3)) * [12, 6, 0]
    wall = rng.random((4000, 3)) * [12, 0, 1]
    for height, roof, elevation in ((1.0, 0, 22.0), (6.0, 0, 55.0), (6.0, 4000, 22.0)):
        tower = rng.random((1000, 3)) * [1, 1, 4] + [0, 5, 0]
        cover = rng.random((roof, 3)) * [12, 6, 0] + [0, 0, 6]
        points = np.vstack([ground, wall * [1, 1, height], tower, cover])
        assert Viewpoint("z").guessed(points)[1][1] == elevation, (height, roof)
