"""What is up, guessed from the cloud."""

import numpy as np
import pytest

import gppcs
from gppcs.drawing.viewpoint import BESIDE_THE_CAMERA, Viewpoint, spread_over
from gppcs.errors import ParameterError
from meshes import monument

BOX = np.random.default_rng(0).uniform(-1.0, 1.0, (4000, 3))
SCANS = {  # what is up in each, known from where it comes, or seen in its picture
    "bunny": "y", "dragon": "y", "armadillo_50k": "y", "nefertiti": "y", "face_rangemap": "y", "lion_takanawa": "z",
    "sfm_angel": "z", "sfm_bird_bath": "z", "nyu_basement": "-y", "tum_desk": "-y", "redwood_livingroom_frame": "-y",
    "pcl_table_mug_stereo": "-y", "kitti_000000": "z", "autzen_airborne": "z", "lidr_topography_airborne": "z",
    "modelnet_toilet_0001": "z",
}  # fmt: skip


@pytest.mark.parametrize(("name", "up"), SCANS.items())
def test_real_scans_stand_upright(shared_data, name, up):
    assert Viewpoint().guessed(gppcs.read(shared_data / f"{name}.ply").points)[0] == up


@pytest.mark.parametrize("name", ["bunny", "lion_takanawa", "sfm_angel"])
def test_a_mesh_stands_upright_as_its_cloud_does(shared_data, name):
    mesh = gppcs.mesh(gppcs.read(shared_data / f"{name}.ply"), n_points=2000).mesh
    assert Viewpoint().guessed(spread_over(mesh))[0] == SCANS[name]


def test_a_mesh_with_few_vertices_on_the_ground_stands_on_it():
    mesh = monument()
    points = spread_over(mesh)
    box = 2 * (1 + 3) * 2 + 1 * 3
    assert (points[:, 2] == 0.0).mean() == pytest.approx(36 / (36 + box), abs=0.01)
    assert Viewpoint().guessed(mesh.vertices)[0] == "y"
    assert Viewpoint().guessed(points)[0] == "z"


def test_a_depth_image_is_seen_from_beside_its_camera():
    v, u = np.mgrid[:60, :80]
    depth = 2.0 + 0.5 * np.sin(u / 9.0) + 0.8 * (v < 30)
    points = np.stack([depth * (u - 39.5) / 90.0, depth * (v - 29.5) / 90.0, depth], axis=-1).reshape(-1, 3)
    assert Viewpoint().guessed(points) == ("-y", BESIDE_THE_CAMERA)
    assert Viewpoint("z").guessed(points) == ("z", BESIDE_THE_CAMERA)
    assert Viewpoint().guessed(points + np.array([0.0, 0.0, 100.0]))[0] != "-y"  # in front of no camera at the origin


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
    ("viewpoint", "message"),
    [
        (("w",), "found 'w'"),
        ((3,), "found 3"),
        ((None, (0.0, 91.0)), r"from -90 to 90, in degrees, found \(0.0, 91.0\)"),
        ((None, (np.nan, 0.0)), r"found \(nan, 0.0\)"),
        ((None, (1.0, 2.0, 3.0)), r"found \(1.0, 2.0, 3.0\)"),
        ((None, "up"), "found 'up'"),
    ],
)
def test_a_viewpoint_that_is_none_is_refused(viewpoint, message):
    with pytest.raises(ParameterError, match=message):
        Viewpoint(*viewpoint)
