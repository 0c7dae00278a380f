"""`--index-attribute` and `--mark` of `gppcs simplify`."""

import numpy as np
import pytest

import gppcs

FPS = ["--points", 40, "--method", "fps"]


@pytest.fixture
def rows(scan):
    return gppcs.simplify(gppcs.read("scan.ply"), n_points=40, method="fps").indices


def test_the_row_of_each_kept_point_is_added(gppcs_command, rows):
    assert gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--index-attribute", "row", *FPS)[0] == 0
    kept, scan = gppcs.read("out.ply"), gppcs.read("scan.ply")
    assert kept.attributes["row"].tolist() == rows.tolist()
    assert (kept.points == scan.points[kept.attributes["row"]]).all()


def test_all_points_are_written_with_a_mark_for_those_kept(gppcs_command, rows):
    code, out, _ = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--mark", "kept", *FPS)
    assert (code, "400 in, 40 out" in out) == (0, True)
    marked, scan = gppcs.read("out.ply"), gppcs.read("scan.ply")
    assert np.flatnonzero(marked.attributes["kept"]).tolist() == sorted(rows)
    assert (marked.points == scan.points).all()
    for name, values in scan.attributes.items():
        assert (marked.attributes[name] == values).all()


@pytest.mark.parametrize("option", ["--index-attribute", "--mark"])
def test_attributes_of_the_cloud_are_not_replaced(gppcs_command, folder, scan, option):
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", option, "red", *FPS)
    assert (code, "scan.ply: expected the name of a new attribute, found 'red'" in err) == (2, True)
    assert not (folder / "out.ply").exists()


@pytest.mark.parametrize("other", [["--normals"], ["--index-attribute", "row"]])
def test_what_only_kept_points_have_does_not_go_with_a_mark(gppcs_command, scan, other):
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--mark", "kept", *other, *FPS)
    assert (code, "expected --mark without" in err) == (2, True)
