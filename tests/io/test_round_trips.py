"""What is written is read back, in every format and type; damaged files bring our own errors only."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gppcs.clouds.cloud import PointCloud
from gppcs.io import FORMATS, read, write

WRITABLE = [known.suffixes[0] for known in FORMATS if known.write is not None]
FLOATING = [
    suffix for suffix in WRITABLE if suffix not in (".copc.laz", ".las", ".laz")
]  # these hold multiples of a scale
PLY_TYPES = ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"]
NAMES = st.text("abcXYZ_09é", min_size=1, max_size=8).filter(lambda name: name not in "xyz")


EVERY_TYPE = [*PLY_TYPES, "i8", "u8", "f2", "?"]
E57_NAMES = ["intensity", "red", "green", "blue", "row", "column", "nx", "ny", "nz", "time", "a", "b_1"]
ANY_NAME = st.text(min_size=1, max_size=5).filter(lambda name: name not in "xyzXYZ" and "\0" not in name)
HELD = {  # what comes back bit for bit: types of coordinates and of attributes, names, and how many numbers each has
    ".ply": (PLY_TYPES, PLY_TYPES, NAMES, [()]),
    ".npy": (EVERY_TYPE[:-1], EVERY_TYPE, NAMES, [(), (3,)]),
    ".npz": (EVERY_TYPE[:-1], EVERY_TYPE, NAMES, [(), (3,)]),
    ".e57": (["i4", "f4", "f8"], PLY_TYPES, st.sampled_from(E57_NAMES), [()]),
    ".parquet": (["i1", "u4", "f2", "f4", "f8"], EVERY_TYPE, ANY_NAME, [(), (1,), (3,)]),
    ".feather": (["i1", "u4", "f2", "f4", "f8"], EVERY_TYPE, ANY_NAME, [(), (1,), (3,)]),
}


def arrays(dtype, shape):
    """Arrays of finite numbers, whole ones within what float64 holds exactly."""
    dtype = np.dtype(dtype)
    if dtype.kind in "iu" and dtype.itemsize == 8:
        bounds = {"min_value": 0 if dtype.kind == "u" else -(2**53) + 1, "max_value": 2**53 - 1}
        return hnp.arrays(dtype, shape, elements=st.integers(**bounds))
    if dtype.kind == "f":
        elements = hnp.from_dtype(dtype, allow_nan=False, allow_infinity=False)
        return hnp.arrays(dtype, shape, elements=elements)
    return hnp.arrays(dtype, shape)


@st.composite
def clouds(draw, types, least=0):
    """Clouds whose coordinates and attributes have any of these types."""
    n = draw(st.integers(least, 6))
    points = draw(arrays(draw(st.sampled_from([t for t in types if t != "?"])), (n, 3)))
    names = draw(st.lists(NAMES, unique=True, max_size=3))
    attributes = {name: draw(arrays(draw(st.sampled_from(types)), n)) for name in names}
    return PointCloud(points, attributes, points.dtype)


@pytest.mark.parametrize("suffix", HELD)
@given(data=st.data())
def test_every_type_comes_back_bit_for_bit(folder, suffix, data):
    coordinates, types, names, shapes = HELD[suffix]
    n = data.draw(st.integers(0, 5))
    points = data.draw(arrays(data.draw(st.sampled_from(coordinates)), (n, 3)))
    each = st.tuples(st.sampled_from(types), st.sampled_from(shapes))
    each = each.flatmap(lambda kind: hnp.arrays(kind[0], (n, *kind[1])))  # also NaN and the largest whole numbers
    cloud = PointCloud(points, data.draw(st.dictionaries(names, each, max_size=5)), points.dtype)
    found = through(folder, cloud, suffix)
    assert found.coordinate_dtype == points.dtype
    assert found.points.astype(points.dtype).tobytes() == points.tobytes()
    assert list(found.attributes) == list(cloud.attributes)
    for name, values in cloud.attributes.items():
        kept = found.attributes[name]
        assert (kept.dtype, kept.shape, kept.tobytes()) == (values.dtype, values.shape, values.tobytes())
        assert kept.dtype.isnative
        assert kept.flags.c_contiguous


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("round_trips")


def through(folder, cloud, suffix, **options):
    path = folder / f"cloud{suffix}"
    write(path, cloud, force=True, **options)
    return read(path)


def assert_same_values(found, expected):
    kept = expected.coordinate_dtype
    assert np.array_equal(found.points.astype(kept), expected.points.astype(kept))
    assert list(found.attributes) == list(expected.attributes)
    for name, values in expected.attributes.items():
        assert np.array_equal(found.attributes[name].astype(values.dtype), values)


def assert_same(found, expected):
    assert_same_values(found, expected)
    assert found.coordinate_dtype == expected.coordinate_dtype
    for name, values in expected.attributes.items():
        assert found.attributes[name].dtype == values.dtype
        assert found.attributes[name].dtype.isnative
        assert found.attributes[name].flags.c_contiguous


@given(cloud=clouds([*PLY_TYPES, "i8", "u8", "f2", "?"]))
@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_text_holds_what_binary_data_does(folder, cloud, suffix):
    assume("_" not in cloud.attributes)
    paths = {choice: folder / f"{choice}{suffix}" for choice in (True, False)}
    for choice, path in paths.items():
        write(path, cloud, force=True, ascii=choice)
    assert_same(read(paths[True]), read(paths[False]))
    header = paths[True].read_bytes()
    assert b"format ascii 1.0" in header or b"DATA ascii" in header
    write(paths[False], read(paths[True]), force=True, ascii=False)
    again = paths[False].read_bytes()
    assert b"format binary_little_endian 1.0" in again or b"DATA binary" in again
    assert_same(read(paths[False]), read(paths[True]))


@given(cloud=clouds([*PLY_TYPES, "i8", "u8", "f2", "?"]))
@pytest.mark.parametrize("suffix", [".xyz", ".csv", ".ply"])
def test_types_that_a_format_has_not_keep_their_values(folder, cloud, suffix):
    assert_same_values(through(folder, cloud, suffix), cloud)


@given(cloud=clouds(["i8", "f8"], least=1))
@pytest.mark.parametrize("suffix", [".txt", ".asc", ".csv"])
def test_text_keeps_whole_numbers_whole_and_floats_floats(folder, cloud, suffix):
    assert_same(through(folder, cloud, suffix), cloud)


@pytest.mark.parametrize("count", [0, 65_537])  # none, and more than a block of rows
@pytest.mark.parametrize("suffix", WRITABLE)
def test_any_number_of_points_comes_back(folder, suffix, count):
    points = np.arange(3.0 * count).reshape(-1, 3)
    cloud = PointCloud(points, {"intensity": np.arange(count) % 999})
    found = through(folder, cloud, suffix, lossy=True)
    assert np.array_equal(found.points, points)
    if count and suffix not in (".obj", ".off", ".points3d.txt", ".points3d.bin"):
        assert np.array_equal(found.attributes["intensity"], np.arange(count) % 999)
    first = (folder / f"cloud{suffix}").read_bytes()
    write(folder / f"cloud{suffix}", cloud, force=True, lossy=True)
    assert (folder / f"cloud{suffix}").read_bytes() == first


@pytest.mark.parametrize("suffix", FLOATING)
def test_not_finite_coordinates_are_read_as_they_are(folder, suffix):
    points = np.array([[0.5, np.nan, 1], [np.inf, -np.inf, -0.0]])
    found = through(folder, PointCloud(points), suffix)
    assert np.array_equal(found.points, points, equal_nan=True)
    assert np.signbit(found.points[1, 2])


def test_attributes_of_several_numbers_are_spread(folder):
    normal = np.arange(6.0).reshape(2, 3)
    cloud = PointCloud(np.zeros((2, 3)), {"normal": normal})
    assert np.array_equal(through(folder, cloud, ".npy").attributes["normal"], normal)
    assert np.array_equal(through(folder, cloud, ".npz").attributes["normal"], normal)
    for suffix in (".ply", ".csv"):
        spread = through(folder, cloud, suffix).attributes
        assert list(spread) == ["normal_0", "normal_1", "normal_2"]
        assert np.array_equal(np.column_stack(list(spread.values())), normal)


@pytest.mark.parametrize("suffix", WRITABLE)
def test_attributes_of_other_byte_orders_and_strides_are_the_same(folder, suffix):
    plain = {"intensity": np.arange(6, dtype=np.int32), "nx": np.arange(6.0)}
    other = {"intensity": plain["intensity"].astype(">i4"), "nx": np.repeat(plain["nx"], 2)[::2]}
    both = [through(folder, PointCloud(np.eye(6, 3), each), suffix, lossy=True) for each in (plain, other)]
    assert_same(*both)
