"""`gppcs simplify`: what it writes and prints, adds and marks, and what it leaves alone when some of its work fails."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import FAST, files, rows_of


@pytest.mark.parametrize("method", ["gp", "voxel"])
def test_simplify_writes_the_points_asked_for_with_all_they_carry(printed, scan, method):
    out = printed("simplify", "scan.ply", "-o", "out.ply", "--ratio", 0.1, "--method", method)
    assert "400 in, 40 out" in out
    assert files() == ["out.ply", "scan.ply"]
    expected, written = gppcs.simplify(scan, ratio=0.1, method=method), gppcs.read("out.ply")
    assert written == scan.take(expected.indices)
    assert list(written.attributes) == list(scan.attributes)


def test_simplify_json_is_one_strict_object_a_line(record, scan):
    options = ("--points", 40, "--method", "gp-spectral", "--set", "nu=inf")
    told = record("simplify", "scan.ply", "-o", "out.ply", *options)
    assert (told["input"], told["output"]) == ("scan.ply", "out.ply")
    assert (told["points_in"], told["points_out"], told["method"]) == (400, 40, "gp-spectral")
    defaults = dataclasses.asdict(gppcs.SpectralGP())
    assert told["parameters"] == defaults | {"nu": None}  # JSON has no infinity
    assert {"reading", "eigenfunctions", "greedy selection", "writing"} <= set(told["seconds"])
    assert min(*told["seconds"].values(), told["seconds_compiling"]) >= 0
    assert told["peak_memory"] > 1e7  # an interpreter with NumPy takes more
    assert told["version"] == gppcs.__version__


FPS = ("--points", 40, "--method", "fps")
ONLY = ("--only", "z > 5", "--drop-outliers")


@pytest.fixture(params=[(), ONLY], ids=["all points", "a part with outliers"])
def case(request, folder):
    """The options, the points that are read of scan.ply, and the rows of those that should be kept."""
    gppcs.write("scan.ply", gppcs.sample("bracket", 3000, outliers=0.01))
    read = gppcs.read("scan.ply")
    read = read[read.points[:, 2] > 5] if request.param else read
    clean = np.flatnonzero(~gppcs.find_outliers(read)) if request.param else np.arange(len(read))
    assert (len(clean) < len(read)) == bool(request.param)
    rows = clean[gppcs.simplify(read[clean], n_points=40, method="fps").indices]
    return ("simplify", "scan.ply", "-o", "out.ply", *FPS, *request.param), read, rows


def test_the_row_of_each_kept_point_is_added(printed, case):
    command, read, rows = case
    printed(*command, "--index")
    kept = gppcs.read("out.ply")
    assert kept.attributes["index"].tolist() == rows.tolist()
    assert (kept.points == read.points[rows]).all()


@pytest.mark.parametrize(
    ("suffix", "order"), [("laz", None), ("las", "importance"), ("ply", None), ("ply", "gps_time"), ("copc.laz", None)]
)
def test_las_keeps_the_order_of_the_input(printed, folder, suffix, order):
    cloud = gppcs.sample("bracket", 3000)
    times = np.random.default_rng(0).permutation(3000) * 0.5
    gppcs.write("scan.ply", gppcs.PointCloud(cloud.points.round(4), {"gps_time": times}))
    options = ("--order", order) if order else ()
    command = ("simplify", "scan.ply", "--levels", "400,50", "--index", "--rank", "--lossy", *FAST, *options)
    for name in (f"out.{suffix}", f"out_{{level}}.{suffix}"):
        printed(*command, "-o", name)
    ranking = gppcs.simplify("scan.ply", n_points=400, method="fps").indices
    by_rank = {"importance": np.arange(400), "input": np.argsort(ranking), "gps_time": np.argsort(times[ranking])}
    expected = by_rank[order or ("input" if suffix == "laz" else "importance")]
    for name, count in ((f"out.{suffix}", 400), (f"out_0.{suffix}", 50), (f"out_1.{suffix}", 400)):
        attributes = gppcs.read(name).attributes
        ranks = attributes["rank"].astype(int)
        if suffix != "copc.laz":  # whose points are sorted by its levels
            assert ranks.tolist() == expected[expected < count].tolist()
        assert (attributes["index"] == ranking[ranks]).all()
        assert (attributes["gps_time"] == times[ranking[ranks]]).all()


def test_what_matters_is_printed(printed, folder):
    for noise, is_printed in ((0.0, False), (0.5, True)):
        gppcs.write("scan.ply", gppcs.sample("bracket", 20_000, noise=noise), force=True)
        command = ("simplify", "scan.ply", "-o", "out.ply", "--points", 2_000, "--force")
        rows = rows_of(printed(*command, "--only", "z > 0"))
        assert any(row.startswith("noise ") for row in rows) == is_printed
        assert not any("times" in row for row in rows)  # the files were read more than once
    rows = rows_of(
        printed("simplify", "scan.ply", "-o", "out.ply", "--max-gap", "2cm", "--unit", "mm", *FAST, "--force")
    )
    assert any(row.endswith("(asked: 2cm = 20 mm)") for row in rows)


def test_all_points_are_written_with_a_mark_for_those_kept(printed, case):
    command, read, rows = case
    assert ", 40 out" in printed(*command, "--mark", "chosen")
    marked = gppcs.read("out.ply")
    assert np.flatnonzero(marked.attributes.pop("chosen")).tolist() == sorted(rows)
    assert marked == read


def test_one_bad_file_does_not_cost_the_others(gppcs_command, scan):
    gppcs.write("done.ply", scan)
    Path("broken.ply").write_bytes(Path("done.ply").read_bytes()[:-10])
    gppcs.write("empty.ply", scan[:0])
    Path("results").mkdir()
    Path("results/done.ply").write_text("old")
    inputs = ["broken.ply", "missing.ply", "empty.ply", "done.ply", "scan.ply"]
    code, out, err = gppcs_command("simplify", *inputs, "-o", "results", "--separately", "--points", 9, "--json", *FAST)
    assert (code, [json.loads(line)["input"] for line in out.splitlines()]) == (2, ["scan.ply"])
    named = ["broken.ply", "missing.ply", "empty.ply", "results/done.ply"]
    assert [line.split(": ")[1] for line in err.splitlines()] == named
    assert len(gppcs.read("results/scan.ply")) == 9
    assert sorted(path.name for path in Path("results").iterdir()) == ["done.ply", "scan.ply"]
    assert Path("results/done.ply").read_text() == "old"


def test_no_input_of_the_call_is_overwritten_through_a_link_in_the_folder(refused, scan):
    """The link has the name of one input and leads to another."""
    Path("results").mkdir()
    gppcs.write("more.ply", scan)
    Path("results/scan.ply").symlink_to(Path("more.ply").absolute())
    told = "results/scan.ply: expected a file that is no input, found an input"
    refused(("simplify", "scan.ply", "more.ply", "-o", "results", "--points", 5, "--force", *FAST), told)
