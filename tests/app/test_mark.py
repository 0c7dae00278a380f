"""`--add index` and `--add kept` of `gppcs simplify`."""

import numpy as np
import pytest

import gppcs

FPS = ("--points", 40, "--method", "fps")
ONLY = ("--only", "z > 5", "--drop", "outliers")


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
    printed(*command, "--add", "index")
    kept = gppcs.read("out.ply")
    assert kept.attributes["index"].tolist() == rows.tolist()
    assert (kept.points == read.points[rows]).all()


@pytest.mark.parametrize(("added", "name"), [("kept", "kept"), ("kept:chosen", "chosen")])
def test_all_points_are_written_with_a_mark_for_those_kept(printed, case, added, name):
    command, read, rows = case
    assert ", 40 out" in printed(*command, "--add", added)
    marked = gppcs.read("out.ply")
    assert np.flatnonzero(marked.attributes.pop(name)).tolist() == sorted(rows)
    assert marked == read


def test_points_that_are_dropped_need_not_be_held(gppcs_command, printed, folder):
    points = gppcs.sample("bracket", 400).points.round(2)
    points[7] = np.nan
    gppcs.write("bare.xyz", points)
    words = ["simplify", "bare.xyz", "-o", "out.las", "--lossy", "--drop", "invalid", "-q", *FPS]
    assert gppcs_command(*words, "--add", "kept")[0] == 2
    assert not (folder / "out.las").exists()
    assert printed(*words, "--add", "index") == ""
    assert 7 not in gppcs.read("out.las").attributes["index"]
