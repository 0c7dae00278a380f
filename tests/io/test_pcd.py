"""PCD files of every encoding, type and version, packed colours, and damage."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from formats import lzf
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, OutputError
from gppcs.io import read, write

TYPES = ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8"]
ENCODINGS = ["ascii", "binary", "binary_compressed"]
XYZ = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])


def content(table, encoding, lines=(), compress=lzf, **changes):
    """A PCD file of a structured array; `changes` are other words for lines of the header, None to leave one out."""
    fields = [(name.rstrip("0") if name.startswith("_") else name, *sub) for name, sub in (
        (name, table.dtype[name].subdtype or (table.dtype[name], ())) for name in table.dtype.names)]  # fmt: skip
    header = {
        "VERSION": "0.7",
        "FIELDS": " ".join(name for name, _, _ in fields),
        "SIZE": " ".join(str(dtype.itemsize) for _, dtype, _ in fields),
        "TYPE": " ".join(dtype.kind.upper() for _, dtype, _ in fields),
        "COUNT": " ".join(str(shape[0] if shape else 1) for _, _, shape in fields),
        "WIDTH": len(table),
        "HEIGHT": 1,
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": len(table),
        "DATA": encoding,
        **changes,
    }
    start = ["# .PCD v0.7 - Point Cloud Data file format", *lines]
    start += [f"{keyword} {words}" for keyword, words in header.items() if words is not None]
    head = ("\n".join(start) + "\n").encode()
    if encoding == "ascii":
        rows = ([repr(value) for name in table.dtype.names for value in np.ravel(row[name]).tolist()] for row in table)
        return head + "".join(" ".join(row) + "\n" for row in rows).encode()
    if encoding == "binary":
        return head + table.tobytes()
    data = b"".join(table[name].tobytes() for name in table.dtype.names)
    packed = compress(data)
    return head + struct.pack("<II", len(packed), len(data)) + packed


@st.composite
def tables(draw):
    """Structured arrays with coordinates, fields of each type and count, and padding."""
    names = draw(st.lists(st.sampled_from(["a", "normal_x", "é", "_0", "_00"]), unique=True))
    shapes = st.sampled_from([(), (2,), (5,)])
    fields = [(name, "<" + draw(st.sampled_from(TYPES)), draw(shapes)) for name in names]
    axes = [(axis, draw(st.sampled_from(["<f4", "<f8"]))) for axis in "xyz"]
    dtype = np.dtype(draw(st.permutations([*fields, *axes])))
    return draw(hnp.arrays(dtype, st.integers(0, 5)))


@pytest.mark.parametrize("encoding", ENCODINGS)
@given(table=tables())
def test_every_type_and_count_is_read_bit_for_bit(folder, encoding, table):
    if encoding == "ascii":  # text has only one NaN
        for name in table.dtype.names:
            if table[name].dtype.kind == "f":
                table[name][np.isnan(table[name])] = np.nan
    path = folder / "cloud.pcd"
    path.write_bytes(content(table, encoding))
    cloud = read(path)
    assert cloud.coordinate_dtype == np.result_type(*(table[axis] for axis in "xyz"))
    for i, axis in enumerate("xyz"):
        assert np.array_equal(cloud.points[:, i], table[axis], equal_nan=True)
    names = [name for name in table.dtype.names if name not in "xyz" and not name.startswith("_")]
    assert list(cloud.attributes) == names
    for name in names:
        found = cloud.attributes[name]
        assert found.dtype == table[name].dtype
        assert found.dtype.isnative
        assert found.flags.c_contiguous
        assert found.shape == table[name].shape
        assert found.tobytes() == table[name].tobytes()


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"\x05abcdef\x80\x05", b"abcdef" * 2),  # 6 bytes from 6 bytes before
        (b"\x00a\xe0\xfe\x00", b"a" * 264),  # a copy of its own beginning
        (b"\x01ab\xe0\x01\x01", b"ab" * 6),
        (b"\x02ab", None),
        (b"\x00a\x20", None),
        (b"\x00a\xe0", None),
        (b"\x00a", None),
        (b"", None),
    ],
)
def test_compressed_data_is_expanded_or_refused(file_of, data, expected):
    table = np.frombuffer(expected or bytes(24), XYZ)
    path = file_of(".pcd", content(table, "binary_compressed", compress=lambda _: data))
    if expected:
        columns = np.frombuffer(expected, "<f4").reshape(3, -1)
        assert np.array_equal(read(path).points, columns.T)
        return
    with pytest.raises(FileFormatError, match="expected 24 bytes of points in LZF compression, found damaged"):
        read(path)


@pytest.mark.parametrize("dtype", ["<f4", "<u4", "<i4"])
@pytest.mark.parametrize("name", ["rgb", "rgba"])
@pytest.mark.parametrize("encoding", ENCODINGS[1:])
def test_packed_colours_come_apart_and_together_again(file_of, tmp_path, name, dtype, encoding):
    packed = np.random.default_rng(0).integers(0, 2**32, 50, dtype=np.uint32)
    packed[:4] = [0x7F800001, 0xFFC12345, 0x7FFFFFFF, 0x00000001]  # as floats: NaN with a payload, and denormal
    table = np.zeros(50, [*XYZ.descr, ("a", "u1"), (name, dtype), ("b", "u1")])
    table[name] = packed.view(dtype)
    cloud = read(file_of(".pcd", content(table, encoding)))
    channels = ["red", "green", "blue", "alpha"][: len(name)]
    assert list(cloud.attributes) == ["a", *channels, "b"]
    for channel, shift in zip(channels, (16, 8, 0, 24), strict=False):
        assert cloud.attributes[channel].dtype == np.uint8
        assert np.array_equal(cloud.attributes[channel], packed >> shift & 255)
    for ascii in (False, True):  # noqa: A001
        write(tmp_path / "again.pcd", cloud, ascii=ascii, force=True)
        assert read(tmp_path / "again.pcd") == cloud


def test_colours_are_packed_as_other_programs_expect(tmp_path):
    colours = {
        name: np.array([value], np.uint8) for name, value in zip(["red", "green", "blue"], (1, 2, 3), strict=True)
    }
    write(tmp_path / "rgb.pcd", PointCloud([[0, 0, 0]], colours))
    assert b"FIELDS x y z rgb\nSIZE 8 8 8 4\nTYPE F F F F\n" in (tmp_path / "rgb.pcd").read_bytes()
    assert (tmp_path / "rgb.pcd").read_bytes().endswith(bytes([3, 2, 1, 0]))
    write(tmp_path / "text.pcd", PointCloud([[0, 0, 0]], colours), ascii=True)
    assert (tmp_path / "text.pcd").read_text().endswith(f"DATA ascii\n0.0 0.0 0.0 {0x010203}\n")
    write(tmp_path / "rgba.pcd", PointCloud([[0, 0, 0]], {**colours, "alpha": np.array([0], np.uint8)}))
    assert b"FIELDS x y z rgba\nSIZE 8 8 8 4\nTYPE F F F U\n" in (tmp_path / "rgba.pcd").read_bytes()
    with pytest.raises(OutputError, match="'rgb' twice"):
        write(tmp_path / "twice.pcd", PointCloud([[0, 0, 0]], {**colours, "rgb": np.zeros(1)}))
    assert not (tmp_path / "twice.pcd").exists()


@pytest.mark.parametrize(
    "changes",
    [
        {"VERSION": ".7"},
        {"VERSION": ".5", "COUNT": None, "VIEWPOINT": None, "POINTS": None},
        {"VERSION": None},
    ],
)
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_older_headers(file_of, changes, end):
    data = content(np.arange(6, dtype="f4").view(XYZ), "ascii", **changes)
    cloud = read(file_of(".pcd", data.replace(b"\n", end)))
    assert cloud.points.tolist() == [[0, 1, 2], [3, 4, 5]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"FIELDS": "x y"}, "each of different FIELDS, but numpy reports: "),
        ({"FIELDS": "x y x"}, "each of different FIELDS, but numpy reports: "),
        ({"FIELDS": "a b c"}, "x, y and z for each point, found 'a', 'b', 'c'"),
        ({"SIZE": "4 4 3"}, "numpy reports: "),
        ({"SIZE": None}, "numpy reports: KeyError 'SIZE'"),
        ({"TYPE": "F F C"}, "TYPE F, I or U, and COUNT from 1 on, found 'C' and '1'"),
        ({"COUNT": "1 1 -1"}, "COUNT from 1 on, found 'F' and '-1'"),
        ({"COUNT": "1 1 0"}, "COUNT from 1 on, found 'F' and '0'"),
        ({"COUNT": "1 1 2", "WIDTH": 1, "POINTS": 1}, r"one z for each point, found shape \(1, 2\)"),
        ({"COUNT": "1 1 1000000000"}, "each of different FIELDS, but numpy reports: "),
        ({"WIDTH": "many"}, "whole numbers as WIDTH and HEIGHT, found 'many'"),
        ({"WIDTH": 10**18 - 1}, "ends in point 3 of"),
        ({"WIDTH": 10**18 - 1, "HEIGHT": 10**18 - 1, "POINTS": None}, "ends in point 3 of"),
        ({"DATA": "zip"}, "DATA to be ascii, binary or binary_compressed, found 'zip'"),
        ({"DATA": None}, "expected lines of keywords up to DATA"),
        ({"EXTRA": "1"}, "expected"),
    ],
)
def test_malformed_headers_tell_what_is_wrong(file_of, changes, message):
    data = content(np.full(2, 1, XYZ), "binary", **changes)
    if "EXTRA" in changes:
        data = data.replace(b"DATA binary\nEXTRA 1\n", b"EXTRA 1\nDATA binary\n")
    with pytest.raises(FileFormatError, match=message):
        read(file_of(".pcd", data))


@pytest.mark.parametrize(("x", "kind"), [("665187.52", np.float64), ("665187.5", np.float32), ("0.1", np.float32)])
def test_text_keeps_the_digits_of_coordinates_that_float32_does_not_hold(file_of, x, kind):
    """All axes have them if one needs them."""
    rows = f"{x} 170.76 0\n{float(x) + 100} 0.5 1\n"
    cloud = read(file_of(".pcd", content(np.zeros(0, XYZ), "ascii", WIDTH=2, POINTS=2) + rows.encode()))
    assert cloud.coordinate_dtype == kind
    assert cloud.points[0, :2].tolist() == [kind(x), kind(170.76)]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1 2 3 256 0", "uint8 as a of point 2, found '256'"),
        ("1 2 3 0.5 0", "uint8 as a of point 2, found '0.5'"),
        ("1 2 3 0 9223372036854775808", "int64 as b of point 2, found '9223372036854775808'"),
        ("1 2 3 0 -1e30", "int64 as b of point 2, found '-1e.30'"),
        ("1 2 3 0 0 5", "point 2: expected 5 columns"),
    ],
)
def test_bad_rows_of_text_tell_what_and_where(file_of, row, message):
    data = content(np.zeros(1, [*XYZ.descr, ("a", "u1"), ("b", "<i8")]), "ascii", WIDTH=2, POINTS=2)
    with pytest.raises(FileFormatError, match=message):
        read(file_of(".pcd", data + row.encode() + b"\n"))


@pytest.mark.parametrize(
    ("sizes", "message"),
    [
        ((9, 25), "expected 24 bytes of points .* found 25"),
        ((2**32 - 1, 24), "found 24 in 4294967295 announced"),
        ((5, 24), "damaged data"),
    ],
)
def test_lies_before_compressed_data_are_refused(file_of, sizes, message):
    data = content(np.zeros(2, XYZ), "binary_compressed", compress=lambda data: lzf(data[:8]))
    head = data[: data.index(b"compressed\n") + 11]
    with pytest.raises(FileFormatError, match=message):
        read(file_of(".pcd", head + struct.pack("<II", *sizes) + lzf(bytes(8))))


@pytest.mark.parametrize("name", ["rgb", "rgba"])
def test_attributes_with_the_names_of_packed_colours_or_padding(tmp_path, name):
    path = tmp_path / "cloud.pcd"
    narrow = PointCloud(np.eye(3), {name: np.array([1, 2, 3], np.int32)})
    with pytest.raises(OutputError, match=f"PCD cannot hold: attribute {name}"):
        write(path, narrow)
    with pytest.raises(OutputError, match="other than '_'"):
        write(path, PointCloud(np.eye(3), {" ": np.zeros(3)}))
    assert not any(tmp_path.iterdir())
    write(path, PointCloud(np.eye(3), {name: np.array([65280, 255, 16711680])}))
    assert read(path).attributes[name].tolist() == [65280, 255, 16711680]
