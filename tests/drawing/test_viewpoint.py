"""What is up, guessed from the cloud."""

import numpy as np
import pytest

import gppcs
from gppcs.drawing.camera import Camera
from gppcs.drawing.viewpoint import BESIDE_THE_CAMERA, Viewpoint
from gppcs.errors import ParameterError

BOX = np.random.default_rng(0).uniform(-1.0, 1.0, (4000, 3))
SCANS = {  # what is up in each, known from where it comes, or seen in its picture
    "bunny": "y", "dragon": "y", "armadillo_50k": "y", "nefertiti": "y", "face_rangemap": "y", "lion_takanawa": "z",
    "sfm_angel": "z", "sfm_bird_bath": "z", "nyu_basement": "-y", "tum_desk": "-y", "redwood_livingroom_frame": "-y",
    "pcl_table_mug_stereo": "-y", "kitti_000000": "z", "autzen_airborne": "z", "lidr_topography_airborne": "z",
    "modelnet_toilet_0001": "z",
}  # fmt: skip


def axis(name):
    return np.eye(3)["xyz".index(name[-1])] * (-1.0 if name[0] == "-" else 1.0)


@pytest.mark.parametrize(("name", "up"), SCANS.items())
def test_real_scans_stand_upright(shared_data, name, up):
    assert Viewpoint().completed(gppcs.read(shared_data / f"{name}.ply").points).up == up


@pytest.mark.slow
@pytest.mark.parametrize("name", ["medallion", "bracket", "room", "street", "terrain"])
def test_samples_stand_upright(name):
    assert Viewpoint().completed(gppcs.sample(name, 5_000).points).up == "z"


def test_a_depth_image_is_seen_from_beside_its_camera():
    v, u = np.mgrid[:60, :80]
    depth = 2.0 + 0.5 * np.sin(u / 9.0) + 0.8 * (v < 30)
    points = gppcs.from_depth(depth, (90.0, 90.0, 39.5, 29.5)).points
    assert Viewpoint().completed(points) == Viewpoint("-y", BESIDE_THE_CAMERA)
    assert Viewpoint("z").completed(points) == Viewpoint("z", BESIDE_THE_CAMERA)
    assert Viewpoint().completed(points + np.array([0.0, 0.0, 100.0])).up != "-y"  # in front of no camera at the origin


def test_what_stands_on_a_ground_is_upright_though_it_is_tall_along_y():
    ground = np.column_stack([BOX[:1500, :2] * (1.0, 2.0), np.full(1500, -1.0)])
    points = np.vstack([BOX * (1.0, 2.0, 1.0), ground])
    assert Viewpoint().completed(points).up == "z"
    assert Viewpoint().completed(BOX * (1.0, 2.0, 1.0)).up == "y"


@pytest.mark.parametrize(("extents", "up"), [((2.0, 2.0, 0.1), "z"), ((2.0, 1.0, 2.5), "z"), ((2.0, 2.5, 1.5), "y")])
def test_half_a_viewpoint_leaves_the_rest_to_the_guess(extents, up):
    def axes(*viewpoint):
        return Camera.towards(BOX * extents, 100, (100, 100), Viewpoint(*viewpoint)).axes

    np.testing.assert_array_equal(axes(up), axes())
    np.testing.assert_array_equal(axes(None, (30.0, 20.0)), axes(up, (30.0, 20.0)))
    assert axes("-" + up)[1] @ axis(up) < 0


@pytest.mark.parametrize(
    ("viewpoint", "message"),
    [
        (("w",), "found 'w'"),
        (("--x",), "found '--x'"),
        (("",), "found ''"),
        ((None, (0.0, 91.0)), "from -90 to 90, in degrees, found 0 and 91"),
        ((None, (np.nan, 0.0)), "found nan and 0"),
        ((3,), "found 3"),
        ((None, (1.0,)), r"found \(1.0,\)"),
        ((None, (1.0, 2.0, 3.0)), r"found \(1.0, 2.0, 3.0\)"),
        ((None, "up"), "found 'up'"),
        ((None, 30.0), "found 30.0"),
    ],
)
def test_a_viewpoint_that_is_none_is_refused(viewpoint, message):
    with pytest.raises(ParameterError, match=message):
        Viewpoint(*viewpoint)
