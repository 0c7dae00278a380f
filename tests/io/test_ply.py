"""PLY files as others write them: every encoding, lists, elements before the vertices, damage."""

import struct

import numpy as np
import pytest

import gppcs
from formats import load, losses
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, GppcsError, OutputError
from gppcs.io import read, write

NAMES = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort"}
NAMES |= {"i4": "int", "u4": "uint", "f4": "float", "f8": "double"}
XYZ = ["property float x", "property float y", "property float z"]
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


@pytest.fixture
def ply(tmp_path):
    """Write a PLY file of header lines and a body; return its path."""

    def make(encoding, header, body=b"", end="\n"):
        path = tmp_path / "cloud.ply"
        lines = ["ply", f"format {encoding} 1.0", *header, "end_header", ""]
        path.write_bytes(end.join(lines).encode("utf-8", "surrogateescape") + body)
        return path

    return make


@pytest.mark.parametrize("with_bits", [False, True])
@pytest.mark.parametrize("encoding", ["ascii", *ORDERS])
def test_every_type_under_both_names(ply, encoding, with_bits):
    values = [(1, 2, 3, *(i + 7 * k for k in range(8))) for i in range(5)]
    header = ["element vertex 5", *XYZ, *(f"property {np.dtype(t).name if with_bits else NAMES[t]} {t}" for t in NAMES)]
    if encoding == "ascii":
        body = "".join(" ".join(map(str, row)) + "\n" for row in values).encode()
    else:
        record = [(axis, "f4") for axis in "xyz"] + [(t, t) for t in NAMES]
        body = np.array(values, np.dtype(record).newbyteorder(ORDERS[encoding])).tobytes()
    cloud = read(ply(encoding, header, body))
    assert cloud.coordinate_dtype == np.float32
    assert np.array_equal(cloud.points, np.tile([1.0, 2, 3], (5, 1)))
    for k, name in enumerate(NAMES):
        assert cloud.attributes[name].dtype == np.dtype(name)
        assert cloud.attributes[name].flags.c_contiguous
        assert cloud.attributes[name].tolist() == [i + 7 * k for i in range(5)]


@pytest.mark.parametrize("encoding", ["ascii", *ORDERS])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_other_elements_and_properties_of_faces_are_passed_by(ply, encoding, end):
    header = [
        "comment made by hand",
        "obj_info of no use",
        "element camera 2",
        "property double focus",
        "element vertex 3",
        *XYZ,
        "property uchar label",
        "element face 2",
        "property uchar flag",
        "property list uchar int vertex_indices",
        "property list int float weights",
        "element edge 1",
        "property int end",
    ]
    vertices = [(0.5, 1.5, 2.25, 7), (3, 4, 5, 8), (6, 7, 8, 9)]
    if encoding == "ascii":
        rows = ["1.0", "2.0", *(" ".join(map(str, row)) for row in vertices), "1 3 0 1 2 0", "1 4 0 1 2 0 2 0.5 1"]
        body = end.join([*rows, "3", ""]).encode()
    else:
        order = ORDERS[encoding]
        body = struct.pack(order + "dd", 1, 2) + b"".join(struct.pack(order + "fffB", *row) for row in vertices)
        body += struct.pack(order + "BBiiii", 1, 3, 0, 1, 2, 0) + struct.pack(
            order + "BBiiiiiff", 1, 4, 0, 1, 2, 0, 2, 0.5, 1
        )
        body += struct.pack(order + "i", 3)
    path = ply(encoding, header, body, end)
    cloud = read(path)
    assert cloud.points.tolist() == [[0.5, 1.5, 2.25], [3, 4, 5], [6, 7, 8]]
    assert cloud.attributes["label"].tolist() == [7, 8, 9]
    assert list(cloud.attributes) == ["label"]
    assert load(path).unread == ["element camera (2)", "element edge (1)"]
    assert np.array_equal(gppcs.read_mesh(path).faces, [[0, 1, 2], [0, 1, 2], [0, 2, 0]])
    assert losses("cloud.ply", cloud) == []
    assert losses("cloud.off", cloud) == ["attribute label (uint8)", "comments (2)"]
    write(path.with_suffix(".csv"), cloud)  # comments are no values


@pytest.mark.parametrize("row", [b"3 0 1", b"-1", b"1.5 1", b"nan", b"3 0 1 word", b"3 0 1 1.5", b"3 0 1 5"])
def test_malformed_faces_are_refused(ply, row):
    header = ["element vertex 3", *XYZ, "element face 1", "property list char int vertex_indices"]
    with pytest.raises(GppcsError, match=r"expected|ends in face 1"):
        gppcs.read_mesh(ply("ascii", header, b"0 0 0\n1 0 0\n0 1 0\n" + row + b"\n"))
    with pytest.raises(FileFormatError, match="face 1, found one of length -1"):
        gppcs.read_mesh(ply("binary_little_endian", header, bytes(36) + b"\xff" * 20))
    header = ["element face 1", "property list char int vertex_indices", *header[:4]]
    assert len(read(ply("binary_little_endian", header, bytes(37)))) == 3
    with pytest.raises(FileFormatError, match="each property of a vertex, found a list"):
        read(ply("ascii", ["element vertex 1", *XYZ, "property list char int friends"], b"0 0 0 0\n"))


CAMERA = ["element camera 2", "property double focus", "element vertex 1", *XYZ]
RED = ["element vertex 3", *XYZ, "property uchar red"]
BINARY = "binary_little_endian"


@pytest.mark.parametrize(
    ("encoding", "header", "body", "message"),
    [
        (BINARY, ["element vertex 1", *XYZ[:2]], bytes(100), "x, y and z for each point, found 'x', 'y'"),
        (BINARY, ["element point 1", *XYZ], bytes(100), "element named vertex, found 'point'"),
        (BINARY, ["element vertex 1", "property real x"], bytes(100), "line 4: .*'property real x'"),
        (BINARY, ["element vertex 1", "property list float int x"], bytes(100), "line 4"),
        (BINARY, ["element vertex 1", *XYZ, "property int x"], bytes(100), "properties of vertex, but NumPy reports"),
        (BINARY, ["nonsense"], bytes(100), "line 3: .*'nonsense'"),
        (BINARY, CAMERA, bytes(8), "ends in camera 2 of 2"),
        ("ascii", CAMERA, b"1.0000\n", "ends in camera 2 of 2"),
        ("ascii", RED, b"1 2 3 4\n1 2 3 256\n1 2 3 4\n", "uint8 as red of vertex 2, found '256'"),
        ("ascii", RED, b"1 2 3 4\n1 2 3 nan\n1 2 3 4\n", "uint8 as red of vertex 2, found 'nan'"),
        ("ascii", RED, b"1 2 3 4\n1 2 3\n1 2 3 4\n", "vertex 2: expected 4 columns, found '1 2 3'"),
    ],
)
def test_malformed_files_tell_what_and_where(ply, encoding, header, body, message):
    with pytest.raises(FileFormatError, match=message):
        read(ply(encoding, header, body))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "end_header"),
        ("plywood\n", "'ply' as the first line .*'plywood'"),
        ("ply\nelement vertex 0\nend_header\n", "line 3: expected a PLY header"),
    ],
)
def test_what_is_no_whole_header_is_refused(file_of, content, message):
    with pytest.raises(FileFormatError, match=message):
        read(file_of(".ply", content))


def test_whole_numbers_of_64_bit_take_the_narrowest_type_that_is_exact(tmp_path):
    def written(*values, dtype=np.int64):
        path = tmp_path / "cloud.ply"
        cloud = PointCloud(np.zeros((len(values), 3)), {"id": np.array(values, dtype)})
        write(path, cloud, force=True)
        back = read(path).attributes["id"]
        assert [int(value) for value in back] == list(values)
        return back.dtype

    assert written(-(2**31), 2**31 - 1) == np.int32
    assert written(0, 2**32 - 1) == np.uint32
    assert written(-1, 2**32 - 1) == np.float64
    assert written(-(2**63), 2**62) == np.float64
    assert written(2**63, dtype=np.uint64) == np.float64
    assert written() == np.int32
    for value, dtype in ((2**53 + 1, np.int64), (2**63 - 1, np.int64), (2**64 - 1, np.uint64)):
        with pytest.raises(OutputError, match=r"attribute id \("):
            written(value, dtype=dtype)


def test_fractions_are_not_cut_to_whole_coordinates(tmp_path):
    for points in (np.full((1, 3), 0.5), np.full((1, 3), 2.0**31), np.full((1, 3), np.nan)):
        with pytest.raises(OutputError, match="whole numbers of type int32"):
            write(tmp_path / "cloud.ply", PointCloud(points, coordinate_dtype=np.dtype("i4")))


def test_comments_are_written_again(ply, tmp_path):
    header = ["comment made by Jos\udce9", "obj_info  two  spaces", "element vertex 1", *XYZ]  # a byte of Latin-1
    cloud = read(ply("ascii", header, b"0 0 0\n"))
    for as_text in (True, False):
        write(tmp_path / "again.ply", cloud, ascii=as_text, force=True)
        assert read(tmp_path / "again.ply") == cloud
        lines = (tmp_path / "again.ply").read_bytes().split(b"\n")[2:4]
        assert lines == [line.encode("utf-8", "surrogateescape") for line in header[:2]]
