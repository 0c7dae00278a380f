"""NumPy files of other makers, and what is refused."""

import numpy as np
import pytest

from gppcs.errors import FileFormatError
from gppcs.io import read


@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8", ">i2"])
def test_plain_arrays(tmp_path, dtype):
    path = tmp_path / "cloud.npy"
    array = np.arange(10).reshape(2, 5).astype(dtype)
    np.save(path, array)
    cloud = read(path)
    assert np.array_equal(cloud.points, array[:, :3])
    assert cloud.coordinate_dtype == np.dtype(dtype).newbyteorder("=")
    assert list(cloud.attributes) == ["column_4", "column_5"]
    assert cloud.attributes["column_5"].tolist() == [4, 9]
    assert cloud.attributes["column_5"].dtype.isnative
    assert cloud.attributes["column_5"].flags.c_contiguous


def test_structured_arrays(tmp_path):
    path = tmp_path / "cloud.npy"
    np.save(path, np.array([(9, 1, 2, 3, (4, 5))], [("a", ">i4"), *((c, "f4") for c in "xyz"), ("n", "f8", 2)]))
    cloud = read(path)
    assert cloud.points.tolist() == [[1, 2, 3]]
    assert list(cloud.attributes) == ["a", "n"]
    assert cloud.attributes["n"].tolist() == [[4, 5]]


def test_archives_hold_points_and_attributes(tmp_path):
    path = tmp_path / "cloud.npz"
    np.savez_compressed(path, label=np.array([7, 8]), points=np.zeros((2, 4), np.float32))
    cloud = read(path)
    assert cloud.coordinate_dtype == np.float32
    assert list(cloud.attributes) == ["column_4", "label"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (np.zeros(3), r"shape \(N, 3\).*found \(3,\)"),
        (np.zeros((3, 3), complex), "numbers as coordinates, found complex128"),
        (np.zeros(3, [("a", "f4")]), "x, y and z for each point, found 'a'"),
        (
            np.zeros(2, [("x", "f4", 2), ("y", "f4"), ("z", "f4")]),
            r"one x for each point, found shape \(2, 2\)",
        ),
        (np.full((1, 3), 2**60), "below 2"),
        (np.array([[None] * 3]), "Object arrays cannot be loaded"),
        ({"xyz": np.zeros((2, 3)), "a": np.zeros(2)}, "array 'points', found 'xyz', 'a'"),
        ({"points": np.zeros((2, 3)), "a": np.zeros(3)}, "attribute 'a'"),
        ({"points": np.zeros((2, 3)), "a": np.array(1)}, "attribute 'a' to have one row for each"),
        ({"points": np.zeros((2, 3)), "x": np.zeros(2)}, "'x' twice"),
    ],
)
def test_what_is_no_cloud_is_refused(tmp_path, content, message):
    path = tmp_path / "cloud"
    with path.open("wb") as file:
        np.savez(file, **content) if isinstance(content, dict) else np.save(file, content)
    with pytest.raises(FileFormatError, match=message):
        read(path)


@pytest.mark.parametrize(("name", "names"), [("kitti", ["intensity"]), ("nuscenes", ["intensity", "ring"])])
def test_bare_records(tmp_path, name, names):
    table = np.arange(2 * (3 + len(names)), dtype="<f4").reshape(2, -1) / 8
    table.tofile(tmp_path / "scan.bin")
    with pytest.raises(FileFormatError, match=r"`format='kitti'` or `format='points3d\.bin'`"):
        read(tmp_path / "scan.bin")
    cloud = read(tmp_path / "scan.bin", name)
    assert (cloud.points.tolist(), cloud.coordinate_dtype) == (table[:, :3].tolist(), np.float32)
    assert {key: values.tolist() for key, values in cloud.attributes.items()} == dict(
        zip(names, table[:, 3:].T.tolist(), strict=True)
    )
    table.ravel()[:-1].tofile(tmp_path / "scan.bin")
    with pytest.raises(FileFormatError, match="bytes behind the last"):
        read(tmp_path / "scan.bin", name)


@pytest.mark.parametrize(
    "content",
    [b"0.25 0.5 1 7\n" * 80, np.random.default_rng(0).bytes(800), np.linspace(0, 9, 100).tobytes(),
     np.full((50, 4), np.inf, "<f4").tobytes(), np.full((50, 4), 4e6, "<f4").tobytes()],
)  # fmt: skip
def test_bare_records_that_are_no_metres_are_refused(tmp_path, content):
    (tmp_path / "scan.bin").write_bytes(content)
    with pytest.raises(FileFormatError, match="metres"):
        read(tmp_path / "scan.bin", "kitti")
