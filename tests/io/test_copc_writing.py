"""COPC files that gppcs writes, as other programs read them."""

import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest

import gppcs
from gppcs.errors import FileFormatError, ParameterError
from gppcs.io import copc_levels, copc_writing, las_header, losses

VIEWER = Path(__file__).parents[2] / "viewer"
N, ROOT, MOST = 20_000, 500, 1000
KINDS = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
RAISED = {0: 6, 1: 6, 2: 7, 3: 7, 4: 6, 5: 7, 9: 6, 10: 8}
NEWER = ("overlap", "scanner_channel", "scan_angle", "gps_time")  # dimensions that old point formats may not have
KEYS = [[1, 1, 0, 1], [3072, 0, 1, 32633]]
WKT = 'PROJCS["here",GEOGCS["there"],UNIT["metre",1],AUTHORITY["EPSG","32633"]]'


@pytest.fixture(autouse=True)
def small_nodes(monkeypatch):
    for module in (copc_levels, copc_writing):
        monkeypatch.setattr(module, "MOST", MOST)
    monkeypatch.setattr(copc_levels, "ROOT", ROOT)


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


def places(records):
    return np.column_stack([records.x, records.y, records.z])


def values_of(records, wanted):
    """The dimension of laspy of a name, or one of its numbers: three_1 is the second of three."""
    if wanted in records.point_format.dimension_names:
        return np.asarray(records[wanted])
    name, number = wanted.rsplit("_", 1)
    return np.asarray(records[name])[:, int(number)]


def same_points(found, expected):
    """Check that two records of laspy hold the same points in any order, bit for bit."""
    orders = [np.lexsort([each["of u8"], each["of u4"]]) for each in (found, expected)]
    for name in found.point_format.dimension_names:
        ours = values_of(found, name)[orders[0]]
        if name == "scan_angle" and "scan_angle_rank" in expected.point_format.dimension_names:
            assert np.rint(ours * 0.006).tolist() == expected["scan_angle_rank"][orders[1]].tolist()
        elif name in NEWER and name not in expected.point_format.dimension_names:
            assert not ours.any()
        else:
            assert ours.tobytes() == values_of(expected, name)[orders[1]].tobytes(), name


@pytest.mark.parametrize("point_format", range(11))
def test_every_dimension_of_every_point_is_kept(tmp_path, point_format):
    cloud, las = scan(tmp_path, point_format, 5000)
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="random")
    names = {"three": 3, "both": 2}
    expected = {
        part
        for name in {*las.point_format.dimension_names} - {"scan_angle_rank"}
        for part in ([f"{name}_{i}" for i in range(names[name])] if name in names else [name])
    }
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        points = reader.query()
        assert reader.header.point_format.id == RAISED.get(point_format, point_format)
        assert {*points.point_format.dimension_names} - {*NEWER} == expected - {*NEWER}
        same_points(points, las.points)
        assert [vlr.record_data_bytes() for vlr in reader.header.vlrs if vlr.user_id == "somebody"] == [b"kept"]
        np.testing.assert_array_equal(reader.header.scales, las.header.scales)
        assert reader.header.global_encoding.wkt
    times = np.fromfile(tmp_path / "a.copc.laz", "<f8", 2, offset=429 + 56).tolist()
    has_times = "gps_time" in las.point_format.dimension_names
    assert times == ([las.gps_time.min(), las.gps_time.max()] if has_times else [0, 0])


@pytest.mark.parametrize("point_format", range(11))
def test_what_changes_is_said(tmp_path, point_format):
    cloud, _ = scan(tmp_path, point_format, 10)
    several = [
        f"attribute {name} under one name (its numbers become {name}_0, {name}_1 and so on)"
        for name in ("three", "both")
    ]
    if point_format < 6:
        several.insert(0, "the name 'scan_angle_rank' (it becomes scan_angle)")
    assert losses("a.copc.laz", cloud) == several
    waves = with_waveforms(cloud)
    assert set(waves.header.contents()) - set(cloud.header.contents()) <= set(losses("a.copc.laz", waves))


def with_waveforms(cloud):
    """The cloud with a record of waveforms behind its points."""
    record = las_header.record_of(las_header.WAVEFORMS, b"", b"waves", extended=True)
    return replace(cloud, header=replace(cloud.header, records=(*cloud.header.records, record)))


@pytest.mark.parametrize("point_format", [6, 3])
def test_the_coordinate_system_is_kept(tmp_path, point_format):
    cloud, las = scan(tmp_path, point_format, 10)
    if point_format < 6:
        las.header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", np.array(KEYS, "<u2").tobytes()))
        las.write(tmp_path / "keys.las")
        cloud = gppcs.read(tmp_path / "keys.las")
    gppcs.write(tmp_path / "a.copc.laz", cloud)
    back = gppcs.read(tmp_path / "a.copc.laz")
    assert back.header.crs == cloud.header.crs == ("here (EPSG:32633)" if point_format > 5 else "EPSG:32633")
    kept = [each for each in cloud.header.records if each.kind != (b"LASF_Spec", 4)]
    assert [each for each in back.header.records if each.kind != (b"LASF_Spec", 4)] == kept


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


@pytest.mark.parametrize("method", ["gp", "fps", "order"])
def test_the_first_levels_are_the_first_points_of_the_ranking(tmp_path, method):
    cloud, _ = scan(tmp_path)
    gppcs.write(tmp_path / "a.copc.laz", cloud, **({} if method == "gp" else {"levels_by": method}))
    ranking = cloud if method == "order" else gppcs.simplify(cloud, n_points=N // 4, method=method).cloud
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        spacing = reader.copc_info.spacing
        for level, count in enumerate([ROOT, 4 * ROOT]):
            seen = places(reader.query(level=range(level + 1)))
            assert set(map(tuple, seen)) == set(map(tuple, ranking.points[:count]))
            assert len(gppcs.read(tmp_path / "a.copc.laz", resolution=spacing / 2**level)) == count
        assert spacing == pytest.approx(200 / np.sqrt(ROOT), rel=0.5)


@pytest.mark.parametrize("n", [0, 1, 2, MOST])
def test_few_points_are_one_node(tmp_path, n):
    cloud = gppcs.PointCloud(np.arange(3.0 * n).reshape(n, 3) % 700)
    gppcs.write(tmp_path / "a.copc.laz", cloud)
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        assert len(reader.query()) == n
        assert len(reader.root_page.entries) == 1


def test_bad_levels_are_refused(tmp_path):
    with pytest.raises(FileFormatError, match=r"a\.laz: expected a name that ends in \.copc\.laz"):
        gppcs.write(tmp_path / "a.laz", np.eye(3), levels_by="gp")
    with pytest.raises(ParameterError, match=r"levels_by to be 'gp' or .*, found 'voxel'"):
        gppcs.write(tmp_path / "a.copc.laz", np.eye(3), levels_by="voxel")
    assert not list(tmp_path.iterdir())


@pytest.mark.oracle
@pytest.mark.parametrize("point_format", [6, 7, 8])
def test_copclib_finds_the_file_valid_and_reads_the_same_points(tmp_path, point_format):
    copclib = pytest.importorskip("copclib")
    cloud, _ = scan(tmp_path, point_format)
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="random")
    reader = copclib.FileReader(str(tmp_path / "a.copc.laz"))
    assert reader.ValidateSpatialBounds()
    assert reader.copc_config.las_header.point_count == N
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as ours:
        assert reader.copc_config.copc_info.spacing == ours.copc_info.spacing
        found = b"".join(bytes(reader.GetPointData(node)) for node in reader.GetAllNodes())
        record = f"V{ours.header.point_format.size}"
        assert sorted(np.frombuffer(found, record).tolist()) == sorted(ours.query().array.view(record).tolist())


@pytest.mark.oracle
def test_copclib_finds_borders_where_points_lie_on_them(tmp_path):
    """The borders of cells are multiples of the scale of the coordinates, and most of them are rounded."""
    copclib = pytest.importorskip("copclib")
    points = np.random.default_rng(3).integers(0, 513, (N, 3)) * [1, 1, 0.5]
    points[:2] = [[0], [512]]
    gppcs.write(tmp_path / "a.copc.laz", points * 0.01 + [500_000.31, 5_400_000.17, 100.03], levels_by="random")
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


@pytest.mark.parametrize("point_format", [6, 7, 8])
def test_the_javascript_library_copc_reads_all_points(tmp_path, point_format):
    node, packages = shutil.which("node"), VIEWER / "node_modules"
    if not node or not (packages / "copc").is_dir():
        needed = "node" in os.environ.get("GPPCS_CI_NEEDS", "").split(",")
        (pytest.fail if needed else pytest.skip)("no Node.js with the package copc: run npm ci in viewer")
    cloud, las = scan(tmp_path, point_format)
    gppcs.write(tmp_path / "a.copc.laz", cloud, levels_by="random")
    (tmp_path / "read.mjs").write_text(SCRIPT)
    (tmp_path / "node_modules").symlink_to(packages)
    wanted = {"X": las.x, "Y": las.y, "Z": las.z, "Intensity": las.intensity, "GpsTime": las.gps_time}
    wanted |= {"ReturnNumber": las.return_number, "Classification": las.classification}
    wanted |= {"Red": las.red, "Blue": las.blue} if point_format > 6 else {}
    wanted |= {"Infrared": las.nir} if point_format > 7 else {}
    wanted |= {f"of {kind}": las[f"of {kind}"] for kind in KINDS if kind[1] != "8"} | {"three_2": las.three[:, 2]}
    run = subprocess.run([node, tmp_path / "read.mjs", tmp_path / "a.copc.laz", *wanted], capture_output=True)
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found["wkt"] == WKT
    assert found["info"]["gpsTimeRange"] == [las.gps_time.min(), las.gps_time.max()]
    points, expected = np.array(found["points"]), np.column_stack([*wanted.values()])
    np.testing.assert_allclose(points[np.lexsort(points.T)], expected[np.lexsort(expected.T)], rtol=1e-12)


def test_the_spacing_of_far_points_is_finite(tmp_path):
    points = gppcs.sample("bracket", n_points=2000).points
    spacings = []
    for factor in (1.0, 2.0**970):
        gppcs.write(tmp_path / "a.copc.laz", points * factor, lossy=True, force=True)
        with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
            spacings.append(reader.copc_info.spacing)
    assert spacings[1] / 2.0**970 == pytest.approx(spacings[0], rel=1e-6)
