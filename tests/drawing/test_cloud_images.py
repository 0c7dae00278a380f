import numpy as np
import pytest

from gppcs.drawing.camera import Camera
from gppcs.drawing.cloud_images import ColouredCloud, Original, View
from shapes import on_sphere

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
RADIUS = 3.0


def ellipsoid(count=20_000, seed=0):
    """Return points of an ellipsoid that is seen from -y, and its normals."""
    direction = on_sphere(count, seed)
    semi_axes = np.array([2.0, 1.0, 1.5])
    normals = direction / semi_axes
    return direction * semi_axes, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def view_of(points, normals=None, values=None):
    cloud = ColouredCloud(points, np.zeros(len(points)) if values is None else values, normals)
    return View(Original(cloud), Camera.towards(points, 200, (130, 130)))


def coloured(image):
    """Return which pixels are red and which are blue."""
    return image[..., 0] > image[..., 2] + 0.05, image[..., 2] > image[..., 0] + 0.05


@pytest.mark.parametrize("given_normals", [True, False])
@pytest.mark.parametrize("square", [None, (140, 90, 75)])
def test_the_far_side_does_not_show_through(given_normals, square):
    points, normals = ellipsoid()
    view = view_of(points, normals if given_normals else None)
    if square:
        view = View(view.original, view.camera.close_up(square, 100))
    far = normals @ view.camera.axes[2] < -0.25
    colours = np.where(far[:, None], RED, BLUE)
    some = slice(0, 3000)
    single = ColouredCloud(points[some], np.zeros(3000), normals[some] if given_normals else None)
    for image in (view.surface(colours), view.points(single, colours[some], RADIUS)):
        red, blue = coloured(image)
        assert blue.mean() > 0.05
        assert not red.any()


def test_the_original_is_closed_and_the_others_are_single_points():
    points, _ = ellipsoid()
    view = view_of(points)
    _, original = coloured(view.surface(np.tile(BLUE, (len(points), 1))))
    some = ColouredCloud(points[:300], np.zeros(300))
    _, single = coloured(view.points(some, np.tile(BLUE, (300, 1)), RADIUS))
    row = original[len(original) // 2]
    assert row[np.flatnonzero(row)[0] : np.flatnonzero(row)[-1]].all()
    assert 0.02 < single.sum() / original.sum() < 0.5


def test_a_close_up_is_the_same_picture_enlarged():
    points, normals = ellipsoid(40_000)
    view = view_of(points, normals)
    colours = np.where(points[:, :1] > 0.3, RED, BLUE)
    square = (150, 100, 80)
    close = View(view.original, view.camera.close_up(square, 40)).surface(colours)  # enlarged by 1
    part = view.surface(colours)[50:90, 75:115]
    assert np.abs(close - part).mean() < 0.02
    assert np.abs(part[:, ::-1] - part).mean() > 0.1
    assert (View(view.original, view.camera.close_up((0, 0, 20), 100)).surface(colours) == 1.0).all()


FLAT = {
    "one point": [[1.0, 2.0, 3.0]],
    "one place": np.zeros((20, 3)),
    "slanted line": np.linspace([0.0, 0.0, 0.0], [1.0, 2.0, 3.0], 50),
    "far plane": [[1e7 + 1e-3 * x, 1e7, 1e7 + 1e-3 * z] for x in range(9) for z in range(9)],
    "tiny": [[0.0, 0.0, 0.0], [1e-300, 0.0, 0.0]],
    "huge": [[0.0, 0.0, 0.0], [1e150, 0.0, 1.0]],
}


@pytest.mark.parametrize("points", FLAT.values(), ids=FLAT)
def test_clouds_without_extent_are_drawn(points):
    points = np.array(points)
    view = view_of(points)
    one = ColouredCloud(points[:1], np.zeros(1))
    colours = np.tile(BLUE, (len(points), 1))
    assert coloured(view.surface(colours))[1].any()
    assert coloured(view.points(one, colours[:1], RADIUS))[1].any()
