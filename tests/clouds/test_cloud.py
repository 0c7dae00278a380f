"""The cloud keeps what it is given, and refuses what does not fit."""

import numpy as np
import pytest

from gppcs import InputError, PointCloud

POINTS = np.arange(12.0).reshape(4, 3)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (POINTS[:, :2], r"shape \(N, 3\), found \(4, 2\)"),
        (POINTS[0], r"shape \(N, 3\), found \(3,\)"),
        (POINTS[None], r"shape \(N, 3\), found \(1, 4, 3\)"),
        ([], r"shape \(N, 3\), found \(0,\)"),
        (None, r"shape \(N, 3\)"),
        ("scan.ply", r"shape \(N, 3\)"),
        ([["a", "b", "c"]], "expected numbers as coordinates"),
        (POINTS * 1j, "found an array of complex128"),
        (POINTS > 3, "found an array of bool"),
        (POINTS.astype(object), "found an array of object"),
        ([[1, 2], [3]], r"an \(N, 3\) array of coordinates, found list"),
    ],
)
def test_what_is_no_cloud_is_refused(points, message):
    with pytest.raises(InputError, match=message):
        PointCloud.of(points)


def test_attributes_must_have_a_row_for_each_point():
    with pytest.raises(InputError, match=r"attribute 'label' to have one row for each of the 4 points.*\(3,\)"):
        PointCloud(POINTS, {"label": np.zeros(3)})


@pytest.mark.parametrize(
    ("dtype", "kept"), [("f4", "f4"), ("f8", "f8"), ("f2", "f2"), ("i4", "f8"), ("u1", "f8"), (">f4", ">f4")]
)
def test_arrays_become_float64_and_floats_remember_their_type(dtype, kept):
    cloud = PointCloud.of(POINTS.astype(dtype))
    assert cloud.points.dtype == np.float64
    assert cloud.coordinate_dtype == np.dtype(kept)
    np.testing.assert_array_equal(cloud.points, POINTS)


def test_a_cloud_is_taken_as_it_is():
    cloud = PointCloud(POINTS)
    assert PointCloud.of(cloud) is cloud


def test_take_keeps_order_attributes_and_types():
    cloud = PointCloud(POINTS, {"colour": np.eye(4, dtype=np.uint8)}, np.dtype(np.float32))
    taken = cloud.take(np.array([3, 0]))
    np.testing.assert_array_equal(taken.points, POINTS[[3, 0]])
    np.testing.assert_array_equal(taken.attributes["colour"], np.eye(4)[[3, 0]])
    assert taken.attributes["colour"].dtype == np.uint8
    assert taken.coordinate_dtype == np.float32
    assert len(taken) == 2


def test_non_finite_points_are_found():
    points = POINTS.copy()
    points[1, 2], points[3, 0] = np.nan, -np.inf
    assert PointCloud(points).non_finite().tolist() == [1, 3]
