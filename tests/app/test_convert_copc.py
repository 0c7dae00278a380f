"""COPC files of clouds larger than memory."""

import json

import laspy
import numpy as np
import pytest

import gppcs
from command_line import assert_one_line
from gppcs.io import copc_writing
from gppcs.streaming import copc
from las_file import las_of

N, FULL, LARGEST = 30_000, 500, 750


@pytest.fixture(autouse=True)
def beyond_memory(monkeypatch):
    """Let no cloud fit into memory, and make nodes, blocks and parts small."""
    monkeypatch.setattr(copc, "PROGRAM", 10**12)
    monkeypatch.setattr(copc, "PART", 4_000)
    for name, value in (("MOST", FULL), ("BLOCK", 7_000)):
        monkeypatch.setattr(copc_writing, name, value)


def tiles(names):
    """Two tiles of hilly ground."""
    rng = np.random.default_rng(1)
    for number, name in enumerate(names):
        x, y = rng.uniform(0, 100, (2, N // 2))
        z = 5 * np.sin(x / 9) + rng.normal(0, 0.1, len(x))
        las = las_of(np.column_stack([500_000 + 100 * number + x, y, z]), 3, offsets=[500_000, 0, 0])
        las.intensity = rng.integers(0, 2**16, len(x))
        las.scan_angle_rank = rng.integers(-90, 90, len(x))
        las.gps_time = number * N + np.arange(len(x)) / 7
        las.red = rng.integers(0, 2**16, len(x))
        las.write(name)
    features = [{"type": "Feature", "assets": {"data": {"href": f"./{name}"}}} for name in names]
    return json.dumps({"type": "FeatureCollection", "features": features})


@pytest.mark.parametrize("levels_by", ["order", "even"])
def test_all_points_are_written_level_by_level(gppcs_command, folder, levels_by):
    (folder / "scan.vpc").write_text(tiles(["a.laz", "b.laz"]))
    code, out, err = gppcs_command(
        "convert", "scan.vpc", "scan.copc.laz", "--levels-by", levels_by, "--memory", "1GB", "--quiet"
    )
    assert (code, out) == (0, "")
    assert "scan_angle_rank" in err
    cloud, found = gppcs.read("scan.vpc"), gppcs.read("scan.copc.laz")
    order = np.argsort(found.attributes["gps_time"])
    assert found.points[order].tobytes() == cloud.points.tobytes()
    for name, values in cloud.attributes.items():
        kept = found.attributes["scan_angle" if name == "scan_angle_rank" else name][order]
        np.testing.assert_array_equal(np.rint(kept * 0.006) if name == "scan_angle_rank" else kept, values)
    with laspy.CopcReader.open("scan.copc.laz") as reader:
        counts = [entry.point_count for entry in reader.root_page.entries.values()]
        assert sum(counts) == N
        assert max(counts) <= LARGEST
        times = np.sort(reader.query(level=0).gps_time)
        assert np.array_equal(times[:FULL], cloud.attributes["gps_time"][:FULL]) == (levels_by == "order")
        assert (times[-1] > N) == (levels_by == "even")  # also of the second tile
        mean = cloud.points.mean(axis=0)
        box = laspy.copc.Bounds(cloud.points.min(axis=0), mean)
        assert len(reader.query(bounds=box)) == (cloud.points <= mean).all(axis=1).sum()
        assert reader.header.mins.tolist() == cloud.points.min(axis=0).tolist()
        returns = np.bincount(cloud.attributes["return_number"], minlength=16)[1:]
        assert reader.header.number_of_points_by_return.tolist() == returns.tolist()


def test_a_simplified_cloud_has_its_ranking_as_levels(gppcs_command, folder):
    gppcs.write("scan.ply", gppcs.sample("bracket", n_points=9000))
    command = ("simplify", "scan.ply", "--points", 3000, "--method", "random", "--index", "--quiet", "--lossy")
    indices = gppcs.simplify("scan.ply", n_points=3000, method="random").indices
    for more, is_ranked in (((), True), (("--order", "input"), False)):
        assert gppcs_command(*command, "-o", "small.copc.laz", "--force", *more)[0] == 0
        with laspy.CopcReader.open("small.copc.laz") as reader:
            coarse = reader.query(level=0)["index"]
            assert (set(indices[:FULL]) <= set(coarse.tolist())) == is_ranked


def test_points_that_are_not_finite_are_dropped_on_demand(gppcs_command, refused, folder):
    points = gppcs.sample("bracket", n_points=5000).points.round(2)
    points[7] = np.nan
    np.save(folder / "scan.npy", points)
    command = ("convert", "scan.npy", "scan.copc.laz", "--memory", "1GB", "--quiet")
    refused(command, "invalid")
    code, _, err = gppcs_command(*command, "--invalid", "drop")
    assert code == 0
    assert "points with NaN or infinite coordinates (1)" in err
    assert len(gppcs.read("scan.copc.laz")) == 4999
    np.save(folder / "none.npy", np.full((9, 3), np.nan))
    refused(("convert", "none.npy", "none.copc.laz", "--invalid", "drop", "--quiet"), "found none")


def test_attributes_of_several_numbers_are_parted_and_intensities_to_scale_are_refused(gppcs_command, refused, folder):
    vectors = np.random.default_rng(0).random((5000, 3), dtype=np.float32)
    cloud = gppcs.PointCloud(vectors.round(2), {"velocity": vectors})
    gppcs.write("scan.las", cloud)
    command = ("convert", "scan.las", "scan.copc.laz", "--memory", "1GB", "--quiet")
    assert gppcs_command(*command)[0] == 0
    assert np.sort(gppcs.read("scan.copc.laz").attributes["velocity_1"]).tolist() == np.sort(vectors[:, 1]).tolist()
    for values in (vectors[:, 0], np.arange(5000) - 9):
        gppcs.write("scan.npz", gppcs.PointCloud(cloud.points, {"Intensity": values}), force=True)
        refused(("convert", "scan.npz", "other.copc.laz", *command[3:], "--lossy"), "16 bits")


def test_a_full_disk_leaves_the_old_file(gppcs_command, folder, monkeypatch):
    """Files of more than some bytes cannot be written here."""
    resource = pytest.importorskip("resource", reason="limits as on Unix")
    (folder / "scan.vpc").write_text(tiles(["a.laz", "b.laz"]))
    (folder / "scan.copc.laz").write_text("old")
    files, limits = sorted(folder.iterdir()), resource.getrlimit(resource.RLIMIT_FSIZE)
    # First the points on disk are too large, then, in memory, the COPC file itself.
    for limit, program in ((10**5, 10**12), (2 * 10**5, 0)):
        monkeypatch.setattr(copc, "PROGRAM", program)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limits[1]))
        try:
            result = gppcs_command("convert", "scan.vpc", "scan.copc.laz", "--force", "--quiet")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert_one_line(result, "written" if limit == 10**5 else "scan.copc.laz: expected space for the whole file")
        assert (folder / "scan.copc.laz").read_text() == "old"
        assert sorted(folder.iterdir()) == files
