"""What is written is read back, in every format and type; what a format cannot hold is refused or left out."""

import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from formats import WRITABLE, losses
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import OutputError
from gppcs.io import read, write

MULTIPLES = (".copc.laz", ".las", ".laz")  # hold coordinates as multiples of a scale
PLY_TYPES = ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"]
EVERY_TYPE = [*PLY_TYPES, "i8", "u8", "f2", "?"]
NAMES = st.text("abcXYZ_09é", min_size=1, max_size=8).filter(lambda name: name not in ("x", "y", "z", "_"))
ANY_NAME = st.text(min_size=1, max_size=5).filter(lambda name: name not in "xyzXYZ" and "\0" not in name)
E57_NAMES = st.sampled_from(["intensity", "red", "green", "row", "column", "nx", "ny", "nz", "time", "b_1"])
EXACT = {  # what comes back bit for bit: types of coordinates and of attributes, names, and how many numbers of each
    ".ply": (PLY_TYPES, PLY_TYPES, NAMES, [()]),
    ".pcd": (["f4", "f8"], [*PLY_TYPES, "i8", "u8"], NAMES, [(), (3,)]),
    ".npy": (EVERY_TYPE[:-1], EVERY_TYPE, NAMES, [(), (3,)]),
    ".npz": (EVERY_TYPE[:-1], EVERY_TYPE, NAMES, [(), (3,)]),
    ".e57": (["i4", "f4", "f8"], PLY_TYPES, E57_NAMES, [()]),
    ".parquet": (["i1", "u4", "f2", "f4", "f8"], EVERY_TYPE, ANY_NAME, [(), (1,), (3,)]),
    ".feather": (["i1", "u4", "f2", "f4", "f8"], EVERY_TYPE, ANY_NAME, [(), (1,), (3,)]),
}


def through(folder, cloud, suffix, **options):
    path = folder / f"cloud{suffix}"
    write(path, cloud, force=True, **options)
    return read(path)


def arrays(dtype, shape):
    """Arrays of finite numbers, whole ones within what float64 holds exactly."""
    dtype = np.dtype(dtype)
    if dtype.kind in "iu" and dtype.itemsize == 8:
        bounds = {"min_value": 0 if dtype.kind == "u" else -(2**53) + 1, "max_value": 2**53 - 1}
        return hnp.arrays(dtype, shape, elements=st.integers(**bounds))
    elements = hnp.from_dtype(dtype, allow_nan=False, allow_infinity=False) if dtype.kind == "f" else None
    return hnp.arrays(dtype, shape, elements=elements)


@pytest.mark.parametrize("suffix", EXACT)
@given(data=st.data())
def test_every_type_comes_back_bit_for_bit(folder, suffix, data):
    coordinates, types, names, shapes = EXACT[suffix]
    n = data.draw(st.integers(0, 5))
    points = data.draw(arrays(data.draw(st.sampled_from(coordinates)), (n, 3)))
    kinds = st.tuples(st.sampled_from(types), st.sampled_from(shapes))
    columns = kinds.flatmap(lambda kind: hnp.arrays(kind[0], (n, *kind[1])))  # also NaN and the largest whole numbers
    cloud = PointCloud(points, data.draw(st.dictionaries(names, columns, max_size=5)), points.dtype)
    assert losses(f"a{suffix}", cloud) == []
    again = through(folder, cloud, suffix)
    assert again.coordinate_dtype == points.dtype
    assert again.points.astype(points.dtype).tobytes() == points.tobytes()
    assert list(again.attributes) == list(cloud.attributes)
    for name, values in cloud.attributes.items():
        kept = again.attributes[name]
        assert (kept.dtype, kept.shape, kept.tobytes()) == (values.dtype, values.shape, values.tobytes())
        assert kept.dtype.isnative
        assert kept.flags.c_contiguous


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".xyz", ".csv"])
@given(data=st.data())
def test_text_keeps_values_and_their_order(folder, suffix, data):
    n = data.draw(st.integers(suffix in (".xyz", ".csv"), 6))
    points = data.draw(arrays(data.draw(st.sampled_from(EVERY_TYPE[:-1])), (n, 3)))
    names = data.draw(st.lists(NAMES, unique=True, max_size=3))
    cloud = PointCloud(points, {name: data.draw(arrays(data.draw(st.sampled_from(EVERY_TYPE)), n)) for name in names})
    assume(n)
    options = {"ascii": True} if suffix in (".ply", ".pcd") else {}
    again = through(folder, cloud, suffix, **options)
    assert np.array_equal(again.points, cloud.points)
    assert list(again.attributes) == names
    for name, values in cloud.attributes.items():
        assert np.array_equal(again.attributes[name].astype(values.dtype), values)
    if options:
        binary = through(folder, cloud, suffix)
        assert binary == again
        assert all(values.dtype == again.attributes[name].dtype for name, values in binary.attributes.items())


@pytest.mark.parametrize("count", [0, 65_537])  # none, and more than a block of rows
@pytest.mark.parametrize("suffix", WRITABLE)
def test_any_number_of_points_comes_back(folder, suffix, count):
    points, intensity = np.arange(3.0 * count).reshape(-1, 3), np.arange(count) % 999
    again = through(folder, PointCloud(points, {"intensity": intensity}), suffix, lossy=True)
    if suffix == ".copc.laz":  # sorted by levels
        again = again.take(np.argsort(again.points[:, 0]))
    assert np.array_equal(again.points, points)
    if count and suffix not in (".obj", ".off", ".points3d.txt", ".points3d.bin"):
        assert np.array_equal(again.attributes["intensity"], intensity)
    other = np.repeat(intensity.astype(">i8"), 2)[::2]  # another order of bytes, and a stride
    found = through(folder, PointCloud(points, {"intensity": other}), suffix, lossy=True)
    assert found.take(np.argsort(found.points[:, 0])) == again


@pytest.mark.parametrize("suffix", WRITABLE)
def test_coordinates_that_are_not_finite_are_kept_or_refused(folder, suffix):
    points = np.array([[0.5, np.nan, 1], [np.inf, -np.inf, -0.0]])
    if suffix in MULTIPLES:
        with pytest.raises(OutputError, match="finite"):
            through(folder, PointCloud(points), suffix)
    else:
        again = through(folder, PointCloud(points), suffix)
        assert np.array_equal(again.points, points, equal_nan=True)
        assert np.signbit(again.points[1, 2])


@pytest.mark.parametrize("suffix", WRITABLE)
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("none", np.zeros((2, 0))),
        ("thing", np.array([None, "b"], dtype=object)),
        ("a:b", np.arange(2.0)),
        ("label", np.array(["a", "b"])),
        ("pair", np.arange(4.0).reshape(2, 2)),
    ],
)
def test_attributes_are_kept_or_named(folder, suffix, name, values):
    cloud, path = PointCloud(np.eye(3)[:2], {name: values}), folder / f"cloud{suffix}"
    fits = all("becomes" in message for message in losses(path, cloud)) or "become" in losses(path, cloud)[0]
    if not fits:
        kind = "text" if values.dtype.kind == "U" else values.dtype
        assert losses(path, cloud) == [f"attribute {name} ({kind})"]
        path.unlink(missing_ok=True)
        with pytest.raises(OutputError, match=f"cannot hold: attribute {name}"):
            write(path, cloud)
        assert not path.exists()
    again = through(folder, cloud, suffix, lossy=True).attributes
    assert (name in again or f"{name}_1" in again) == fits
    assert name not in again or np.array_equal(again[name], values)


@pytest.mark.parametrize("suffix", [".ply", ".csv", ".npy", ".npz"])
@pytest.mark.parametrize("name", ["", "a\0b", "\ud800", "n" * 70_000, "../up", "a/", ".npy", "file", "#", "new\nline"])
def test_strange_names_of_attributes_are_kept_or_refused(tmp_path, suffix, name):
    cloud = PointCloud(np.zeros((2, 3)), {name: np.arange(2)})
    written = re.sub(r"\s", "_", name) or "_" if suffix in (".ply", ".csv") else name
    if written in ("", "a\0b", "\ud800", "n" * 70_000):
        with pytest.raises(OutputError, match="expected a name of 1 to 1,000 characters"):
            write(tmp_path / f"cloud{suffix}", cloud)
        assert not any(tmp_path.iterdir())
    else:
        write(tmp_path / f"cloud{suffix}", cloud)
        assert list(read(tmp_path / f"cloud{suffix}").attributes) == [written]
        renamed = [] if written == name else [f"the name {name!a} (it becomes {written})"]
        assert losses(f"cloud{suffix}", cloud) == renamed


@pytest.mark.parametrize("suffix", WRITABLE)
def test_no_two_columns_of_a_file_have_one_name(tmp_path, suffix):
    one, two = np.zeros(1), np.zeros((1, 2))
    path = tmp_path / f"cloud{suffix}"
    for attributes in ({"x": one}, {"a b": one, "a_b": one}, {"n": two, "n_0": one}, {"a": one, "a.npy": one}):
        try:
            write(path, PointCloud(np.zeros((1, 3)), attributes))
        except OutputError as error:
            assert re.search("twice|different names|cannot hold", str(error))  # noqa: PT017
            assert not path.exists()
        else:
            assert "x" not in attributes
            assert set(read(path).attributes) >= set(attributes)
            path.unlink()


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".pts"])
@pytest.mark.parametrize("full", [1, 255])
def test_floats_that_bytes_hold_become_bytes_as_colours(tmp_path, suffix, full):
    colours = {name: np.array([0, 117, 51 + k]) * (full / 255) for k, name in enumerate(("red", "green", "blue"))}
    write(tmp_path / f"a{suffix}", PointCloud(np.eye(3), colours))
    found = read(tmp_path / f"a{suffix}").attributes
    assert {str(values.dtype) for values in found.values()} == {"uint8"}
    assert found["blue"].tolist() == [0, 117, 53]
    fractions = dict.fromkeys(colours, np.array([0.1, 0.25, 1]))
    if suffix != ".pts":
        write(tmp_path / f"a{suffix}", PointCloud(np.eye(3), fractions), force=True)
        assert read(tmp_path / f"a{suffix}").attributes["red"].tolist() == [0.1, 0.25, 1]
