"""`gppcs simplify` of several inputs as one cloud, within a given memory, and without doing anything."""

import json

import numpy as np
import pytest

import gppcs
from command_line import FAST, assert_one_line, files

LARGE = ("--memory", "1GB")


@pytest.fixture
def parts(scan):
    gppcs.write("a.ply", scan.take(np.arange(150)))
    gppcs.write("b.ply", scan.take(np.arange(150, 400)))
    return scan


@pytest.fixture
def large(monkeypatch):
    """Let `gp` take more memory than there is, unless it goes in passes, and measure a sample of few points."""
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr("gppcs.gp.local.survey.LARGE", 50)


def test_inputs_are_one_cloud_with_merge(gppcs_command, parts):
    code, out, err = gppcs_command("simplify", "a.ply", "b.ply", "--merge", "-o", "out.ply", "--points", 40, *FAST)
    assert (code, err) == (0, "")
    assert out.startswith("a.ply and 1 more → out.ply\n")
    assert "400 in, 40 out" in out
    assert gppcs.read("out.ply") == gppcs.simplify(parts, n_points=40, method="fps").cloud


@pytest.mark.parametrize("names", [["scan.ply"], ["a.ply", "b.ply", "--merge"]])
def test_a_large_cloud_is_read_in_passes(gppcs_command, parts, large, names):
    arguments = ("simplify", *names, "-o", "out.ply", "--points", 2, "--scores", "--json", *LARGE)
    code, out, err = gppcs_command(*arguments)
    assert (code, err) == (0, "")
    record = json.loads(out)
    assert record["input"] == (names[0] if len(names) == 1 else names[:2])
    assert (record["points_in"], record["points_out"], record["passes"]) == (400, 2, 4)
    assert gppcs.read("out.ply") == gppcs.simplify(parts, n_points=2, scores=True).cloud
    code, out, _ = gppcs_command("simplify", *names, "-o", "out.ply", "--points", 2, "--force", *LARGE)
    assert "4 or more over the files" in out


def test_a_dry_run_tells_and_does_nothing(gppcs_command, parts, large):
    before = files()
    arguments = ("simplify", "scan.ply", "-o", "out.ply", "--points", 2, "--dry-run")
    code, out, err = gppcs_command(*arguments, "--json", *LARGE)
    assert (code, err) == (0, "")
    record = json.loads(out)
    assert (record["points_in"], record["points_out"]) == (400, 2)
    assert (record["in_memory"], record["passes"], record["memory_limit"]) == (False, 4, 10**9)
    assert 0 < record["memory"] < 10**9
    assert record["seconds"] > 0
    code, out, err = gppcs_command(*arguments, *LARGE)
    assert (code, err) == (0, "")
    assert "about 400 in, 2 out" in out
    assert "in 4 passes over the files" in out
    assert "of 1 GB allowed" in out
    code, out, _ = gppcs_command(*arguments, "--method", "fps")
    assert "in memory" in out
    assert "unknown for this method" in out
    assert files() == before


@pytest.mark.parametrize(
    ("options", "parts_of_message"),
    [
        (["--memory", "lots"], ["expected an amount of memory such as 4GB or 512MB, found 'lots'"]),
        (["--memory", "0.8"], ["expected an amount of memory such as 4GB or 512MB, found '0.8'"]),
        (["--memory", "1MB"], ["scan.ply", "expected at least", "MB of memory", "found 1 MB", "--memory"]),
        (["--figures", *LARGE], ["--figures takes all points at once", "found 1 GB"]),
        (["--normals", *LARGE], ["--normals takes all points at once"]),
        (["--report", "page.html", *LARGE], ["--report takes all points at once", "found 1 GB"]),
    ],
)
def test_too_little_memory_is_one_line(gppcs_command, scan, large, options, parts_of_message):
    result = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 2, *options)
    assert_one_line(result, *parts_of_message)
    assert files() == ["scan.ply"]


WITHOUT_OUTLIERS = [["--points", 60], ["--ratio", "2%", "--keep", "z > 69.9"], ["--points", 60, "--weight", "red"]]


@pytest.mark.parametrize("options", WITHOUT_OUTLIERS, ids=str)
@pytest.mark.parametrize("names", [["stray.ply"], ["a.ply", "b.ply", "--merge"]], ids=["one", "two"])
def test_outliers_are_left_out_in_passes_as_in_memory(gppcs_command, folder, monkeypatch, names, options):
    """The same bytes in both files, and the same record but for what a run costs."""
    cloud = gppcs.sample("bracket", 4_000, outliers=0.02)
    gppcs.write("stray.ply", cloud)
    gppcs.write("a.ply", cloud.take(np.arange(1_500)))
    gppcs.write("b.ply", cloud.take(np.arange(1_500, 4_000)))
    monkeypatch.setattr("gppcs.gp.local.survey.LARGE", 1_500)
    words = ["simplify", *names, *options, "--index-attribute", "row", "--json", *LARGE]
    records = []
    for run in ("memory", "passes"):
        if run == "passes":
            monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 10**12)
            monkeypatch.setattr("gppcs.surface.outliers.tiles.TILE", 1_000)
            monkeypatch.setattr("gppcs.spatial.stored.BOX", 300)
        code, out, err = gppcs_command(*words, "-o", f"{run}.ply", "--outliers", f"{run}-outliers.ply")
        assert (code, err) == (0, "")
        records.append(json.loads(out))
    for name in ("{}.ply", "{}-outliers.ply"):
        assert (folder / name.format("memory")).read_bytes() == (folder / name.format("passes")).read_bytes()
    for name in ("points_in", "points_out", "parameters", "diagnostics"):
        assert records[0][name] == records[1][name]
    assert [record["passes"] > 7 for record in records] == [False, "--weight" in options]
    assert gppcs.read("passes-outliers.ply") == cloud[gppcs.find_outliers(cloud)]
    assert records[1]["points_in"] == 4_000 - records[1]["diagnostics"]["outliers"]


def test_a_dry_run_does_not_look_for_outliers(gppcs_command, scan, large, monkeypatch):
    monkeypatch.setattr("gppcs.streaming.outliers.OutlierSearch.found", None)
    words = ("simplify", "scan.ply", "-o", "out.ply", "--points", 2, "--dry-run", "--json", *LARGE)
    plain, more = (json.loads(gppcs_command(*words, *options)[1]) for options in ([], ["--drop-outliers"]))
    assert (plain["passes"], more["passes"]) == (4, 7)
    assert plain["disk"] < more["disk"]
    assert files() == ["scan.ply"]


def test_what_the_list_of_outliers_cannot_hold_is_told_before_the_passes(gppcs_command, scan, large, monkeypatch):
    monkeypatch.setattr("gppcs.streaming.passes.simplify_in_passes", None)
    result = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--outliers", "out.obj", "--points", 2, *LARGE)
    assert_one_line(result, "OBJ cannot hold: attribute")
    assert files() == ["scan.ply"]


@pytest.mark.parametrize(
    ("options", "parts_of_message"),
    [
        (["--points", 2, "--weight", "rad"], ["the cloud has no attribute 'rad'", "did you mean 'red'"]),
        (["--points", 2, "--keep", "rad > 1"], ["no attribute 'rad'", "did you mean 'red'"]),
        (["--max-gap", "2m"], ["does not say in which unit", "--unit m"]),
    ],
)
def test_what_the_first_points_tell_is_told_before_all_else(
    gppcs_command, scan, large, monkeypatch, options, parts_of_message
):
    """Also where there is too little memory for the work."""
    monkeypatch.setattr("gppcs.streaming.asked.count_in_passes", None)
    for memory in ("1MB", "1GB"):
        result = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--memory", memory, *options)
        assert_one_line(result, *parts_of_message)


def test_what_the_output_cannot_hold_is_told_before_the_passes(gppcs_command, scan, large, monkeypatch):
    monkeypatch.setattr("gppcs.streaming.passes.simplify_in_passes", None)
    result = gppcs_command("simplify", "scan.ply", "-o", "out.obj", "--points", 2, *LARGE)
    assert_one_line(result, "OBJ cannot hold: attribute")


def test_files_that_do_not_fit_each_other(gppcs_command, parts):
    gppcs.write("c.ply", gppcs.PointCloud(parts.points))
    result = gppcs_command("simplify", "a.ply", "c.ply", "--merge", "-o", "out.ply", "--points", 2)
    assert_one_line(result, "c.ply: expected the same attributes in all files of a cloud", "curvature")
    assert "out.ply" not in files()


MERGED = ("simplify", "a.las", "b.las", "--merge", "-o", "out.las", "--points", 2, "-q")


def test_files_with_different_coordinate_systems(gppcs_command, two_systems):
    """They are merged only if the user says that it is the same system under two names."""
    result = gppcs_command(*MERGED)
    assert_one_line(result, "b.las: expected one coordinate system", "found UTM 32N and ETRS89", "--assume-same-crs")
    assert "out.las" not in files()
    assert gppcs_command(*MERGED, "--assume-same-crs") == (0, "", "")
    assert gppcs.info("out.las").crs == "UTM 32N"


def test_files_with_different_coordinate_systems_in_passes(gppcs_command, two_systems, large):
    result = gppcs_command(*MERGED, *LARGE)
    assert_one_line(result, "expected one coordinate system", "--assume-same-crs")
    assert gppcs_command(*MERGED, *LARGE, "--assume-same-crs") == (0, "", "")
    assert gppcs.info("out.las").crs == "UTM 32N"
