"""`gppcs simplify` of several inputs as one cloud, within a given memory, and without doing anything."""

import json
import subprocess
import sys

import numpy as np
import pytest

import gppcs
from command_line import files, rows_of
from las_file import las_of

LARGE = ("--memory", "1GB")


@pytest.fixture
def parts(scan):
    gppcs.write("a.ply", scan.take(np.arange(150)))
    gppcs.write("b.ply", scan.take(np.arange(150, 400)))
    return scan


@pytest.fixture
def large(monkeypatch):
    """Let `gp` take more memory than there is, unless it goes tile by tile."""
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 10**12)


@pytest.mark.parametrize("names", [["scan.ply"], ["a.ply", "b.ply"]])
def test_the_points_of_a_large_cloud_go_to_disk(printed, record, parts, large, names):
    arguments = ("simplify", *names, "-o", "out.ply", "--points", 20, "--scores", "--index", *LARGE)
    told = record(*arguments)
    assert told["input"] == (names[0] if len(names) == 1 else names)
    assert (told["points_in"], told["points_out"], told["readings"]) == (400, 20, 3)
    kept = gppcs.read("out.ply")
    assert (kept.points == parts.points[kept.attributes["index"]]).all()
    assert (kept.attributes["red"] == parts.attributes["red"][kept.attributes["index"]]).all()
    assert len(kept) == 20
    rows = rows_of(printed(*arguments, "--force"))
    assert rows[0] == f"{names[0]}{' and 1 more' * (len(names) > 1)} → out.ply"
    assert "files read 3 times" in rows


def test_a_dry_run_tells_and_does_nothing(printed, record, parts, large):
    before = files()
    arguments = ("simplify", "scan.ply", "-o", "out.ply", "--points", 2, "--dry-run")
    told = record(*arguments, *LARGE)
    assert (told["points_in"], told["points_out"]) == (400, 2)
    assert (told["in_memory"], told["readings"], told["memory_limit"]) == (False, 3, 10**9)
    assert 0 < told["memory"] < 10**9
    assert told["disk"] > 0
    out = printed(*arguments, *LARGE)
    assert all(part in out for part in ("nothing is done", " 400 in, 2 out", "in tiles", "of 1 GB allowed"))
    assert "about 400" not in out
    assert "in memory" in printed(*arguments, "--method", "fps")
    assert files() == before


def test_a_dry_run_plans_files_of_one_cloud_together(record, parts):
    told = record("simplify", "a.ply", "b.ply", "-o", "out/", "--ratio", "10%", "--dry-run")
    assert (told["input"], told["points_in"], told["points_out"]) == (["a.ply", "b.ply"], 400, 40)


def test_files_of_one_cloud_count_the_points_among_which_is_chosen(record, parts):
    points = gppcs.read("a.ply").points
    points[:5, 2] = np.nan
    gppcs.write("a.ply", gppcs.PointCloud(points), force=True)
    gppcs.write("b.ply", gppcs.PointCloud(gppcs.read("b.ply").points), force=True)
    told = record("simplify", "a.ply", "b.ply", "-o", "out/", "--points", 40, "--invalid", "drop")
    assert (told["points_in"], told["points_out"]) == (395, 40)


@pytest.mark.parametrize(
    ("options", "parts_of_message"),
    [
        (["--memory", "1MB"], ["scan.ply", "expected at least", "MB of memory", "found 1 MB", "raise --memory"]),
        (["--mark", "kept", *LARGE], ["mark takes all points at once", "found 1 GB"]),
    ],
)
def test_too_little_memory_is_one_line(refused, scan, large, options, parts_of_message):
    refused(("simplify", "scan.ply", "-o", "out.ply", "--points", 2, *options), *parts_of_message)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "limit"), [("10k", "400MB"), ("50k", "450MB"), ("300k", "500MB")])
def test_the_plan_tells_the_memory_that_is_used(record, tmp_path, count, limit):
    """Within a quarter, and the limit is held."""
    rng = np.random.default_rng(0)
    x, y = 1_000 * rng.random((2, 5_000_000))
    points = np.column_stack([x, y, 10 * np.sin(x / 50) * np.cos(y / 70)])
    las_of(points, 3, [1e-3] * 3).write(tmp_path / "scan.las")
    words = ["simplify", "scan.las", "-o", "out.las", "--points", count, "--memory", limit, "--json", "--quiet"]

    def record(*more):
        command = [sys.executable, "-m", "gppcs", *words, *more]
        return json.loads(subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout)

    planned, used = record("--dry-run"), record()
    assert not planned["in_memory"]
    assert used["peak_memory"] <= planned["memory_limit"]
    assert planned["memory"] == pytest.approx(used["peak_memory"], rel=0.25)
