"""E57 files: poses, spherical coordinates, invalid points, every type, what others write and read, and damage."""

import numpy as np
import pytest

from formats import load, losses
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, GppcsError, OutputError
from gppcs.io import read, write
from gppcs.io.e57 import E57Header

pye57 = pytest.importorskip("pye57")
libe57 = pye57.libe57

TURN = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # a quarter around z
POINTS = np.array([[1.0, 2, 3], [4, 5, 6], [7, 8, 9.5]])


def raw(points, **fields):
    return {f"cartesian{axis}": points[:, i].copy() for i, axis in enumerate("XYZ")} | fields


@pytest.fixture
def by_pye57(tmp_path):
    """Write scans by pye57: data and keywords of each; return the path."""

    def make(*scans):
        path = tmp_path / "scans.e57"
        with pye57.E57(str(path), mode="w") as file:
            for data, keywords in scans:
                file.write_scan_raw(data, **keywords)
        return path

    return make


def test_a_file_without_points_is_refused_and_empty_scans_are_left_out(tmp_path):
    path = str(tmp_path / "empty.e57")
    for n_scans in (0, 2):
        image = libe57.ImageFile(path, "w")
        image.extensionsAdd("", libe57.E57_V1_0_URI)
        scans = libe57.VectorNode(image, True)
        image.root().set("data3D", scans)
        for _ in range(n_scans):
            scan = libe57.StructureNode(image)
            scans.append(scan)
            scan.set("guid", libe57.StringNode(image, "{1}"))
        image.close()
        with pytest.raises(FileFormatError, match=f"a scan of points in the E57 file, found {n_scans} without"):
            read(path)


@pytest.fixture
def by_libe57(tmp_path):
    """Write one scan of given nodes and values by libE57Format; return the path."""

    def make(fields, **pose):
        path = tmp_path / "scan.e57"
        image = libe57.ImageFile(str(path), "w")
        image.extensionsAdd("", libe57.E57_V1_0_URI)
        image.extensionsAdd("other", "urn:other")
        scans, scan = libe57.VectorNode(image, True), libe57.StructureNode(image)
        image.root().set("data3D", scans)
        scans.append(scan)
        if pose:
            scan.set("pose", libe57.StructureNode(image))
        for part, numbers in pose.items():
            scan["pose"].set(part, libe57.StructureNode(image))
            for axis, value in numbers.items():
                scan["pose"][part].set(axis, libe57.FloatNode(image, value))
        prototype, buffers = libe57.StructureNode(image), libe57.VectorSourceDestBuffer()
        for name, (kind, arguments, values) in fields.items():
            prototype.set(name, getattr(libe57, kind)(image, *arguments))
            buffers.append(libe57.SourceDestBuffer(image, name, values, len(values), True, True))
        points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
        scan.set("points", points)
        writer = points.writer(buffers)
        writer.write(len(values))
        writer.close()
        image.close()
        return path

    return make


def test_pye57_reads_what_is_written(tmp_path):
    colours = {name: np.array([1, 2, 255], np.uint8) * k for k, name in enumerate(["red", "green", "blue"])}
    grid = {"row": np.array([1, 2, 3], np.uint16), "column": np.array([0, 0, 9], np.uint16)}
    own = {"label": np.array([-1, 0, 2**40]), "is_ground": np.array([True, False, True])}
    intensity = np.array([0.5, 0.25, 1], np.float32)
    write(tmp_path / "cloud.e57", PointCloud(POINTS, {"intensity": intensity, **colours, **grid, **own}))
    with pye57.E57(str(tmp_path / "cloud.e57")) as file:
        assert file.scan_count == 1
        data = file.read_scan(0, intensity=True, colors=True, row_column=True, ignore_missing_fields=True)
        header = file.get_header(0)
        assert (header.intensityMinimum, header.intensityMaximum) == (0.25, 1)
        assert header.point_fields[-2:] == ["gppcs:label", "gppcs:is_ground"]
    assert np.array_equal(np.stack([data[f"cartesian{axis}"] for axis in "XYZ"], axis=1), POINTS)
    assert np.array_equal(data["intensity"], intensity)
    assert np.array_equal(data["colorBlue"], colours["blue"])
    assert np.array_equal(data["columnIndex"], grid["column"])


@pytest.mark.parametrize("largest", [200, 65535])
def test_pye57_reads_colours_of_16_bits_as_bytes(tmp_path, largest):
    colours = {name: np.array([0, 7, largest], np.uint16) for name in ("red", "green", "blue")}
    colours["blue"][2] = 200
    write(tmp_path / "cloud.e57", PointCloud(POINTS, colours))
    assert read(tmp_path / "cloud.e57") == PointCloud(POINTS, colours)
    with pye57.E57(str(tmp_path / "cloud.e57")) as file:
        data = file.read_scan(0, colors=True, ignore_missing_fields=True)
    assert data["colorRed"].tolist() == ([0, 7, 200] if largest == 200 else [0, 0, 255])
    assert data["colorBlue"].tolist() == ([0, 7, 200] if largest == 200 else [0, 0, 1])


def test_scans_are_merged_with_their_poses(by_pye57, tmp_path):
    colours = {f"color{name}": np.array([1, 2, 3], np.uint8) for name in ("Red", "Green", "Blue")}
    first = raw(POINTS, intensity=np.array([1, 2, 3], np.float32), **colours)
    second = raw(POINTS[:2], intensity=np.array([4, 5], np.float32))
    path = by_pye57((first, {"name": "Küche"}), (second, {"rotation": TURN, "translation": np.array([10.0, 20, 30])}))
    cloud = read(path)
    moved = np.stack([10 - POINTS[:2, 1], 20 + POINTS[:2, 0], 30 + POINTS[:2, 2]], axis=1)
    assert np.array_equal(cloud.points[:3], POINTS)
    assert np.allclose(cloud.points[3:], moved, rtol=1e-15)
    assert cloud.attributes["scan"].tolist() == [0, 0, 0, 1, 1]
    assert cloud.attributes["intensity"].tolist() == [1, 2, 3, 4, 5]
    assert list(cloud.attributes) == ["intensity", "scan"]
    expected = ["names and poses of scans (2)", "field colorBlue", "field colorGreen", "field colorRed"]
    assert load(path)[-1] == expected
    some = cloud.take(np.array([4, 0, 3]))
    write(tmp_path / "some.e57", some)
    assert read(tmp_path / "some.e57") == some


def test_the_numbers_of_a_pose_are_taken_by_name(by_libe57):
    pose = {"rotation": dict(zip("xyzw", np.sort(TURN), strict=True)), "translation": {"z": 30.0, "y": 20.0, "x": 10.0}}
    fields = {f"cartesian{axis}": ("FloatNode", (), POINTS[:, i].copy()) for i, axis in enumerate("XYZ")}
    moved = np.stack([10 - POINTS[:, 1], 20 + POINTS[:, 0], 30 + POINTS[:, 2]], axis=1)
    path = by_libe57(fields, **pose)
    assert np.allclose(read(path).points, moved, rtol=1e-15)
    assert load(path)[-1] == ["names and poses of scans (1)"]


def test_invalid_points_are_left_out_with_a_word(by_pye57):
    path = by_pye57((raw(POINTS, cartesianInvalidState=np.array([0, 2, 1], np.int8)), {"name": "Küche"}))
    assert np.array_equal(read(path).points, POINTS[:1])
    assert read(path).attributes == {}
    assert load(path)[-1] == ["points without a valid position (2)", "names and poses of scans (1)"]


@pytest.mark.parametrize("single", [False, True])
def test_spherical_coordinates_are_converted(by_libe57, single):
    distance, azimuth, elevation = np.array([2.0, 1]), np.array([0.5, -1]), np.array([0.25, 1])
    values = {"Range": distance, "Azimuth": azimuth, "Elevation": elevation}
    kind = ("FloatNode", (0.0, libe57.E57_SINGLE) if single else ())
    cloud = read(by_libe57({f"spherical{name}": (*kind, column) for name, column in values.items()}))
    points = cloud.points
    assert cloud.coordinate_dtype == np.float64
    assert np.allclose(np.linalg.norm(points, axis=1), distance, rtol=1e-15)
    assert np.allclose(np.arctan2(points[:, 1], points[:, 0]), azimuth, rtol=1e-15)
    assert np.allclose(np.arcsin(points[:, 2] / distance), elevation, rtol=1e-15)


def test_points_that_are_unpacked_from_nothing_are_refused(by_libe57):
    repeats = np.full(100_000, 5.0)
    path = by_libe57({f"cartesian{axis}": ("IntegerNode", (5, 5, 5), repeats) for axis in "XYZ"})
    with pytest.raises(FileFormatError, match="100 times"):
        read(path)


def test_scaled_integers_and_fields_of_extensions(by_libe57):
    metres = np.array([-5, 7], np.int16) * 0.001 + 500_000
    scaled = {f"cartesian{axis}": ("ScaledIntegerNode", (0, -9, 9, 0.001, 500_000.0), metres) for axis in "XYZ"}
    own = {"other:class": ("IntegerNode", (0, 0, 300), np.array([300, 2], np.uint16))}
    cloud = read(by_libe57(scaled | own))
    assert np.array_equal(cloud.points[:, 0], metres)
    assert cloud.attributes["other_class"].tolist() == [300, 2]
    assert cloud.attributes["other_class"].dtype == np.uint16


def test_coordinate_systems_are_kept(tmp_path):
    cloud = PointCloud(POINTS, header=E57Header('PROJCS["UTM"]'))
    write(tmp_path / "cloud.e57", cloud)
    assert read(tmp_path / "cloud.e57") == cloud
    assert (cloud.header.crs, losses("a.ply", cloud)) == ('PROJCS["UTM"]', ["the coordinate system"])


def test_attributes_that_e57_cannot_hold_are_refused(tmp_path):
    attributes = {"a b": np.zeros(3), "é": np.zeros(3), "big": np.array([0, 0, 2**63 + 1], np.uint64)}
    cloud = PointCloud(POINTS, attributes | {"t": np.array(["a"] * 3)})
    with pytest.raises(OutputError, match=r"cannot hold: attribute é .*, attribute big .*, attribute t \(text\)"):
        write(tmp_path / "cloud.e57", cloud)
    assert not any(tmp_path.iterdir())
    write(tmp_path / "cloud.e57", cloud, lossy=True)
    assert list(read(tmp_path / "cloud.e57").attributes) == ["a_b"]


def with_checksums(data):
    """The pages of an E57 file with right checksums, as a hostile writer would make them."""

    def checksum(page):
        value = 0xFFFFFFFF
        for byte in page:
            value ^= byte
            for _ in range(8):
                value = value >> 1 ^ (0x82F63B78 if value & 1 else 0)
        return (value ^ 0xFFFFFFFF).to_bytes(4, "big")

    pages = (data[i : i + 1020] for i in range(0, len(data), 1024))
    return b"".join(page + checksum(page) for page in pages)


@pytest.fixture
def changed(tmp_path):
    """Write an E57 file in which a text of the XML part is another of the same length; return its path."""

    def make(old, new):
        path = tmp_path / "changed.e57"
        write(path, PointCloud(POINTS, {"label": np.arange(3)}), force=True)
        data = path.read_bytes()
        assert with_checksums(data) == data
        assert old in data
        assert len(old) == len(new)
        path.write_bytes(with_checksums(data.replace(old, new)))
        return path

    return make


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b'recordCount="3"', b'recordCount="9"', r"ends in point \d of 9|libE57Format reports"),
        (b"<gppcs:label", b"<other:label", "reports: "),
        (b"ASTM E57 3D Imaging", b"<!DOCTYPE Imaging  ", "XML without declarations"),
        (b'encoding="UTF-8"', b'encoding="latin"', "XML in UTF-8"),
    ],
)  # fmt: skip
def test_lies_of_the_header_are_refused(changed, old, new, message):
    with pytest.raises(FileFormatError, match=message):
        read(changed(old, new))


def test_scans_without_coordinates_are_refused(by_libe57):
    fields = {name: ("FloatNode", (), np.zeros(1)) for name in ("cartesianX", "cartesianY", "intensity")}
    with pytest.raises(FileFormatError, match=r"spherical .* found 'cartesianX', 'cartesianY', 'intensity'"):
        read(by_libe57(fields))


@pytest.mark.parametrize("seed", range(12))
def test_damage_under_right_checksums_is_read_or_refused(tmp_path, seed):
    path, rng = tmp_path / "damaged.e57", np.random.default_rng(seed)
    write(path, PointCloud(np.arange(30.0).reshape(10, 3), {"label": np.arange(10)}))
    content = bytearray(path.read_bytes())
    for at in rng.integers(len(content), size=rng.integers(1, 5)):
        content[at] = rng.integers(256)
    path.write_bytes(with_checksums(content))
    try:
        read(path, "e57")
    except GppcsError as error:
        assert str(path) in str(error)  # noqa: PT017 - either outcome is right
        assert len(str(error).splitlines()) == 1  # noqa: PT017
