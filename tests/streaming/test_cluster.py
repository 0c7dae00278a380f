"""Several workers: the same result for any number of them, also if one is killed."""

import os
import signal
import sys

import laspy
import numpy as np
import pytest

import gppcs
from copc_file import write_copc
from gppcs.engine.stages import Stages
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.query import Query
from gppcs.spatial.scaling import Frame
from gppcs.streaming import cluster
from gppcs.streaming.cluster import Cluster, local_cluster, scheduler_at
from gppcs.streaming.partitions import ClusterPasses
from gppcs.streaming.plan import Plan, Way
from gppcs.streaming.reading import FilePasses

distributed = pytest.importorskip("distributed")

N = 12_000
PARTS = (1, 700, 4_000, 4_500, 9_000, 11_000)


@pytest.fixture(scope="module")
def three():
    with (
        distributed.LocalCluster(n_workers=3, threads_per_worker=1, dashboard_address=":0") as started,
        distributed.Client(started) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def cloud():
    points = gppcs.sample("bracket", N, seed=3).points
    points[500:520, 1] = np.nan
    rows = np.arange(N, dtype=np.int32)
    return gppcs.PointCloud(points, {"row": rows, "ramp": rows % 300 / 300.0})


@pytest.fixture(scope="module")
def paths(cloud, tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    found = []
    for number, rows in enumerate(np.split(np.arange(N), PARTS)):
        found.append(folder / f"{number}.ply")
        gppcs.write(found[-1], cloud.take(rows))
    return found


@pytest.fixture(autouse=True)
def small_sample(monkeypatch):
    """Let a cloud of thousands be a large one. The workers do not look at this."""
    monkeypatch.setattr("gppcs.gp.local.survey.LARGE", 2_000)


def assert_same(found, expected):
    np.testing.assert_array_equal(found.indices, expected.indices)
    assert found.cloud == expected.cloud
    assert found.diagnostics == expected.diagnostics


@pytest.mark.parametrize("n_points", [1, 70, 3_000, 10**9])
def test_workers_choose_what_memory_chooses(three, cloud, paths, n_points):
    expected = gppcs.simplify(cloud, n_points=n_points, invalid="drop", scores=True)
    found = gppcs.simplify_files(paths, n_points=n_points, invalid="drop", scores=True, client=three)
    assert_same(found, expected)


ASKED = [
    {"spacing": 12.0},
    {"n_points": 200, "keep": "row % 900 < 9"},
    {"n_points": 150, "weight": "ramp"},
    {"n_points": 150, "weight": "ramp", "keep": "row % 900 < 9"},
    {"n_points": 60, "max_gap": 8.0},
    {"max_gap": 8.0, "weight": "ramp"},
]


@pytest.mark.slow
@pytest.mark.parametrize("wanted", ASKED)
def test_workers_find_what_is_asked_for(three, cloud, paths, wanted):
    expected = gppcs.simplify(cloud, invalid="drop", scores=True, **wanted)
    assert_same(gppcs.simplify_files(paths, invalid="drop", scores=True, client=three, **wanted), expected)


@pytest.mark.slow
def test_workers_find_an_accuracy(three, paths, monkeypatch):
    wanted = {"tolerance": 4.0, "invalid": "drop", "scores": True}
    monkeypatch.setattr("gppcs.gp.local.survey.PER_POINT", 8)
    monkeypatch.setattr("gppcs.amounts.accuracy.FIRST", 100)
    found = gppcs.simplify_files(paths, client=three, **wanted)
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr(gppcs.LocalGP, "memory_in_passes", lambda self, n, n_points: 0)
    assert_same(gppcs.simplify_files(paths, memory="3GB", **wanted), found)


@pytest.fixture
def small_parts(monkeypatch):
    """Let a part of a file be small; note how many there are of each run."""
    monkeypatch.setattr("gppcs.streaming.plan.ROWS", 1_000)
    monkeypatch.setattr("gppcs.streaming.plan.ROWS_PER_KEPT", 1)
    each, counts = CloudFiles.each, []

    def counted(*arguments):
        found = each(*arguments)
        counts.append(len(found))
        return found

    monkeypatch.setattr(CloudFiles, "each", counted)
    return counts


@pytest.fixture(scope="module")
def las(tmp_path_factory):
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.header.scales = [1e-5] * 3
    las.x, las.y, las.z = gppcs.sample("bracket", N, seed=3).points.T
    las.intensity = np.arange(N)
    return las


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.las", "a.copc.laz"])
@pytest.mark.parametrize("n_points", [70, 3_000])
def test_parts_of_a_file_make_no_difference(three, las, tmp_path, small_parts, name, n_points):
    path = tmp_path / name
    if name == "a.las":
        las.write(path)
    else:
        write_copc(path, las, 4, 20.0)
    expected = gppcs.simplify(gppcs.read(path), n_points=n_points, scores=True)
    assert_same(gppcs.simplify_files(path, n_points=n_points, scores=True, client=three), expected)
    assert small_parts == [12 if n_points == 70 else 4] or (name == "a.copc.laz" and small_parts[0] > 2)


def test_parts_of_a_file_grow_with_what_is_asked():
    """The limit of memory makes no difference, since --resume needs the same parts."""
    parts = [
        Plan(way, points, kept, 0, limit, rows).part
        for limit, rows in ((10**9, 10**6), (None, 10**5))
        for way, points, kept in (
            (Way.PASSES, 10**8, 10**3), (Way.PASSES, 10**8, 50_000), (Way.PASSES, 10**8, 10**6),
            (Way.TILES, 10**8, 10**7), (Way.PASSES, 10**12, 10),
        )
    ]  # fmt: skip
    assert parts == [1 << 20, 2_000_000, 1 << 22, 1 << 20, 10**8] * 2


@pytest.mark.parametrize("step", [1, 7, 5_000])
def test_places_from_workers(three, paths, step):
    with CloudFiles(paths) as files:
        passes = ClusterPasses(files, 1_000, Cluster(three), 1_000)
        seen = passes.overview(lambda steps: None)
        points = passes.points(seen, Frame.around(seen.low, seen.high))
        expected = np.concatenate(list(points.chunks()))
    np.testing.assert_array_equal(points.every(step), expected[::step])
    rows = np.unique(np.random.default_rng(step).integers(0, len(expected), 10_000 // step))
    np.testing.assert_array_equal(points.take(rows), expected[rows])


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_the_number_of_workers_makes_no_difference(cloud, paths, workers):
    expected = gppcs.simplify(cloud, n_points=70, invalid="drop")
    with local_cluster(workers) as some:
        assert_same(gppcs.simplify_files(paths, n_points=70, invalid="drop", client=some.client), expected)


@pytest.fixture
def small_tiles(monkeypatch):
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr(gppcs.LocalGP, "memory_in_passes", lambda self, n, n_points: 10**12)
    monkeypatch.setattr("gppcs.gp.tiled.ranking.TILE", 3_000)
    monkeypatch.setattr("gppcs.spatial.stored.BOX", 250)


class Killer:
    """Kills a worker when the first task of a stage is done."""

    def __init__(self, client, stage):
        self._client, self._stage = client, stage
        self._now = ""
        self.killed = 0

    def started(self, stage, total):
        self._now = stage

    def advanced(self, steps):
        if self._now == self._stage and not self.killed:
            self.killed = next(iter(self._client.run(os.getpid).values()))
            os.kill(self.killed, signal.SIGKILL)

    def finished(self):
        pass


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["bounds", "sample", "candidates", "kept points"])
def test_a_killed_worker_makes_no_difference(three, cloud, paths, stage):
    expected = gppcs.simplify(cloud, n_points=70, invalid="drop")
    killer = Killer(three, stage)
    found = gppcs.simplify_files(paths, n_points=70, invalid="drop", client=three, stages=Stages(killer))
    assert killer.killed
    assert_same(found, expected)


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["sample", "boxes", "survey", "candidates", "greedy selection"])
def test_a_worker_killed_in_tiles_makes_no_difference(three, paths, small_tiles, tmp_path, stage):
    expected = gppcs.simplify_files(paths, n_points=1_000, invalid="drop", memory="3GB")
    killer = Killer(three, stage)
    found = gppcs.simplify_files(
        paths, n_points=1_000, invalid="drop", memory="3GB", scratch=tmp_path, client=three, stages=Stages(killer)
    )
    assert killer.killed
    assert_same(found, expected)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_tiles_are_worked_on_by_workers_alone(three, paths, small_tiles, tmp_path, monkeypatch):
    """No points but the kept ones go through the client."""
    expected = gppcs.simplify_files(paths, n_points=1_000, invalid="drop", memory="3GB")

    def unread(*of, **options):
        pytest.fail("the client reads points")

    monkeypatch.setattr("gppcs.streaming.reading.FilePasses._usable_parts", unread)  # in this process
    options = {"invalid": "drop", "memory": "3GB", "scratch": tmp_path, "client": three}
    assert_same(gppcs.simplify_files(paths, n_points=1_000, **options), expected)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("method", ["random", "voxel", "fps"])
def test_other_methods(three, paths, method, tmp_path):
    found = gppcs.simplify_files(paths, n_points=300, method=method, invalid="drop", client=three)
    assert len(np.unique(found.indices)) == 300


@pytest.mark.slow
def test_workers_that_end_again_and_again_are_told(three):
    with pytest.raises(gppcs.ClusterError, match="the workers ended again and again during a task"):
        list(Cluster(three).each(signal.raise_signal, [signal.SIGKILL]))


def test_errors_of_workers_are_those_of_one_process(three, paths, tmp_path):
    with pytest.raises(gppcs.InputError, match="20 of 12000 points have coordinates that are NaN"):
        gppcs.simplify_files(paths, n_points=70, client=three)
    (tmp_path / "cut.ply").write_bytes(paths[2].read_bytes()[:-9])
    with pytest.raises(gppcs.FileFormatError, match=r"cut\.ply"):
        gppcs.simplify_files([paths[1], tmp_path / "cut.ply"], n_points=70, client=three)
    gppcs.write(tmp_path / "other.ply", np.eye(3))
    with pytest.raises(gppcs.FileFormatError, match="the same attributes in all files"):
        gppcs.simplify_files([paths[1], tmp_path / "other.ply"], n_points=2, client=three)
    with pytest.raises(FileNotFoundError):
        gppcs.simplify_files([paths[1], tmp_path / "none.ply"], n_points=2, client=three)


def test_work_that_cannot_be_shared_is_refused(three, paths):
    with pytest.raises(gppcs.InputError, match="several workers can share, but method 'hc' takes all points at once"):
        gppcs.simplify_files(paths, n_points=70, method="hc", client=three)
    with pytest.raises(gppcs.InputError, match="several workers can share, but normals takes all points at once"):
        gppcs.simplify_files(paths, n_points=70, normals=True, client=three)


def test_another_version_at_workers_is_refused(three, paths, monkeypatch):
    monkeypatch.setattr(gppcs, "__version__", "9.9")
    with pytest.raises(gppcs.ClusterError, match=r"expected gppcs 9\.9 at all workers, found gppcs .* at tcp://"):
        gppcs.simplify_files(paths, n_points=70, client=three)


def test_a_scheduler_that_does_not_answer(monkeypatch):
    monkeypatch.setattr(cluster, "TIMEOUT", "1s")
    with (
        pytest.raises(gppcs.ClusterError, match=r"expected a Dask scheduler at tcp://127\.0\.0\.1:9"),
        scheduler_at("tcp://127.0.0.1:9"),
    ):
        pass


@pytest.mark.slow
def test_a_scheduler_without_workers(monkeypatch):
    monkeypatch.setattr(cluster, "TIMEOUT", "2s")
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0") as started,
        pytest.raises(gppcs.ClusterError, match="expected at least one worker, found none"),
        scheduler_at(started.scheduler_address),
    ):
        pass


def test_a_client_is_a_client(paths):
    with pytest.raises(gppcs.ParameterError, match=r"expected a distributed\.Client, found 'localhost'"):
        gppcs.simplify_files(paths, n_points=70, client="localhost")


def test_without_dask(paths, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(gppcs.MissingExtraError, match=r"needs Dask's distributed.*\(the extra dask\): pip install"):
        gppcs.simplify_files(paths, n_points=70, client="anything")


def test_settings_of_files_reach_the_workers(three, tmp_path):
    """A part of the points, and one coordinate system for files that name two."""
    scan = gppcs.sample("bracket", 1_000)
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for path in paths:
        np.savetxt(path, scan.points, delimiter=",")
    box = Query.of((-50, -50, -50, 0, 50, 50), None)
    with CloudFiles(paths, "xyz", None, box) as files:
        expected = FilePasses(files, 300).overview(lambda steps: None)
        found = ClusterPasses(files, 300, Cluster(three), 300).overview(lambda steps: None)
    assert 0 < expected.count < 2_000
    assert (found.count, found.low.tolist(), found.high.tolist()) == (
        expected.count, expected.low.tolist(), expected.high.tolist()
    )  # fmt: skip


@pytest.mark.slow
def test_workers_leave_out_the_same_outliers(three, tmp_path, monkeypatch):
    """LAS files are divided into parts: others to count the points than to choose them."""
    monkeypatch.setattr("gppcs.streaming.plan.ROWS", 2_000)
    each, plain = [], CloudFiles.each
    monkeypatch.setattr(CloudFiles, "each", lambda *of: each.append(plain(*of)) or each[-1])
    cloud = gppcs.sample("bracket", N, seed=3, outliers=0.02)
    paths = [tmp_path / "a.las", tmp_path / "b.las"]
    for path, rows in zip(paths, np.split(np.arange(N), [5_000]), strict=True):
        gppcs.write(path, gppcs.PointCloud(cloud.points[rows].round(3)))
    whole = gppcs.PointCloud(np.concatenate([gppcs.read(path).points for path in paths]))
    for wanted in ({"n_points": 150}, {"max_gap": 9.0}):
        expected = gppcs.simplify(whole, drop_outliers=True, **wanted)
        found = gppcs.simplify_files(paths, drop_outliers=True, client=three, **wanted)
        np.testing.assert_array_equal(found.outliers, expected.outliers)
        np.testing.assert_array_equal(found.indices, expected.indices)
        assert found.diagnostics == expected.diagnostics
    assert len({len(parts) for parts in each}) > 1
    assert len(found.outliers) > 100
