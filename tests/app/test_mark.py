"""`--add index` and `--add kept` of `gppcs simplify`."""

import numpy as np
import pytest

import gppcs
from command_line import assert_one_line

FPS = ["--points", 40, "--method", "fps"]


@pytest.fixture
def rows(scan):
    return gppcs.simplify(gppcs.read("scan.ply"), n_points=40, method="fps").indices


def test_the_row_of_each_kept_point_is_added(gppcs_command, rows):
    assert gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--add", "index", *FPS)[0] == 0
    kept, scan = gppcs.read("out.ply"), gppcs.read("scan.ply")
    assert kept.attributes["index"].tolist() == rows.tolist()
    assert (kept.points == scan.points[kept.attributes["index"]]).all()


def test_all_points_are_written_with_a_mark_for_those_kept(gppcs_command, rows):
    code, out, _ = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--add", "kept", *FPS)
    assert (code, "400 in, 40 out" in out) == (0, True)
    marked, scan = gppcs.read("out.ply"), gppcs.read("scan.ply")
    assert np.flatnonzero(marked.attributes["kept"]).tolist() == sorted(rows)
    assert (marked.points == scan.points).all()
    for name, values in scan.attributes.items():
        assert (marked.attributes[name] == values).all()


@pytest.fixture
def strays(folder):
    """Which points of stray.ply, of which some with z > 5 are outliers, have z > 5; and which are no outliers."""
    cloud = gppcs.sample("bracket", 3000, outliers=0.01)
    gppcs.write("stray.ply", cloud)
    part = cloud[cloud.points[:, 2] > 5]
    return part, ~gppcs.find_outliers(part)


ONLY = ["--only", "z > 5", "--drop", "outliers", *FPS]


def test_rows_are_those_of_the_points_that_are_read_outliers_included(gppcs_command, strays):
    part, clean = strays
    assert gppcs_command("simplify", "stray.ply", "-o", "out.ply", "--add", "index", *ONLY)[0] == 0
    kept = gppcs.read("out.ply")
    assert (kept.points == part.points[kept.attributes["index"]]).all()
    assert clean[kept.attributes["index"]].all()
    assert (~clean[: kept.attributes["index"].max()]).any()


def test_outliers_are_among_the_marked_points(gppcs_command, strays):
    part, clean = strays
    assert gppcs_command("simplify", "stray.ply", "-o", "out.ply", "--add", "kept", *ONLY)[0] == 0
    marked = gppcs.read("out.ply")
    assert (marked.points == part.points).all()
    result = gppcs.simplify(part[clean], n_points=40, method="fps")
    assert (np.flatnonzero(marked.attributes["kept"]) == np.sort(np.flatnonzero(clean)[result.indices])).all()


def test_attributes_of_the_cloud_are_not_replaced(gppcs_command, folder, scan):
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--add", "kept:red", *FPS)
    assert (code, "scan.ply: expected the name of a new attribute, found 'red'" in err) == (2, True)
    assert not (folder / "out.ply").exists()


@pytest.fixture
def no_work(monkeypatch):
    """Fail when a method begins."""

    def begins(*_):
        raise AssertionError("the method has begun")

    monkeypatch.setattr(gppcs.FarthestPoint, "__call__", begins)


@pytest.mark.parametrize(
    ("name", "target", "message"),
    [
        ("", "out.npz", "expected a name of 1 to 1,000 characters"),
        ("x", "out.csv", "expected columns of different names, found 'x' twice"),
        ("points", "out.npz", "expected columns of different names, found 'points' twice"),
        ("long" * 9, "out.las", "expected a name of at most 32 bytes"),
        ("red", "out.ply", "expected the name of a new attribute"),
        ("row", "out.pts", "PTS cannot hold: "),
    ],
)
def test_names_that_cannot_be_written_are_found_before_the_work(
    gppcs_command, folder, scan, no_work, name, target, message
):
    result = gppcs_command("simplify", "scan.ply", "-o", target, "--add", f"kept:{name}", *FPS)
    assert_one_line(result, message)
    assert not (folder / target).exists()


@pytest.mark.parametrize(("added", "lost"), [("normals", "nx (float32)"), ("scores", "score (float32)")])
def test_what_the_output_cannot_hold_of_the_result_is_found_before_the_work(
    gppcs_command, folder, no_work, monkeypatch, added, lost
):
    gppcs.write("bare.xyz", gppcs.sample("bracket", 400).points)
    monkeypatch.setattr(gppcs.FarthestPoint, "attributes", ("score",))
    result = gppcs_command("simplify", "bare.xyz", "-o", "out.obj", "--add", added, *FPS)
    assert_one_line(result, f"OBJ cannot hold: attribute {lost}")
    assert not (folder / "out.obj").exists()


def test_points_that_are_dropped_need_not_be_held(gppcs_command, folder):
    points = gppcs.sample("bracket", 400).points
    points = points.round(2)
    points[7] = np.nan
    gppcs.write("bare.xyz", points)
    words = ["simplify", "bare.xyz", "-o", "out.las", "--lossy", "--drop", "invalid", "-q", *FPS]
    assert gppcs_command(*words, "--add", "kept")[0] == 2
    assert not (folder / "out.las").exists()
    assert gppcs_command(*words, "--add", "index") == (0, "", "")
    assert 7 not in gppcs.read("out.las").attributes["index"]


def test_what_only_kept_points_have_does_not_go_with_a_mark(gppcs_command, scan):
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--add", "kept,index", *FPS)
    assert (code, "expected --add kept alone" in err) == (2, True)
