"""Interrupted work goes on from the steps that are done, and gives the same result."""

import errno
import subprocess
import sys
from collections import Counter
from functools import partial

import numpy as np
import pytest

import gppcs
from gppcs.engine.journal import Journal
from gppcs.engine.stages import Stages
from gppcs.streaming.scratch import scratch_folder

N = 6_000


class InterruptionError(Exception):
    pass


class Interrupt:
    """Interrupts a run where a stage makes its first step, the n-th time that the stage begins; notes all stages."""

    def __init__(self, stage=None, times=1):
        self.stage, self.times = stage, times
        self.seen = []
        self.steps = Counter()

    def started(self, stage, total):
        self.seen.append(stage)

    def advanced(self, steps):
        self.steps[self.seen[-1]] += steps
        if self.stage == self.seen[-1] and self.seen.count(self.stage) == self.times:
            raise InterruptionError

    def finished(self):
        pass


@pytest.fixture
def path(tmp_path, monkeypatch):
    """A file that seems too large for memory; the temporary files go to the folder `scratch` beside it."""
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr("gppcs.gp.local.survey.LARGE", 2_000)
    monkeypatch.setattr("gppcs.gp.tiled.ranking.TILE", 1_500)
    monkeypatch.setattr("gppcs.spatial.stored.BOX", 250)
    gppcs.write(tmp_path / "scan.npy", gppcs.sample("bracket", N, seed=3).points)
    (tmp_path / "scratch").mkdir()
    return tmp_path / "scan.npy"


@pytest.fixture
def in_tiles(monkeypatch):
    monkeypatch.setattr(gppcs.LocalGP, "memory_in_passes", lambda self, n, n_points: 10**12)


def run(path, n_points, listener=None, resume=True, **options):
    scratch = path.parent / "scratch"
    return gppcs.simplify_files(
        path, n_points=n_points, memory="3GB", scratch=scratch, resume=resume, stages=Stages(listener), **options
    )


def assert_goes_on(path, n_points, interrupt, done, **options):
    """Interrupt a run, and check that the next one gives the right result without the stages that are done."""
    expected = run(path, n_points, resume=False, **options)
    scratch = path.parent / "scratch"
    assert not list(scratch.iterdir())
    with pytest.raises(InterruptionError):
        run(path, n_points, interrupt, **options)
    assert len(list(scratch.iterdir())) == 1
    heard = Interrupt()
    found = run(path, n_points, heard, **options)
    np.testing.assert_array_equal(found.indices, expected.indices)
    assert found.cloud == expected.cloud
    assert found.diagnostics == expected.diagnostics
    assert not set(done) & set(heard.seen)
    assert not list(scratch.iterdir())
    return heard


@pytest.mark.parametrize(
    ("stage", "done"),
    [("bounds", []), ("candidates", ["bounds"]), ("kept points", ["bounds", "sample", "greedy selection"])],
)
def test_passes(path, stage, done):
    times = 2 if stage == "candidates" else 1  # the first measures the sample
    assert_goes_on(path, 70, Interrupt(stage, times), done)


@pytest.mark.parametrize(
    ("stage", "done"), [("weights", ["bounds"]), ("kept points", ["bounds", "weights", "greedy selection"])]
)
def test_passes_with_weights(path, stage, done):
    points = np.load(path)
    path = path.with_suffix(".ply")
    gppcs.write(path, gppcs.PointCloud(points, {"height": points[:, 2] - points[:, 2].min()}))
    assert_goes_on(path, 70, Interrupt(stage), done, weight="height")


def test_passes_that_reach_an_accuracy(path, monkeypatch):
    monkeypatch.setattr("gppcs.amounts.accuracy.FIRST", 100)
    assert_goes_on(path, None, Interrupt("kept points"), ["bounds", "greedy selection", "accuracy"], tolerance=9.0)
    assert_goes_on(path, None, Interrupt("accuracy", 2), ["bounds", "greedy selection"], tolerance=9.0)
    every, half = Interrupt(), Interrupt("accuracy", 8)
    run(path, None, every, tolerance=9.0)
    again = assert_goes_on(path, None, half, ["bounds", "greedy selection"], tolerance=9.0)
    assert half.steps["accuracy"] > 3 * N  # in at least four passes, of which the last is interrupted
    assert half.steps["accuracy"] + again.steps["accuracy"] == every.steps["accuracy"] + N


def test_memory_that_is_free_later_makes_no_difference(path, monkeypatch):
    monkeypatch.setattr("gppcs.amounts.accuracy.FIRST", 100)
    options = {"tolerance": 9.0, "scratch": path.parent / "scratch", "resume": True}
    monkeypatch.setattr("gppcs.streaming.plan.available_memory", lambda: 6 * 10**9)
    with pytest.raises(InterruptionError):
        gppcs.simplify_files(path, stages=Stages(Interrupt("kept points")), **options)
    monkeypatch.setattr("gppcs.streaming.plan.available_memory", lambda: 10**9)
    heard = Interrupt()
    gppcs.simplify_files(path, stages=Stages(heard), **options)
    assert heard.seen == ["kept points"]
    assert not list(options["scratch"].iterdir())


def test_passes_that_fill_gaps(path):
    assert_goes_on(path, 70, Interrupt("gaps", 2), ["bounds", "sample", "greedy selection"], max_gap=9.0)
    assert_goes_on(path, 70, Interrupt("kept points"), ["bounds", "greedy selection", "gaps"], max_gap=9.0)


@pytest.mark.parametrize(
    ("stage", "times", "done"),
    [
        ("boxes", 1, ["bounds"]),
        pytest.param("survey", 1, ["bounds", "sample", "boxes"], marks=pytest.mark.slow),
        pytest.param("candidates", 1, ["bounds", "boxes", "survey"], marks=pytest.mark.slow),
        pytest.param("features", 3, ["survey", "candidates"], marks=pytest.mark.slow),
        ("greedy selection", 5, ["survey", "candidates"]),
        ("kept points", 1, ["boxes", "survey", "candidates", "greedy selection"]),
    ],
)
def test_tiles(path, in_tiles, stage, times, done):
    heard = assert_goes_on(path, 1_000, Interrupt(stage, times), done)
    if stage == "greedy selection":  # there are five stages: 63, 125, 250, 500 and 1,000 points
        assert heard.seen.count(stage) == 1


@pytest.mark.parametrize("method", ["voxel", "fps"])
def test_other_methods(path, monkeypatch, method):
    for kind in (gppcs.Voxel, gppcs.FarthestPoint):
        monkeypatch.setattr(kind, "memory", lambda self, n, n_points: 10**12)
    expected = run(path, 300, resume=False, method=method)
    with pytest.raises(InterruptionError):
        run(path, 300, Interrupt("boxes"), method=method)
    np.testing.assert_array_equal(run(path, 300, method=method).indices, expected.indices)


def test_other_files_and_parameters_begin_anew(path):
    with pytest.raises(InterruptionError):
        run(path, 70, Interrupt("kept points"))
    heard = Interrupt()
    run(path, 71, heard)
    assert "bounds" in heard.seen
    gppcs.write(path, gppcs.sample("bracket", N, seed=4).points, force=True)
    expected = gppcs.simplify(path, n_points=70).indices
    np.testing.assert_array_equal(run(path, 70).indices, expected)


HOLD = """
import sys, time
from pathlib import Path
from gppcs.streaming.scratch import scratch_folder
with scratch_folder(Path(sys.argv[1]), 0, "gppcs-work") as folder:
    (folder / "step.done").touch()
    print("under way", flush=True)
    time.sleep(60)
"""


def test_a_second_run_is_told_that_the_first_is_under_way(tmp_path):
    """But a process that was killed holds nobody up, and what it has done is there."""
    with subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdout=subprocess.PIPE) as first:
        assert first.stdout.readline() == b"under way\n"
        with pytest.raises(gppcs.OutputError, match="found one under way; wait for it, or name another folder by scr"):
            scratch_folder(tmp_path, 0, "gppcs-work").__enter__()
        first.kill()
    assert (tmp_path / "gppcs-work" / "step.done").exists()
    with scratch_folder(tmp_path, 0, "gppcs-work") as folder:
        assert (folder / "step.done").exists()
    assert not list(tmp_path.iterdir())


def test_the_same_work_at_the_same_time_is_refused(path):
    """In a process, too: the first run calls the second one in the middle of a step."""
    refused = []

    class Twice(Interrupt):
        def advanced(self, steps):
            if not refused:
                with pytest.raises(gppcs.OutputError) as caught:
                    run(path, 70)
                refused.append(str(caught.value))

    run(path, 70, Twice())
    assert "under way" in refused[0]
    assert not list((path.parent / "scratch").iterdir())


def test_work_goes_on_where_files_cannot_be_locked(tmp_path, monkeypatch):
    def fail(file):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("gppcs.streaming.scratch.locks", fail)
    with scratch_folder(tmp_path, 0, "gppcs-work") as folder:
        assert folder.is_dir()
    assert not list(tmp_path.iterdir())


def test_too_little_space_for_kept_work_leaves_no_folder(tmp_path):
    with pytest.raises(gppcs.OutputError, match="of disk space"):
        scratch_folder(tmp_path, 10**18, "gppcs-work").__enter__()
    assert not list(tmp_path.iterdir())


def test_without_the_option_nothing_is_kept(path):
    with pytest.raises(InterruptionError):
        run(path, 70, Interrupt("kept points"), resume=False)
    assert not list((path.parent / "scratch").iterdir())


def test_a_step_is_done_once(tmp_path):
    done = []
    for _ in range(2):
        assert Journal(tmp_path).once("one", lambda: done.append(1) or len(done)) == 1
    with pytest.raises(ZeroDivisionError):
        Journal(tmp_path).once("two", lambda: 1 // 0)
    assert Journal(tmp_path).once("two", lambda: 5) == 5


def test_a_result_that_a_stopped_machine_left_incomplete_is_found_anew(tmp_path):
    for result in (1, 2):
        assert Journal(tmp_path).once("one", partial(list, range(result))) == list(range(result))
        [file] = tmp_path.iterdir()
        file.write_bytes(file.read_bytes()[:-3])
