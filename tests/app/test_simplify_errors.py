"""`gppcs simplify`: how it fails, and what it leaves alone."""

import json
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import FAST, assert_one_line, files


def truncate(path):
    path.write_bytes(path.read_bytes()[:-10])


def empty(path):
    gppcs.write(path, gppcs.PointCloud(np.empty((0, 3))), force=True)


def test_one_bad_file_does_not_cost_the_others(gppcs_command, scan):
    gppcs.write("broken.ply", scan)
    truncate(Path("broken.ply"))
    empty("empty.ply")
    gppcs.write("done.ply", scan)
    Path("results").mkdir()
    Path("results/done.ply").write_text("old")
    inputs = ["broken.ply", "missing.ply", "empty.ply", "done.ply", "scan.ply"]
    code, out, err = gppcs_command("simplify", *inputs, "-o", "results", "--points", 9, "--json", *FAST)
    assert code == 2
    assert [json.loads(line)["input"] for line in out.splitlines()] == ["scan.ply"]
    named = ["broken.ply", "missing.ply", "empty.ply", "results/done.ply"]
    assert [line.split(": ")[1] for line in err.splitlines()] == named
    assert len(gppcs.read("results/scan.ply")) == 9
    assert sorted(path.name for path in Path("results").iterdir()) == ["done.ply", "scan.ply"]
    assert Path("results/done.ply").read_text() == "old"


def test_no_input_of_the_call_is_overwritten_through_a_link_in_the_folder(gppcs_command, scan):
    """The link has the name of one input and leads to another."""
    Path("results").mkdir()
    gppcs.write("more.ply", scan)
    before = Path("more.ply").read_bytes()
    Path("results/scan.ply").hardlink_to("more.ply")
    result = gppcs_command("simplify", "scan.ply", "more.ply", "-o", "results", "--points", 5, "--force", *FAST)
    assert_one_line(result, "results/scan.ply: expected a file other than the input more.ply, found the same")
    assert Path("more.ply").read_bytes() == before
    assert sorted(path.name for path in Path("results").iterdir()) == ["scan.ply"]  # refused before any work


@pytest.mark.parametrize("page", ["scan.html", "link.html", "out.html"])
def test_a_report_overwrites_neither_the_input_nor_the_result(gppcs_command, scan, page):
    gppcs.write("scan.html", scan, format="ply")  # read by its content
    Path("link.html").hardlink_to("scan.html")
    before = Path("scan.html").read_bytes()
    options = ("-o", "out.html", "--to", "ply", "--points", 5, "--report", page, "--force", *FAST)
    assert_one_line(gppcs_command("simplify", "scan.html", *options), f"{page}: expected a file")
    assert Path("scan.html").read_bytes() == before
    assert not Path("out.html").exists()


def test_a_report_replaces_a_page_only_by_force(gppcs_command, scan):
    Path("page.html").write_text("precious")
    options = ("simplify", "scan.ply", "-o", "out.ply", "--points", 5, "--report", "page.html", *FAST)
    assert_one_line(gppcs_command(*options), "page.html: expected a new file")
    assert files() == ["page.html", "scan.ply"]
    assert Path("page.html").read_text() == "precious"
    assert gppcs_command(*options, "--force")[0] == 0
    assert Path("page.html").read_text().startswith("<!doctype html>")


def test_what_a_file_loses_is_told_in_one_line(gppcs_command, scan):
    content = Path("scan.ply").read_bytes().replace(b"element vertex", b"comment mine\nobj_info old\nelement vertex")
    Path("scan.ply").write_bytes(
        content.replace(b"end_header", b"element face 1\nproperty uchar flag\nend_header") + b"1"
    )
    options = ["--points", 5, *FAST]
    lost = "attribute curvature (float32)"
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.off", *options)
    assert (code, f"OFF cannot hold: {lost}; choose another format, or leave this out with --lossy" in err) == (2, True)
    assert not Path("out.off").exists()
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.off", "--lossy", *options)
    assert (code, err) == (0, f"gppcs: note: out.off: left out: faces (1), {lost}, 1 comment, 1 line of obj_info\n")
    assert gppcs_command("simplify", "scan.ply", "-o", "out.ply", *options)[2].endswith(": faces (1)\n")
