"""Files in, files out."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import gppcs
from gppcs.errors import OutputError
from gppcs.streaming.folder import Target

BEYOND = {"memory": "1GB"}


@pytest.fixture
def small_tiles(monkeypatch):
    """Let no method fit into memory, and cut clouds into small tiles."""
    for method in gppcs.METHODS.values():
        monkeypatch.setattr(method, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr("gppcs.streaming.beyond_memory.TILE", 2_000)


@pytest.fixture
def paths(tmp_path):
    """Two files of a cloud of 6,000 points."""
    return write_parts(tmp_path, gppcs.sample("bracket", 6_000))


def write_parts(folder, cloud):
    paths = [folder / "a.ply", folder / "b.ply"]
    for path, rows in zip(paths, (np.arange(2_500), np.arange(2_500, len(cloud))), strict=True):
        gppcs.write(path, cloud.take(rows), force=True)
    return paths


def stopped(monkeypatch, paths, output, **options):
    """Stop a run when the second file is about to be written."""
    with monkeypatch.context() as patch:
        write = Target.write

        def write_one(target, cloud, indices):
            if target.path.name == "b.ply":
                raise KeyboardInterrupt
            return write(target, cloud, indices)

        patch.setattr(Target, "write", write_one)
        with pytest.raises(KeyboardInterrupt):
            gppcs.simplify_tiles(paths, output, **options)


@pytest.mark.parametrize("memory", ["1GB", None])
def test_a_run_that_was_stopped_goes_on_to_the_points_of_one_cloud(tmp_path, paths, monkeypatch, request, memory):
    if memory:
        request.getfixturevalue("small_tiles")
    options = {"n_points": 300, "method": "fps", "memory": memory}
    whole = gppcs.simplify(paths, **options)
    stopped(monkeypatch, paths, tmp_path / "out", **options)
    with pytest.raises(OutputError, match="force"):
        gppcs.simplify_tiles(paths, tmp_path / "out", **{**options, "n_points": 200})
    written = gppcs.simplify_tiles(paths, tmp_path / "out", **options)
    kept = [gppcs.read(path) for path in written]
    assert [len(part) for part in kept] == [*written.values()]
    assert np.array_equal(np.concatenate([part.points for part in kept]), in_order_of_files(whole, 2_500))
    assert len(gppcs.read(tmp_path / "out" / "index.vpc")) == 300 == len(whole)
    assert not (tmp_path / "out" / ".gppcs").exists()


def in_order_of_files(result, first_of_second):
    """Return the kept points of the first file, then those of the second, each by importance."""
    is_second = result.indices >= first_of_second
    return np.concatenate([result.points[~is_second], result.points[is_second]])


def test_a_run_of_another_version_or_of_other_files_is_refused_until_forced(tmp_path, paths, monkeypatch):
    output, options = tmp_path / "out", {"n_points": 300, "method": "random"}
    stopped(monkeypatch, paths, output, **options)
    manifest = output / ".gppcs" / "manifest.json"
    content = json.loads(manifest.read_text())
    for name in ("version", "inputs"):
        manifest.write_text(json.dumps({**content, name: "other"}))
        with pytest.raises(OutputError, match=rf"{name} with which this run began.*force"):
            gppcs.simplify_tiles(paths, output, **options)
    assert sum(gppcs.simplify_tiles(paths, output, **options, force=True).values()) == 300


def test_bad_input_leaves_nothing_that_refuses_the_next_call(tmp_path):
    cloud = gppcs.sample("bracket", 6_000)
    cloud.points[7] = np.nan
    paths, output = write_parts(tmp_path, cloud), tmp_path / "out"
    with pytest.raises(gppcs.InputError, match="1 of 6000 points"):
        gppcs.simplify_tiles(paths, output, n_points=100, method="random")
    assert not output.exists()
    assert sum(gppcs.simplify_tiles(paths, output, n_points=100, method="random", invalid="drop").values()) == 100


def test_of_two_runs_in_one_folder_the_second_is_refused(tmp_path, paths, monkeypatch):
    pytest.importorskip("fcntl")
    options, write = {"n_points": 300, "method": "random"}, Target.write

    def write_during_another(target, cloud, indices):
        with pytest.raises(OutputError, match="another run"):
            gppcs.simplify_tiles(paths, tmp_path / "out", **options)
        return write(target, cloud, indices)

    monkeypatch.setattr(Target, "write", write_during_another)
    assert sum(gppcs.simplify_tiles(paths, tmp_path / "out", **options).values()) == 300


def test_an_index_of_the_user_is_not_overwritten(tmp_path, paths):
    index = tmp_path / "out" / "index.vpc"
    index.parent.mkdir()
    index.write_text("mine")
    with pytest.raises(OutputError, match=r"index.vpc: the file exists"):
        gppcs.simplify_tiles(paths, index.parent, n_points=100, method="random")
    assert index.read_text() == "mine"
    assert list(index.parent.iterdir()) == [index]


def test_an_output_that_is_no_folder_is_refused(tmp_path, paths):
    (tmp_path / "out").write_text("mine")
    for output in ("out", "out/inner"):
        with pytest.raises(OutputError, match="expected a folder"):
            gppcs.simplify_tiles(paths, tmp_path / output, n_points=100, method="random")
    assert (tmp_path / "out").read_text() == "mine"
    with pytest.raises(gppcs.ParameterError, match="name of a file or a path, found None"):
        gppcs.simplify_tiles(paths, None, n_points=100, method="random")


@pytest.mark.usefixtures("small_tiles")
def test_a_method_without_a_ranking_keeps_the_order_of_the_files(tmp_path, paths):
    for path in gppcs.simplify_tiles(paths, tmp_path / "out", n_points=400, method="voxel", **BEYOND):
        original, kept = gppcs.read(tmp_path / os.path.basename(path)).points, gppcs.read(path).points
        rows = {tuple(point): row for row, point in enumerate(original)}
        assert np.all(np.diff([rows[tuple(point)] for point in kept]) > 0)


@pytest.mark.usefixtures("small_tiles")
def test_temporary_files_go_to_the_folder_for_them(tmp_path, paths):
    options = {"n_points": 100, "method": "random", **BEYOND}
    with pytest.raises(OutputError, match="temporary files"):
        gppcs.simplify_tiles(paths, tmp_path / "out", scratch=tmp_path / "missing", **options)
    assert sum(gppcs.simplify_tiles(paths, tmp_path / "out", scratch=tmp_path, **options).values()) == 100


SCRIPT = """
import os, sys, gppcs
import gppcs.streaming.beyond_memory as beyond_memory, gppcs.streaming.rows as rows
gppcs.LocalGP.memory = lambda self, n, n_points: 10**12
beyond_memory.TILE = 2_000
write, count = rows.Rows.write, int(sys.argv[1])
def write_or_end(kept, path):
    global count
    if not count:
        os._exit(9)
    count -= 1
    write(kept, path)
rows.Rows.write = write_or_end
gppcs.simplify_tiles(sys.argv[3:], sys.argv[2], n_points=400, memory="1GB")
"""


@pytest.mark.slow
@pytest.mark.usefixtures("small_tiles")
def test_a_run_that_is_killed_goes_on_to_the_same_bytes(tmp_path, paths):
    def run(count, output):
        return subprocess.run([sys.executable, "-c", SCRIPT, str(count), output, *paths], check=False).returncode

    assert run(2, tmp_path / "out") == 9
    assert len(list((tmp_path / "out" / ".gppcs").glob("*-None-*.npz"))) == 2
    assert run(1_000, tmp_path / "out") == 0
    gppcs.simplify_tiles(paths, tmp_path / "whole", n_points=400, **BEYOND)
    for name in ("a.ply", "b.ply", "index.vpc"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


@pytest.mark.slow
@pytest.mark.usefixtures("small_tiles")
def test_workers_of_dask_one_of_which_is_killed_write_the_same_bytes(tmp_path, paths):
    distributed = pytest.importorskip("distributed")
    options = {"n_points": 400, **BEYOND}
    gppcs.simplify_tiles(paths, tmp_path / "own", **options)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        worker = next(iter(cluster.workers.values())).process.process.pid

        def kill_one():
            while not list((tmp_path / "out" / ".gppcs").glob("guide*.npz")):
                time.sleep(0.01)
            os.kill(worker, signal.SIGKILL)

        threading.Thread(target=kill_one, daemon=True).start()
        gppcs.simplify_tiles(paths, tmp_path / "out", workers=cluster.scheduler_address, **options)
    for name in ("a.ply", "b.ply", "index.vpc"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "own" / name).read_bytes()


def test_a_file_of_a_server_goes_into_a_folder_and_an_open_file_is_refused(tmp_path, paths):
    fsspec = pytest.importorskip("fsspec")
    files = fsspec.filesystem("memory")
    files.pipe("/tile.ply?key=1", paths[0].read_bytes())
    try:
        written = gppcs.simplify_tiles("memory://tile.ply?key=1", tmp_path / "out", n_points=9, method="random")
        assert written == {str(tmp_path / "out" / "tile.ply"): 9}
    finally:
        files.rm("/tile.ply?key=1")
    with paths[0].open("rb") as file, pytest.raises(gppcs.InputError, match="names of files"):
        gppcs.simplify_tiles(gppcs.open(file), tmp_path / "new", n_points=9)
    assert not (tmp_path / "new").exists()
