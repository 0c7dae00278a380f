import io

import numpy as np
import pytest

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.drawing.camera import Viewpoint
from gppcs.drawing.colours import name_of_kind
from gppcs.drawing.single import draw_single
from gppcs.errors import InputError, ParameterError

pytest.importorskip("matplotlib")
ABOVE = Viewpoint("z", (0.0, 90.0))  # x to the right, y up
TRIANGLES = Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0]], [[0, 1, 2], [1, 3, 2]])


def plane(side=40):
    """Return points of a square of edge length 1."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, side), np.linspace(0.0, 1.0, side))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(side * side)])


def picture(cloud, mesh=None, colour=None, viewpoint=ABOVE, size=(100, 100), bar=False):
    """Return a picture, 0 to 1, and what it shows."""
    from matplotlib.image import imread

    file = io.BytesIO()
    drawn = draw_single(file, cloud, mesh, colour, viewpoint, size, bar)
    file.seek(0)
    return imread(file, format="png")[..., :3], drawn


def hue(image):
    """Return the colours of a picture without their brightness."""
    return image / image.max(axis=2, keepdims=True)


@pytest.mark.parametrize("scale", [1, 257, 1 / 255], ids=["8 bits", "16 bits", "0 to 1"])
def test_rgb_is_drawn_where_the_points_are(scale):
    points = plane()
    left = points[:, 0] < 0.5
    colours = np.where(left[:, None], (200, 20, 20), (20, 20, 200)) * scale
    if scale >= 1:
        colours = colours.astype(np.uint16)
    cloud = PointCloud(points, dict(zip(("red", "green", "blue"), colours.T, strict=True)))
    image, drawn = picture(cloud)
    assert drawn[0] == "RGB"
    np.testing.assert_allclose(hue(image)[50, 30], [1.0, 0.1, 0.1], atol=0.02)
    np.testing.assert_allclose(hue(image)[50, 70], [0.1, 0.1, 1.0], atol=0.02)


@pytest.mark.parametrize("size", [(64, 64), (1129, 67), (333, 271)])
@pytest.mark.parametrize("bar", [False, True])
def test_the_picture_has_the_size_asked_for_and_cuts_nothing_off(size, bar):
    image, drawn = picture(PointCloud(plane()), viewpoint=Viewpoint(), size=size, bar=bar)
    assert image.shape == (size[1], size[0], 3)
    border = np.concatenate([image[0], image[:, 0], image[:, -1]])
    assert (border == 1.0).all()
    assert drawn[2] == 0


def test_kinds_have_a_colour_each_and_amounts_a_scale_and_what_is_unknown_is_grey():
    points = plane()
    left = points[:, 0] < 0.5
    image, drawn = picture(PointCloud(points, {"kind": np.where(left, 2, 6).astype(np.uint8)}), colour="kind")
    assert drawn[0] == "kind"
    assert np.abs(hue(image)[50, 30] - hue(image)[50, 70]).max() > 0.2
    values = np.where(left, np.nan, points[:, 1])
    image, drawn = picture(PointCloud(points, {"depth": values}), colour="depth")
    assert drawn[0] == "depth (grey: unknown)"
    assert np.ptp(image[50, 30]) < 0.01 < 0.1 < np.ptp(image[50, 70])
    assert np.ptp(image[10:90, 70], axis=0).max() > 0.3
    outlier = np.where(np.arange(1600) == 0, 1e6, points[:, 1])  # which does not move the scale
    assert np.abs(picture(PointCloud(points, {"depth": outlier}), colour="depth")[0] - image)[:, 52:].mean() < 0.02


def test_classes_have_the_names_of_the_las_specification():
    names = [name_of_kind("classification", kind) for kind in (2, 6.0, 12, 64)]
    assert names == ["2 ground", "6 building", "12", "64"]
    assert name_of_kind("label", 2) == "2"
    many = {name: np.arange(1600, dtype=np.uint8) % 20 for name in ("classification", "kind")}
    image, _ = picture(PointCloud(plane(), many), colour="classification", size=(640, 480), bar=True)
    amounts, _ = picture(PointCloud(plane(), many), colour="kind", size=(640, 480), bar=True)
    assert np.ptp(image[-60:], axis=(0, 1)).max() > 0.5  # a legend
    assert np.abs(image - amounts).max() > 0.5


def test_normals_of_the_cloud_shade_it_where_they_are_known():
    points = plane()
    normals = np.where(points[:, :1] < 0.5, (2.0, -2.0, 1.0), (np.nan, 0.0, 0.0))  # away from the light, and none
    white = dict.fromkeys(("red", "green", "blue"), np.full(1600, 255, np.uint8))
    shaded, _ = picture(PointCloud(points, {**white, **dict(zip(("nx", "ny", "nz"), normals.T, strict=True))}))
    plain, _ = picture(PointCloud(points, white))
    assert shaded[50, 30, 0] < plain[50, 30, 0] - 0.2
    np.testing.assert_array_equal(shaded[50, 70], plain[50, 70])


@pytest.mark.parametrize(("offset", "factor"), [(5e6, 1.0), (0.0, 2.0**-500), (5e6, 2.0**500)])
def test_place_and_unit_of_a_cloud_do_not_matter(offset, factor):
    points = np.random.default_rng(0).random((2000, 3))
    points[:, 2] = 0.2 * np.sin(6.0 * points[:, 0])
    one, other = (
        picture(PointCloud(each), viewpoint=Viewpoint("z", (30.0, 40.0)))[0]
        for each in (points, (points + offset) * factor)
    )
    assert np.abs(one - other).mean() < 0.01


def test_a_mesh_is_white_or_has_the_colours_of_its_vertices():
    cloud = PointCloud(TRIANGLES.vertices)
    image, drawn = picture(cloud, TRIANGLES)
    assert drawn[0] == ""
    assert np.ptp(image, axis=2).max() < 0.03
    assert (image.min(axis=2) < 0.99).mean() > 0.5
    red = np.array([250, 10, 250, 10], dtype=np.uint8)  # the left side
    cloud = PointCloud(TRIANGLES.vertices[::-1], {"red": red[::-1], "green": red[::-1] // 10, "blue": 255 - red[::-1]})
    image, drawn = picture(cloud, TRIANGLES)
    assert drawn[0] == "RGB"
    assert hue(image)[50, 15, 2] < 0.5 < 0.9 < hue(image)[50, 15, 0]
    assert hue(image)[50, 85, 0] < 0.5 < 0.9 < hue(image)[50, 85, 2]


@pytest.mark.parametrize(
    ("cloud", "colour", "size", "error", "message"),
    [
        (PointCloud(np.zeros((0, 3))), None, (99, 99), InputError, "finite coordinates to draw, found none among 0"),
        (PointCloud([[-1.7e308, 0, 0], [1.7e308, 0, 0]]), None, (99, 99), InputError, "a range that overflows"),
        (PointCloud(plane(2), {"name": list("abcd")}), "name", (99, 99), ParameterError, "attribute of numbers"),
        (PointCloud(plane()), None, (99, 1e3), ParameterError, "whole number from 64 on, found 1000.0"),
    ],
)
def test_what_cannot_be_drawn_is_refused(cloud, colour, size, error, message):
    with pytest.raises(error, match=message):
        draw_single(io.BytesIO(), cloud, colour=colour, size=size)
