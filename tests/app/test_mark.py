"""`--add index` and `--add kept` of `gppcs simplify`."""

import numpy as np
import pytest

import gppcs

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
