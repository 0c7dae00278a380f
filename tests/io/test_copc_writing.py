"""COPC files that gppcs writes, as other programs read them."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import laspy
import numpy as np
import pytest

import gppcs
from gppcs.errors import FileFormatError, ParameterError
from gppcs.io import copc_writing, losses

VIEWER = Path(__file__).parents[2] / "viewer"
N, ROOT, MOST = 20_000, 500, 1000
WKT = 'PROJCS["here",GEOGCS["there"],UNIT["metre",1],AUTHORITY["EPSG","32633"]]'


@pytest.fixture(autouse=True)
def small_nodes(monkeypatch):
    monkeypatch.setattr(copc_writing, "ROOT", ROOT)
    monkeypatch.setattr(copc_writing, "MOST", MOST)


def scan(folder, point_format=7, n=N, several=True):
    """Hilly ground with a tower, as laspy holds it, every dimension filled."""
    rng = np.random.default_rng(1)
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 5 else "1.2")
    header.scales, header.offsets = [0.01, 0.01, 0.001], [500_000, 5_400_000, 0]
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams("quality", "f4", description="of a point"),
            laspy.ExtraBytesParams("width", "u2", scales=np.array([0.1]), offsets=np.array([3.0])),
            *([laspy.ExtraBytesParams("three", "3i2")] if several else []),
        ]
    )
    header.vlrs.append(laspy.VLR("somebody", 7, "a record", b"kept"))
    las = laspy.LasData(header)
    x, y = rng.uniform(0, 200, (2, n))
    z = np.where(np.hypot(x - 60, y - 60) < 5, rng.uniform(0, 80, n), 5 * np.sin(x / 20) + rng.normal(0, 0.1, n))
    las.x, las.y, las.z = 500_000 + x, 5_400_000 + y, z
    for dimension in las.point_format.dimensions:
        if dimension.name not in ("X", "Y", "Z", "width"):
            shape = (n, dimension.num_elements) if dimension.num_elements > 1 else n
            high = 60 if dimension.kind.name == "SignedInteger" else dimension.max if dimension.num_bits < 8 else 200
            las[dimension.name] = rng.integers(0, high + 1, shape)
    las.width = 3.0 + 0.1 * rng.integers(0, 1000, n)
    if point_format > 5:
        las.header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", WKT.encode() + b"\0"))
        las.header.global_encoding.wkt = True
    las.write(folder / "scan.laz")
    return gppcs.read(folder / "scan.laz"), las


def places(records):
    return np.column_stack([records.x, records.y, records.z])


def same_points(found, expected):
    names = expected.dtype.names
    assert found.dtype.names == names
    first, second = (
        np.lexsort([each[name].reshape(len(each), -1)[:, 0] for name in names]) for each in (found, expected)
    )
    for name in names:
        np.testing.assert_array_equal(found[name][first], expected[name][second])


@pytest.mark.parametrize("point_format", [6, 7, 8])
def test_every_dimension_of_every_point_is_kept(tmp_path, point_format):
    cloud, las = scan(tmp_path, point_format)
    assert losses("a.copc.laz", cloud) == []
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="random")
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        same_points(reader.query().array, las.points.array)
        assert [vlr.record_data_bytes() for vlr in reader.header.vlrs if vlr.user_id == "somebody"] == [b"kept"]
        np.testing.assert_array_equal(reader.header.scales, las.header.scales)
    back = gppcs.read(tmp_path / "a.copc.laz")
    assert back.header.crs == "here (EPSG:32633)"
    assert back.header.records == cloud.header.records


def test_the_file_is_as_its_specification_says(tmp_path):
    cloud, las = scan(tmp_path)
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="random")
    data = (tmp_path / "a.copc.laz").read_bytes()
    assert data[377:387].rstrip(b"\0") == b"copc"
    assert np.frombuffer(data, "<u2", 2, 393).tolist() == [1, 160]
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        info, entries = reader.copc_info, reader.root_page.entries
        assert reader.header.version == "1.4"
        behind = int(np.frombuffer(data, "<u8", 1, 235)[0])
        assert data[behind + 2 : behind + 20] == b"copc".ljust(16, b"\0") + (1000).to_bytes(2, "little")
        assert np.frombuffer(data, "<f8", 2, 429 + 56).tolist() == [las.gps_time.min(), las.gps_time.max()]
        assert (np.abs(las.xyz - info.center) <= info.halfsize).all()
        assert sum(entry.point_count for entry in entries.values()) == N == reader.header.point_count
        assert max(entry.point_count for entry in entries.values()) <= MOST
        for entry in entries.values():  # each on the way from the first level, and its points where it says
            key = entry.key
            if key.level:
                above = laspy.copc.VoxelKey()
                above.level, above.x, above.y, above.z = key.level - 1, key.x // 2, key.y // 2, key.z // 2
                assert above in entries
        for level in range(3):
            seen = reader.query(level=level)
            cells = np.floor((places(seen) - info.center + info.halfsize) / (2 * info.halfsize / 2**level)).astype(int)
            counts = {(k.x, k.y, k.z): e.point_count for k, e in entries.items() if k.level == level and e.point_count}
            found, numbers = np.unique(cells, axis=0, return_counts=True)
            assert dict(zip(map(tuple, found.tolist()), numbers.tolist(), strict=True)) == counts


@pytest.mark.parametrize("method", ["gp", "fps"])
def test_the_first_levels_are_the_first_points_of_the_ranking(tmp_path, method):
    cloud, _ = scan(tmp_path)
    gppcs.write(tmp_path / "a.copc.laz", cloud, **({} if method == "gp" else {"levels_by": method}))
    ranking = gppcs.simplify(cloud, n_points=N // 4, method=method).cloud.points
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        spacing = reader.copc_info.spacing
        for level, count in enumerate([ROOT, 4 * ROOT]):
            seen = places(reader.query(level=range(level + 1)))
            assert set(map(tuple, seen)) == set(map(tuple, ranking[:count]))
            assert len(gppcs.read(tmp_path / "a.copc.laz", resolution=spacing / 2**level)) == count
        assert spacing == pytest.approx(200 / np.sqrt(ROOT), rel=0.5)


def test_points_in_their_order_fill_the_levels_in_this_order(tmp_path):
    cloud, _ = scan(tmp_path)
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="order")
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        assert set(map(tuple, places(reader.query(level=0)))) == set(map(tuple, cloud.points[:ROOT]))


def test_a_box_finds_the_points_in_it(tmp_path):
    cloud, las = scan(tmp_path)
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="random")
    low, high = np.array([500_040, 5_400_030, -9.0]), np.array([500_090, 5_400_100, 30.0])
    inside = ((las.xyz >= low) & (las.xyz <= high)).all(axis=1)
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        assert len(reader.query(bounds=laspy.copc.Bounds(low, high))) == inside.sum()
    assert len(gppcs.read(tmp_path / "a.copc.laz", box=[*low, *high])) == inside.sum()


@pytest.mark.parametrize(("point_format", "raised"), [(0, 6), (1, 6), (2, 7), (3, 7)])
def test_older_point_formats_are_raised_and_this_is_said(tmp_path, point_format, raised):
    cloud, _ = scan(tmp_path, point_format, 2000)
    assert losses("a.copc.laz", cloud) == [f"point format {point_format} (it becomes {raised})"]
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="random")
    back = gppcs.read(tmp_path / "a.copc.laz")
    assert back.header.point_format == raised
    order = [np.lexsort([each.attributes["intensity"], *each.points.T]) for each in (back, cloud)]
    for name, values in cloud.attributes.items():
        found = back.attributes["scan_angle" if name == "scan_angle_rank" else name][order[0]]
        if name == "scan_angle_rank":
            found = np.rint(found * 0.006)
        np.testing.assert_array_equal(found, values[order[1]])


@pytest.mark.parametrize("n", [0, 1, 2, MOST])
def test_few_points_are_one_node(tmp_path, n):
    cloud = gppcs.PointCloud(np.arange(3.0 * n).reshape(n, 3) % 700)
    gppcs.write(tmp_path / "a.copc.laz", cloud)
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        assert len(reader.query()) == n
        assert len(reader.root_page.entries) == 1


def test_points_at_one_place_end_somewhere(tmp_path):
    gppcs.write(tmp_path / "a.copc.laz", np.zeros((3 * MOST, 3)), levels_by="random")
    assert len(gppcs.read(tmp_path / "a.copc.laz")) == 3 * MOST


def test_a_cloud_without_a_coordinate_system_is_written_with_a_note(tmp_path, caplog):
    with caplog.at_level("INFO", "gppcs"):
        gppcs.write(tmp_path / "a.copc.laz", np.eye(3))
    assert "no coordinate system" in caplog.text


def test_bad_levels_are_refused(tmp_path):
    with pytest.raises(FileFormatError, match=r"a\.laz: expected a name that ends in \.copc\.laz"):
        gppcs.write(tmp_path / "a.laz", np.eye(3), levels_by="gp")
    with pytest.raises(ParameterError, match=r"levels_by to be 'gp' or .*, found 'voxel'"):
        gppcs.write(tmp_path / "a.copc.laz", np.eye(3), levels_by="voxel")
    assert not list(tmp_path.iterdir())


SCRIPT = """
import { Copc } from "copc"
import { open } from "node:fs/promises"
const file = await open(process.argv[2])
const get = async (begin, end) => (await file.read(Buffer.alloc(end - begin), 0, end - begin, begin)).buffer
const copc = await Copc.create(get)
const { nodes } = await Copc.loadHierarchyPage(get, copc.info.rootHierarchyPage)
const points = []
for (const node of Object.values(nodes).filter((node) => node.pointCount)) {
  const view = await Copc.loadPointDataView(get, copc, node)
  const values = ["X", "Y", "Z", "Intensity", "GpsTime", "Red", "quality"].map(view.getter)
  for (let i = 0; i < view.pointCount; i++) points.push(values.map((value) => value(i)))
}
console.log(JSON.stringify({ info: copc.info, wkt: copc.wkt, points }))
"""


def test_the_javascript_library_copc_reads_all_points(tmp_path):
    node, packages = shutil.which("node"), VIEWER / "node_modules"
    if not node or not (packages / "copc").is_dir():
        needed = "node" in os.environ.get("GPPCS_CI_NEEDS", "").split(",")
        (pytest.fail if needed else pytest.skip)("no Node.js with the package copc: run npm ci in viewer")
    cloud, las = scan(tmp_path, several=False)  # it does not know extra bytes of several numbers
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="random")
    (tmp_path / "read.mjs").write_text(SCRIPT)
    (tmp_path / "node_modules").symlink_to(packages)
    run = subprocess.run([node, tmp_path / "read.mjs", tmp_path / "a.copc.laz"], capture_output=True, check=True)
    found = json.loads(run.stdout)
    assert found["wkt"] == WKT
    assert found["info"]["gpsTimeRange"] == [las.gps_time.min(), las.gps_time.max()]
    expected = np.column_stack([las.xyz, las.intensity, las.gps_time, las.red, las.quality])
    points = np.array(found["points"])
    np.testing.assert_allclose(points[np.lexsort(points.T)], expected[np.lexsort(expected.T)], rtol=1e-12)
