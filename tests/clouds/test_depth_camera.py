"""Depth images become the points that a pinhole camera saw."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from gppcs import InputError, ParameterError, from_depth

KINECT = (525.0, 525.0, 319.5, 239.5)
ONE = np.ones((3, 4))


def matrix(fx, fy, cx, cy, skew=0.0):
    return np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def projected(points, K):
    """Return columns and rows, (N, 2), by K p = z (u, v, 1)."""
    seen = points @ K.T
    return seen[:, :2] / seen[:, 2:]


@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.tuples(st.integers(1, 12), st.integers(1, 12)),
    focal=st.tuples(st.floats(1.0, 2000.0), st.floats(1.0, 2000.0)),
    centre=st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)),
    skew=st.floats(-5.0, 5.0),
    scale=st.floats(1e-4, 1e3),
)
def test_points_project_onto_the_pixels_they_came_from(seed, shape, focal, centre, skew, scale):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.5, 10.0, shape)
    depth[rng.random(shape) < 0.3] = rng.choice([0.0, -1.0, np.nan, np.inf, -np.inf])
    depth[0, 0] = 1.0
    K = matrix(*focal, *centre, skew)
    cloud = from_depth(depth, K, scale=scale)
    seen = np.isfinite(depth) & (depth > 0.0)
    rows, columns = np.nonzero(seen)
    np.testing.assert_allclose(projected(cloud.points, K), np.column_stack([columns, rows]), rtol=0, atol=1e-9)
    np.testing.assert_array_equal(cloud.points[:, 2], depth[seen] * scale)


def test_colours_follow_their_pixels():
    rng = np.random.default_rng(1)
    depth = rng.integers(0, 3, (9, 11)).astype(np.uint16)
    colour = rng.integers(0, 256, (9, 11, 3), dtype=np.uint8)
    for given_colour in (colour, np.asfortranarray(colour), colour[..., ::-1][..., ::-1]):
        cloud = from_depth(depth, KINECT, given_colour)
        assert list(cloud.attributes) == ["red", "green", "blue"]
        for name, channel in zip(cloud.attributes, np.moveaxis(colour, -1, 0), strict=True):
            assert cloud.attributes[name].dtype == np.uint8
            np.testing.assert_array_equal(cloud.attributes[name], channel[depth > 0])
    cloud.attributes["red"][:] = 0
    assert colour[..., 0].any()  # the image is not the cloud's


def test_a_range_of_depths_is_in_the_units_of_the_cloud():
    depth = np.array([[500, 1000, 2000, 4000, 65535]], np.uint16)
    cloud = from_depth(depth, KINECT, scale=0.001, nearest=1.0, farthest=4.0)
    np.testing.assert_allclose(cloud.points[:, 2], [1.0, 2.0, 4.0])
    assert len(from_depth(depth, KINECT, nearest=-5.0)) == 5


@pytest.mark.parametrize(
    ("given_as", "kept"),
    [("u1", "f4"), ("<u2", "f4"), (">u2", "f4"), ("f2", "f4"), (">f4", "f4"), ("i4", "f8"), ("i8", "f8"), ("f8", "f8")],
)
def test_coordinates_have_a_type_that_holds_the_depth(given_as, kept):
    depth = np.arange(1, 13).reshape(3, 4).astype(given_as)
    before = depth.copy()
    cloud = from_depth(depth, KINECT, scale=0.001)
    assert cloud.coordinate_dtype == np.dtype(kept)
    np.testing.assert_array_equal(cloud.points, cloud.points.astype(kept))
    np.testing.assert_allclose(cloud.points[:, 2], np.arange(1, 13) * 0.001, rtol=1e-7)
    np.testing.assert_array_equal(depth, before)


def test_images_read_as_the_documentation_shows():
    from matplotlib.image import imread
    from PIL import Image

    depth = np.array([[0, 1, 400], [9000, 65534, 65535]], np.uint16)
    file = io.BytesIO()
    Image.fromarray(depth).save(file, format="png")
    file.seek(0)
    cloud = from_depth(imread(file) * 65535, KINECT)
    np.testing.assert_allclose(cloud.points[:, 2], depth[depth > 0], rtol=1e-6)


IMAGES = [
    ({"depth": np.ones((3, 4, 1))}, r"shape \(H, W\), found \(3, 4, 1\)"),
    ({"depth": ONE * 1j}, "real numbers in the depth image, found complex128"),
    ({"colour": np.zeros((3, 4), np.uint8)}, r"shape \(3, 4, 3\), as the depth image, found \(3, 4\)"),
    ({"colour": np.zeros((3, 4, 4), np.uint8)}, r"found \(3, 4, 4\); leave out alpha"),
    ({"colour": np.zeros((3, 4, 3))}, "colours of type uint8, 0 to 255, found float64"),
    ({"depth": np.zeros((3, 4))}, "found none in an image of 4 x 3"),
    ({"depth": [[1.0, 2.0], [1.0]]}, "rows of different lengths"),
    ({"nearest": 2.0, "farthest": 3.0}, r"from 2\.0 to 3\.0, found none in an image of 4 x 3; check scale"),
    ({"scale": 1e308, "farthest": np.inf}, "found some that overflow"),
]
PARAMETERS = [
    ({"intrinsics": 525.0}, r"shape \(3, 3\), or \(fx, fy, cx, cy\), found shape \(\)"),
    ({"intrinsics": "kinect"}, "expected numbers as intrinsics"),
    ({"intrinsics": [[1.0], [1.0, 2.0]]}, "expected numbers as intrinsics"),
    ({"intrinsics": (525.0, 0.0, 319.5, 239.5)}, "focal lengths above 0"),
    ({"intrinsics": (525.0, 525.0, np.nan, 239.5)}, "finite intrinsics"),
    ({"intrinsics": matrix(*KINECT).T}, "transpose it"),
    ({"intrinsics": [[525.0, 0.0, 319.5], [1e-3, 525.0, 239.5], [0.0, 0.0, 1.0]]}, "matrix of a pinhole camera"),
    ({"scale": 0.0}, "finite scale above 0, found 0.0"),
    ({"scale": np.nan}, "finite scale above 0"),
    ({"nearest": 2.0, "farthest": 1.0}, "at most farthest, found 2.0 and 1.0"),
    ({"nearest": np.nan}, "at most farthest"),
]


@pytest.mark.parametrize(
    ("error", "given", "message"),
    [*((InputError, *row) for row in IMAGES), *((ParameterError, *row) for row in PARAMETERS)],
)
def test_what_is_no_depth_image_or_camera_is_refused(error, given, message):
    with pytest.raises(error, match=message):
        from_depth(**{"depth": ONE.astype(np.float32), "intrinsics": KINECT, **given})


def test_masked_pixels_were_not_measured():
    depth = np.ma.masked_array(np.ones((3, 4)), mask=np.arange(12).reshape(3, 4) < 5)
    assert len(gppcs.from_depth(depth, (525, 525, 1, 1))) == 7
