import numpy as np
import pytest

from gppcs.drawing.camera import Camera
from gppcs.drawing.viewpoint import Viewpoint

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
    place, _ = camera.pixels(points)
    assert place.min() >= 0
    assert (place < camera.shape).all()
    assert (np.ptp(place, axis=0) / camera.shape).max() > 0.9


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


def test_a_scan_that_thins_out_is_seen_to_its_ends_but_a_stray_does_not_make_the_rest_tiny():
    points = np.vstack([BOX, BOX[:60] * 2.8])  # as of a LiDAR: few points hold nearly all of the extent
    camera = Camera.towards(points, 100, (100, 100))
    place, _ = camera.pixels(points)
    assert place.min() >= 0
    assert (place < camera.shape).all()
    place, _ = Camera.towards(np.vstack([BOX, [1e9, 0.0, 0.0]]), 100, (100, 100)).pixels(BOX)
    assert np.ptp(place, axis=0).max() > 100
