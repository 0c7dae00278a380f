"""COPC files that gppcs writes, as other programs read them."""

import dataclasses
import json
import os
import shutil
import subprocess
from pathlib import Path

import laspy
import numpy as np
import pandas
import pytest
from scipy.spatial import cKDTree

import gppcs
from formats import losses
from gppcs.io import copc_writing

VIEWER = Path(__file__).parents[2] / "viewer"
N, FULL, LARGEST = 20_000, 500, 750
KINDS = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
RAISED = {0: 6, 1: 6, 2: 7, 3: 7, 4: 6, 5: 7, 9: 6, 10: 8}
NEWER = {"overlap", "scanner_channel", "scan_angle", "gps_time"}  # dimensions that old point formats may not have
SEVERAL = {"three": 3, "both": 2, "raw": 5}  # how many numbers some dimensions have
KEYS = [[1, 1, 0, 1], [3072, 0, 1, 32633]]
WKT = 'PROJCS["here",GEOGCS["there"],UNIT["metre",1],AUTHORITY["EPSG","32633"]]'


@pytest.fixture(autouse=True)
def small_nodes(monkeypatch):
    for name, value in (("MOST", FULL), ("BLOCK", 7_000)):
        monkeypatch.setattr(copc_writing, name, value)


def scan(folder, point_format=7, n=N):
    """Hilly ground with a tower, as laspy holds it, with extra bytes of all types and every dimension filled."""
    rng = np.random.default_rng(1)
    version = "1.4" if point_format > 5 else "1.3" if point_format > 3 else "1.2"
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = [0.01, 0.01, 0.001], [500_000, 5_400_000, 0]
    header.add_extra_dims(
        [
            *(laspy.ExtraBytesParams(f"of {kind}", kind, description="of a point") for kind in KINDS),
            laspy.ExtraBytesParams("width", "u2", scales=np.array([0.1]), offsets=np.array([3.0])),
            laspy.ExtraBytesParams("three", "3i2"),
            laspy.ExtraBytesParams("both", "2i4", scales=np.array([0.1, 0.5]), offsets=np.array([3.0, 7.0])),
            laspy.ExtraBytesParams("raw", "5u1"),
        ]
    )
    header.vlrs.append(laspy.VLR("somebody", 7, "a record", b"kept"))
    if point_format > 5:
        header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", WKT.encode() + b"\0"))
        header.global_encoding.wkt = True
    else:
        header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", np.array(KEYS, "<u2").tobytes()))
    size = header.point_format.dtype()
    records = np.frombuffer(rng.bytes(n * size.itemsize), size).copy()
    x, y = rng.uniform(0, 200, (2, n))
    z = np.where(np.hypot(x - 60, y - 60) < 5, rng.uniform(0, 80, n), 5 * np.sin(x / 20) + rng.normal(0, 0.1, n))
    records["X"], records["Y"], records["Z"] = 100 * x, 100 * y, 1000 * z
    for name in size.names:
        if size[name].kind == "f":
            records[name] = rng.normal(0, 1e6, n)
    points = laspy.ScaleAwarePointRecord(records, header.point_format, header.scales, header.offsets)
    las = laspy.LasData(header, points)
    las.write(folder / "scan.las")
    return gppcs.read(folder / "scan.las"), las


def values_of(points, name):
    """The dimension of laspy of a name, or one of its numbers: three_1 is the second of three."""
    if name in points.point_format.dimension_names:
        return np.asarray(points[name])
    name, number = name.rsplit("_", 1)
    return np.asarray(points[name])[:, int(number)]


@pytest.mark.parametrize("point_format", range(11))
def test_every_dimension_of_every_point_and_the_header_are_kept(tmp_path, point_format):
    cloud, las = scan(tmp_path, point_format, 5000)
    remarks = losses("a.copc.laz", cloud)
    assert [f"attribute {name} under one name (its numbers become {name}_0, {name}_1 and so on)" in remarks
            for name in SEVERAL] == [True] * 3  # fmt: skip
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="even")
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        points, header = reader.query(), reader.header
    assert header.point_format.id == RAISED.get(point_format, point_format)
    assert [vlr.record_data_bytes() for vlr in header.vlrs if vlr.user_id == "somebody"] == [b"kept"]
    np.testing.assert_array_equal(header.scales, las.header.scales)
    assert header.global_encoding.wkt
    assert gppcs.read(tmp_path / "a.copc.laz").header.crs == cloud.header.crs
    names = {*las.point_format.dimension_names} - {"scan_angle_rank", *SEVERAL}
    names |= {f"{name}_{i}" for name, count in SEVERAL.items() for i in range(count)}
    assert {*points.point_format.dimension_names} - NEWER == names - NEWER
    orders = [np.lexsort([each["of u8"], each["of u4"]]) for each in (points, las.points)]
    for name in points.point_format.dimension_names:
        stored = values_of(points, name)[orders[0]]
        if name == "scan_angle" and "scan_angle_rank" in las.point_format.dimension_names:
            assert np.rint(stored * 0.006).tolist() == las["scan_angle_rank"][orders[1]].tolist()
        elif name in names:
            assert stored.tobytes() == values_of(las.points, name)[orders[1]].tobytes(), name
        else:
            assert name in NEWER
            assert not stored.any()
    times = np.fromfile(tmp_path / "a.copc.laz", "<f8", 2, offset=429 + 56).tolist()
    has_times = "gps_time" in las.point_format.dimension_names
    assert times == ([las.gps_time.min(), las.gps_time.max()] if has_times else [0, 0])


def test_the_file_is_as_its_specification_says(tmp_path):
    cloud, las = scan(tmp_path)
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="even")
    data = (tmp_path / "a.copc.laz").read_bytes()
    assert data[377:387].rstrip(b"\0") == b"copc"
    assert np.frombuffer(data, "<u2", 2, 393).tolist() == [1, 160]
    first_evlr = int(np.frombuffer(data, "<u8", 1, 235)[0])
    assert data[first_evlr + 2 : first_evlr + 20] == b"copc".ljust(16, b"\0") + (1000).to_bytes(2, "little")
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        info, entries = reader.copc_info, reader.root_page.entries
        assert reader.header.version == "1.4"
        assert (np.abs(las.xyz - info.center) <= info.halfsize).all()
        assert sum(entry.point_count for entry in entries.values()) == N == reader.header.point_count
        assert max(entry.point_count for entry in entries.values()) <= LARGEST
        for key in entries:  # each on the way from the first level
            parent = laspy.copc.VoxelKey()
            parent.level, parent.x, parent.y, parent.z = key.level - 1, key.x // 2, key.y // 2, key.z // 2
            assert not key.level or entries[parent].point_count >= FULL
        for level in range(4):
            points = np.column_stack([getattr(reader.query(level=level), axis) for axis in "xyz"])
            cells = np.floor((points - info.center + info.halfsize) / (2 * info.halfsize / 2**level)).astype(int)
            expected = {(k.x, k.y, k.z): e.point_count for k, e in entries.items() if k.level == level}
            cells, counts = np.unique(cells, axis=0, return_counts=True)
            assert dict(zip(map(tuple, cells.tolist()), counts.tolist(), strict=True)) == expected


@pytest.mark.parametrize("levels_by", ["order", "even"])
def test_coarse_nodes_hold_the_first_points_around_them(tmp_path, levels_by):
    """Each full node holds points that come before those of the nodes below it, unless these nodes were few."""
    rng = np.random.default_rng(0)
    points = rng.permutation(rng.uniform(0, 99, (N, 3)) * [1, 1, 0.1]).round(2)
    gppcs.write(tmp_path / "a.copc.laz", gppcs.PointCloud(points, {"gps_time": np.arange(N)}), levels_by=levels_by)
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        first = np.sort(reader.query(level=0).gps_time)[:FULL]
        assert (first.tolist() == list(range(FULL))) == (levels_by == "order")
        order = {entry.key: entry.offset for entry in reader.root_page.entries.values()}
        assert sorted(order, key=order.get) == sorted(order, key=lambda key: (key.level, order[key]))
        assert reader.copc_info.spacing == pytest.approx(99 / np.sqrt(FULL), rel=0.25)
        for level in range(2):
            assert len(
                gppcs.open(tmp_path / "a.copc.laz", resolution=reader.copc_info.spacing / 2**level).read()
            ) == len(reader.query(level=range(level + 1)))


@pytest.mark.parametrize("name", ["fan", "bracket", "medallion"])
def test_levels_of_a_scan_that_has_no_ranking_are_better_than_random_ones(tmp_path, name):
    """Scanners write neighbours one after the other, so the first points of their files are one end of the scan."""
    cloud = gppcs.sample(name, n_points=N)
    cloud = gppcs.PointCloud(cloud.points[np.argsort(cloud.points[:, 0])].round(4))
    shuffled = cloud.take(np.random.default_rng(0).permutation(N))
    gppcs.write(tmp_path / "even.copc.laz", cloud)
    gppcs.write(tmp_path / "random.copc.laz", shuffled, levels_by="order")
    for level in range(1, 3):
        distances = []
        for kind in ("even", "random"):
            with laspy.CopcReader.open(tmp_path / f"{kind}.copc.laz") as reader:
                shown = reader.query(level=range(level))
            tree = cKDTree(np.column_stack([shown.x, shown.y, shown.z]))
            distances.append(tree.query(cloud.points)[0].mean())
        assert distances[0] < 0.97 * distances[1]


def test_levels_follow_the_ranking_that_a_result_has(tmp_path):
    result = gppcs.simplify(gppcs.sample("bracket", n_points=N), n_points=N // 4, method="random")
    rank = np.arange(len(result), dtype=np.uint32)
    mixed = np.random.default_rng(0).permutation(len(result))
    kept = gppcs.PointCloud(result.points, {"gps_time": rank})
    gppcs.write(tmp_path / "result.copc.laz", dataclasses.replace(result, cloud=kept))
    gppcs.write(tmp_path / "rank.copc.laz", gppcs.PointCloud(result.points, {"rank": rank, "gps_time": rank})[mixed])
    gppcs.write(
        tmp_path / "table.copc.laz", pandas.DataFrame({**dict(zip("xyz", np.eye(3), strict=True)), "ranked": [1, 2, 3]})
    )
    for name in ("result", "rank"):
        with laspy.CopcReader.open(tmp_path / f"{name}.copc.laz") as reader:
            assert np.sort(reader.query(level=0).gps_time)[:FULL].tolist() == list(range(FULL))


@pytest.mark.parametrize("n", [0, 1, 2, LARGEST])
def test_few_points_are_one_node(tmp_path, n):
    cloud = gppcs.PointCloud(np.arange(3.0 * n).reshape(n, 3) % 700)
    gppcs.write(tmp_path / "a.copc.laz", cloud)
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        assert len(reader.query()) == n
        assert len(reader.root_page.entries) == 1


def test_points_at_one_place_fill_level_after_level(tmp_path):
    gppcs.write(tmp_path / "a.copc.laz", np.ones((5 * FULL, 3)))
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        assert [len(reader.query(level=level)) for level in range(6)] == [FULL] * 5 + [0]


@pytest.mark.oracle
@pytest.mark.parametrize("point_format", [6, 7, 8])
def test_copclib_finds_the_file_valid_and_reads_the_same_points(tmp_path, point_format):
    copclib = pytest.importorskip("copclib")
    cloud, _ = scan(tmp_path, point_format)
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="even")
    reader = copclib.FileReader(str(tmp_path / "a.copc.laz"))
    assert reader.ValidateSpatialBounds()
    assert reader.copc_config.las_header.point_count == N
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as ours:
        assert reader.copc_config.copc_info.spacing == ours.copc_info.spacing
        found = b"".join(bytes(reader.GetPointData(node)) for node in reader.GetAllNodes())
        record = f"V{ours.header.point_format.size}"
        assert sorted(np.frombuffer(found, record).tolist()) == sorted(ours.query().array.view(record).tolist())


@pytest.mark.oracle
@pytest.mark.parametrize("seed", range(5))
def test_copclib_finds_borders_where_points_lie_on_them(tmp_path, seed):
    """The borders of cells are multiples of the scale of the coordinates, and most of them are rounded."""
    copclib = pytest.importorskip("copclib")
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 513, (N, 3)) * [1, 1, 0.5]
    points[:2] = [[0], [512]]
    offset = [500_000.31, 5_400_000.17, 100.03] + np.round(rng.uniform(-9e5, 9e5, 3), 2) * (seed > 0)
    gppcs.write(tmp_path / "a.copc.laz", points * 0.01 + offset, levels_by="even")
    assert copclib.FileReader(str(tmp_path / "a.copc.laz")).ValidateSpatialBounds()


SCRIPT = """
import { Copc } from "copc"
import { open } from "node:fs/promises"
const file = await open(process.argv[2])
const get = async (begin, end) => (await file.read(Buffer.alloc(end - begin), 0, end - begin, begin)).buffer
const copc = await Copc.create(get)
const { nodes } = await Copc.loadHierarchyPage(get, copc.info.rootHierarchyPage)
const names = process.argv.slice(3)
const points = []
for (const node of Object.values(nodes).filter((node) => node.pointCount)) {
  const view = await Copc.loadPointDataView(get, copc, node)
  const values = names.map(view.getter)
  for (let i = 0; i < view.pointCount; i++) points.push(values.map((value) => value(i)))
}
console.log(JSON.stringify({ info: copc.info, wkt: copc.wkt, points }))
"""


@pytest.mark.parametrize("point_format", [6, 8])
def test_the_javascript_library_copc_reads_all_points(tmp_path, point_format):
    node, packages = shutil.which("node"), VIEWER / "node_modules"
    if not node or not (packages / "copc").is_dir():
        needed = "node" in os.environ.get("GPPCS_CI_NEEDS", "").split(",")
        (pytest.fail if needed else pytest.skip)("no Node.js with the package copc: run npm ci in viewer")
    cloud, las = scan(tmp_path, point_format)
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="even")
    (tmp_path / "read.mjs").write_text(SCRIPT)
    (tmp_path / "node_modules").symlink_to(packages)
    expected = {"X": las.x, "Y": las.y, "Z": las.z, "Intensity": las.intensity, "GpsTime": las.gps_time}
    expected |= {"ReturnNumber": las.return_number, "Classification": las.classification}
    expected |= {"Red": las.red, "Infrared": las.nir} if point_format > 7 else {}
    expected |= {f"of {kind}": las[f"of {kind}"] for kind in KINDS if kind[1] != "8"} | {"three_2": las.three[:, 2]}
    run = subprocess.run([node, tmp_path / "read.mjs", tmp_path / "a.copc.laz", *expected], capture_output=True)
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found["wkt"] == WKT
    assert found["info"]["gpsTimeRange"] == [las.gps_time.min(), las.gps_time.max()]
    points, expected = np.array(found["points"]), np.column_stack([*expected.values()])
    np.testing.assert_allclose(points[np.lexsort(points.T)], expected[np.lexsort(expected.T)], rtol=1e-12)
