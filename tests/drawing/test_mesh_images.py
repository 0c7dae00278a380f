import numpy as np
import pytest

from gppcs.clouds.mesh import Mesh
from gppcs.drawing.camera import Camera
from gppcs.drawing.mesh_images import mesh_images

CORNERS = np.array([[x, y, z] for x in (0.0, 3.0) for y in (0.0, 1.0) for z in (0.0, 2.0)])
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
BOX = Mesh(CORNERS, np.vstack([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]]))


@pytest.fixture(scope="module")
def camera():
    return Camera.towards(CORNERS, 120, (80, 150))


def covered(image):
    return image.min(axis=2) < 0.98


def inside(camera, faces):
    """Return which pixels have their centre on the picture of a mesh, by the sides of its triangles."""
    width, height = camera.size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    seen = (CORNERS @ camera.axes[:2].T - camera.centre) * camera.scale / 2.0
    corners = seen * (1.0, -1.0) + np.array(camera.size) / 2.0
    hit = np.zeros((height, width), dtype=bool)
    for a, b, c in corners[faces]:
        turns = [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in ((a, b), (b, c), (c, a))]
        hit |= (np.min(turns, axis=0) >= 0.0) | (np.max(turns, axis=0) <= 0.0)
    return hit


def test_a_mesh_is_drawn_where_the_camera_sees_it(camera):
    close = camera.close_up((10, 10, 90), 100)
    for image, by in zip(mesh_images(BOX, [camera, close]), [camera, close], strict=True):
        assert image.shape == (*by.size[::-1], 3)
        assert 0.2 < covered(image).mean() < 0.95
        assert (covered(image) != inside(by, BOX.faces)).mean() < 0.02


def test_a_balloon_does_not_hide_what_it_does_not_cover(camera):
    up, away = camera.axes[1], camera.axes[2]
    balloon = np.array([1e4 * up + 1e4 * away, 2e4 * up - 1e4 * away, 1e4 * up + camera.axes[0]])
    mesh = Mesh(np.vstack([CORNERS, balloon]), np.vstack([BOX.faces, [[8, 9, 10]]]))
    one, other = (mesh_images(drawn, [camera])[0] for drawn in (mesh, BOX))
    assert np.abs(one - other).mean() < 0.01


def test_the_nearer_of_two_triangles_is_seen_from_either_side():
    camera = Camera(np.eye(3), np.zeros(2), 10.0, (40, 40))
    corners = np.array([[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]])
    mesh = Mesh(np.vstack([corners, corners + np.eye(3)[2]]), np.array([[0, 1, 2], [5, 4, 3]]))
    colours = np.repeat([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 3, axis=0)
    (image,) = mesh_images(mesh, [camera], colours)
    assert image[..., 1].min() > 0.5
    assert image[..., [0, 2]].max() == 0.0


def test_the_ridge_of_a_flat_roof_is_sharp():
    corners = np.array([[x, y, -0.22 * abs(x)] for x in (-9.0, 0.0, 9.0) for y in (-9.0, 9.0)])
    mesh = Mesh(corners, np.array([[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]]))
    (image,) = mesh_images(mesh, [Camera(np.eye(3), np.zeros(2), 10.0, (40, 40))])
    middle = image.shape[1] // 2
    left, right = image[:, : middle - 1].reshape(-1, 3), image[:, middle + 1 :].reshape(-1, 3)
    assert np.ptp(left, axis=0).max() == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(right, axis=0).max() == pytest.approx(0.0, abs=1e-12)
    assert np.abs(left[0] - right[0]).max() > 0.01
