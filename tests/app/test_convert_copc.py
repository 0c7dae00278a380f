"""COPC files of clouds larger than memory."""

import json

import laspy
import numpy as np
import pytest

import gppcs
from gppcs.io import copc_writing
from gppcs.streaming import copc

N, ROOT, MOST = 30_000, 500, 1500


@pytest.fixture(autouse=True)
def beyond_memory(monkeypatch):
    """Let no method fit into memory, and make nodes, blocks and chunks small."""
    for method in gppcs.METHODS.values():
        monkeypatch.setattr(method, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr(copc_writing, "ROOT", ROOT)
    monkeypatch.setattr(copc_writing, "MOST", MOST)
    monkeypatch.setattr(copc, "BLOCK", 7_000)
    monkeypatch.setattr(copc, "GRID", 4)


def tiles(names, formats=(3, 3)):
    """Two tiles of hilly ground."""
    rng = np.random.default_rng(1)
    for number, (name, point_format) in enumerate(zip(names, formats, strict=True)):
        las = laspy.LasData(laspy.LasHeader(point_format=point_format, version="1.2"))
        las.header.scales, las.header.offsets = [0.01] * 3, [500_000, 0, 0]
        x, y = rng.uniform(0, 100, (2, N // 2))
        las.x, las.y, las.z = 500_000 + 100 * number + x, y, 5 * np.sin(x / 9) + rng.normal(0, 0.1, len(x))
        las.intensity = rng.integers(0, 2**16, len(x))
        las.scan_angle_rank = rng.integers(-90, 90, len(x))
        las.gps_time = number * N + np.arange(len(x)) / 7
        if point_format == 3:
            las.red = rng.integers(0, 2**16, len(x))
        las.write(name)
    features = [{"type": "Feature", "assets": {"data": {"href": f"./{name}"}}} for name in names]
    return json.dumps({"type": "FeatureCollection", "features": features})


@pytest.mark.parametrize("method", ["gp", "random"])
def test_all_points_are_written_level_by_level(gppcs_command, folder, method):
    (folder / "scan.vpc").write_text(tiles(["a.laz", "b.laz"]))
    code, out, err = gppcs_command(
        "convert", "scan.vpc", "scan.copc.laz", "--levels-by", method, "--memory", "1GB", "--quiet"
    )
    assert (code, out) == (0, "")
    assert "point format 3 (it becomes 7)" in err
    cloud, found = gppcs.read("scan.vpc"), gppcs.read("scan.copc.laz")
    order = np.argsort(found.attributes["gps_time"])
    assert found.points[order].tobytes() == cloud.points.tobytes()
    for name, values in cloud.attributes.items():
        kept = found.attributes["scan_angle" if name == "scan_angle_rank" else name][order]
        np.testing.assert_array_equal(np.rint(kept * 0.006) if name == "scan_angle_rank" else kept, values)
    ranking = gppcs.simplify_files("scan.vpc", n_points=N // 4, method=method, memory="1GB").cloud.points
    with laspy.CopcReader.open("scan.copc.laz") as reader:
        counts = [entry.point_count for entry in reader.root_page.entries.values()]
        assert sum(counts) == N
        assert max(counts) <= MOST
        for level, count in enumerate([ROOT, 4 * ROOT]):
            seen = reader.query(level=range(level + 1))
            assert set(map(tuple, np.column_stack([seen.x, seen.y, seen.z]))) == set(map(tuple, ranking[:count]))
        mean = cloud.points.mean(axis=0)
        box = laspy.copc.Bounds(cloud.points.min(axis=0), mean)
        assert len(reader.query(bounds=box)) == (cloud.points <= mean).all(axis=1).sum()
        assert reader.header.mins.tolist() == cloud.points.min(axis=0).tolist()
        returns = np.bincount(cloud.attributes["return_number"], minlength=16)[1:]
        assert reader.header.number_of_points_by_return.tolist() == returns.tolist()


def test_points_that_are_not_finite_are_dropped_on_demand(gppcs_command, refused, folder):
    points = gppcs.sample("bracket", n_points=5000).points.round(2)
    points[7] = np.nan
    np.save(folder / "scan.npy", points)
    command = ("convert", "scan.npy", "scan.copc.laz", "--memory", "1GB", "--quiet")
    refused(command, "--drop invalid")
    code, _, err = gppcs_command(*command, "--drop", "invalid")
    assert code == 0
    assert "points with NaN or infinite coordinates (1)" in err
    assert len(gppcs.read("scan.copc.laz")) == 4999


def test_files_of_other_dimensions_are_refused(refused, folder):
    (folder / "scan.vpc").write_text(tiles(["a.laz", "b.laz"], (3, 1)))
    refused(("convert", "scan.vpc", "scan.copc.laz", "--memory", "1GB", "--quiet"))


def test_counts_divide_points_as_the_points_themselves_do(monkeypatch):
    """The cells of clusters close early, and nodes hold no more than they may."""
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.normal(0.3, 0.02, (9000, 3)), rng.random((21_000, 3))]).clip(0, 1)
    cube = copc_writing.Cube(np.zeros(3), 1.0)
    cells = cube.codes(points) >> 3 * (copc_writing.DEEPEST - copc.GRID)
    ranked = rng.permutation(N)[:5000]
    others = np.bincount(np.delete(cells, ranked), minlength=8**copc.GRID)
    levels = copc.levels_of_counts(cells[ranked], others)
    in_order = np.concatenate([points[ranked], np.delete(points, ranked, 0)])
    first = [np.sort(rows) for rows in copc_writing.levels_of(cube.codes(in_order), 5000)]
    for level in range(2):  # within the ranking
        assert np.flatnonzero(levels.of_ranked == level).tolist() == first[level].tolist()
    assert levels.ends == sorted(levels.ends)
    assert levels.ends[-1] == 1.0
