"""The cloud keeps what it is given, and refuses what does not fit."""

import numpy as np
import pytest

import gppcs
from gppcs import InputError, PointCloud

POINTS = np.arange(12.0).reshape(4, 3)


@pytest.mark.parametrize(
    ("make", "points", "message"),
    [
        (PointCloud.from_object, POINTS[:, :1], r"shape \(N, 3\), found \(4, 1\)"),
        (PointCloud.from_object, POINTS[np.newaxis], r"found \(1, 4, 3\); gppcs.simplify_batch"),
        (PointCloud.from_object, [], r"shape \(N, 3\), found \(0,\)"),
        (PointCloud.from_object, None, r"expected a PointCloud, .* or an \(N, 3\) array of coordinates, found None"),
        (PointCloud.from_object, POINTS * 1j, "found an array of complex128"),
        (PointCloud.from_object, [[1, 2], [3]], r"an \(N, 3\) array of coordinates, found list"),
        (PointCloud, None, r"expected points of shape \(N, 3\), found None$"),
        (PointCloud, POINTS[:, :1], r"found \(4, 1\)$"),
        (PointCloud, np.ones((9, 4)), r"found \(9, 4\); pass .*\(points\[:, :3\], {'intensity': points\[:, 3\]}\)$"),
        (PointCloud, np.ones((3, 9)), r"found \(3, 9\); transpose .*points\.T$"),
        (lambda points: PointCloud(points, {"label": np.zeros(3)}), POINTS,
         r"attribute 'label' to have one row for each of the 4 points.*\(3,\)"),
    ],
)  # fmt: skip
def test_what_is_no_cloud_is_refused(make, points, message):
    with pytest.raises(InputError, match=message):
        make(points)


@pytest.mark.parametrize(
    ("dtype", "kept"), [("f4", "f4"), ("f8", "f8"), ("f2", "f2"), ("i4", "f8"), ("u1", "f8"), (">f4", ">f4")]
)
def test_arrays_become_float64_and_floats_remember_their_type(dtype, kept):
    cloud = PointCloud.from_object(POINTS.astype(dtype))
    assert cloud.points.dtype == np.float64
    assert cloud.coordinate_dtype == np.dtype(kept)
    np.testing.assert_array_equal(cloud.points, POINTS)


@pytest.mark.parametrize("make", [PointCloud, PointCloud.from_object])
@pytest.mark.parametrize("dtype", [np.float64, np.int32])
def test_two_columns_are_a_cloud_of_the_plane(make, dtype):
    flat = POINTS[:, :2].astype(dtype)
    assert make(flat).points.tolist() == [[x, y, 0.0] for x, y in flat.tolist()]


def test_points_in_a_plane_are_chosen_by_where_they_lie_alone():
    angles = np.linspace(0.0, 2.0 * np.pi, 500, endpoint=False)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    chosen = np.sort(gppcs.simplify(ring, n_points=10, method="fps").indices)
    assert np.ptp(np.diff(chosen)) <= 40  # spread around the ring, of which each has a tenth
    assert gppcs.info(ring).diagonal == pytest.approx(np.sqrt(8.0), rel=1e-3)


@pytest.mark.parametrize("dtype", ["f4", "i4", ">f8"])
def test_masked_points_are_invalid(dtype):
    points, masked = POINTS.astype(dtype), np.ma.array(POINTS, dtype, mask=np.arange(12).reshape(4, 3) % 5 == 0)
    expected = np.where(masked.mask, np.nan, points)
    fields = np.ma.array([(*row, 7) for row in points], [(name, dtype) for name in "xyzl"], mask=False)
    fields["x"], fields["l"][2] = masked[:, 0], np.ma.masked
    for made in (PointCloud(masked), PointCloud.from_object(masked)):
        np.testing.assert_array_equal(made.points, expected)
    cloud = PointCloud.from_object(fields)
    np.testing.assert_array_equal(cloud.points[:, 0], expected[:, 0])
    np.testing.assert_array_equal(cloud.attributes["l"], [7, 7, np.nan, 7])
    whole = np.ma.array(POINTS.astype(dtype))
    assert PointCloud.from_object(whole) == PointCloud.from_object(points)
    cloud = PointCloud(np.random.default_rng(0).random((4, 3)))
    with pytest.raises(gppcs.ParameterError, match="expected keep"):
        gppcs.simplify(cloud, n_points=2, keep=np.ma.array([True] * 4, mask=[1, 0, 0, 0]))
    with pytest.raises(gppcs.GppcsError, match="weight"):
        gppcs.simplify(cloud, n_points=2, weight=np.ma.array([1.0] * 4, mask=[1, 0, 0, 0]))


CLOUD = PointCloud(POINTS, {"colour": np.eye(4, dtype=np.uint8), "label": np.arange(4, dtype=">i2")}, np.dtype("f4"))


def test_a_cloud_is_an_array_of_its_points():
    assert np.asarray(CLOUD) is CLOUD.points
    assert np.asarray(CLOUD, dtype=np.float32).dtype == np.float32
    assert len(CLOUD) == 4
    np.testing.assert_array_equal(np.mean(CLOUD, axis=0), POINTS.mean(axis=0))
    assert not np.shares_memory(np.array(CLOUD), CLOUD.points)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (slice(None, None, 2), [0, 2]),
        (slice(9, None), []),
        ([3, 0, 0], [3, 0, 0]),
        (np.array([-1]), [3]),
        ([], []),
        ([True, False, False, True], [0, 3]),
        (POINTS[:, 2] > 3, [1, 2, 3]),
    ],
)
def test_rows_of_a_cloud_are_a_cloud_with_all_attributes(rows, expected):
    part, indices = CLOUD[rows], np.array(expected, dtype=np.int64)
    attributes = {"colour": np.eye(4, dtype=np.uint8)[indices], "label": np.arange(4, dtype=">i2")[indices]}
    assert part == CLOUD.take(indices) == PointCloud(POINTS[indices], attributes, np.float32)
    assert not np.shares_memory(part.points, CLOUD.points)


def test_one_row_and_a_loop_give_coordinates():
    np.testing.assert_array_equal(CLOUD[1], POINTS[1])
    np.testing.assert_array_equal(CLOUD[np.int64(-1)], POINTS[3])
    np.testing.assert_array_equal(np.stack(list(CLOUD)), POINTS)


@pytest.mark.parametrize(
    "rows", ["label", None, 1.5, [0.5], True, (0, 1), (slice(None), 2), [[0, 1]], ..., np.array(["a"])]
)
def test_what_names_no_rows_is_a_type_error(rows):
    with pytest.raises(TypeError, match=r"expected a slice, a mask or indices of points, found .*attributes"):
        CLOUD[rows]
