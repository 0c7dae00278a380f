"""`gppcs simplify`: how it fails, and what it leaves alone."""

import json
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import FAST, assert_one_line, files, write_scan_with


def truncate(path):
    path.write_bytes(path.read_bytes()[:-10])


def without_x(path):
    path.write_bytes(path.read_bytes().replace(b"float x", b"float u"))


def empty(path):
    gppcs.write(path, gppcs.PointCloud(np.empty((0, 3))), force=True)


def not_finite(path):
    def spoil(points):
        points[7, 1], points[9, 0] = np.nan, np.inf

    write_scan_with(spoil)


def as_folder(path):
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    ("damage", "parts"),
    [
        (Path.unlink, ["scan.ply: No such file"]),
        (as_folder, ["scan.ply: expected a folder with files of formats that gppcs reads", "found none"]),
        (truncate, ["scan.ply: the file ends in vertex 400 of 400"]),
        (without_x, ["scan.ply: expected x, y and z", "'u', 'y', 'z'"]),
        (empty, ["scan.ply: the cloud is empty"]),
        (not_finite, ["scan.ply: 2 of 400 points", "first at index 7", "--drop invalid"]),
        (lambda path: path.write_bytes(b""), ["scan.ply: expected"]),
        (lambda path: path.write_bytes(bytes(range(256))), ["scan.ply: expected 'ply'"]),
    ],
)
def test_input_that_cannot_be_used(gppcs_command, scan, damage, parts):
    damage(Path("scan.ply"))
    before = files()
    assert_one_line(gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--ratio", 0.1), *parts)
    assert files() == before


def test_a_missing_input_is_told_before_the_name_of_its_output(gppcs_command, scan):
    result = gppcs_command("simplify", "tiles", "-o", "small/", "--ratio", 0.1)
    assert_one_line(result, "gppcs: tiles: No such file or directory")
    assert files() == ["scan.ply"]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--ratio", 0], ["a ratio above 0 and at most 1, found 0"]),
        (["--ratio", -1], ["found -1"]),
        (["--ratio", 1.5], ["found 1.5"]),
        (["--ratio", 3], ["at most 1, found 3.0; for 3 percent, write 3%"]),
        (["--ratio", "nan"], ["found nan"]),
        (["--ratio", "abc"], ["--ratio to be a share", "found 'abc'"]),
        (["--points", 0], ["whole number from 1 on, found 0"]),
        (["--points", -3], ["found -3"]),
        (["--points", "abc"], ["--points to be a whole number", "found 'abc'"]),
        (["--points", 2.5], ["--points to be a whole number", "found '2.5'"]),
        ([], ["either a ratio or a number of points, found neither"]),
        (["--points", 5, "--ratio", 0.5], ["found both"]),
        (["--points", 5, "--method", "gp-spektral"], ["did you mean 'gp-spectral'?"]),
        (["--points", 5, "--set", "neighbors=9"], ["did you mean 'neighbours'?"]),
        (["--points", 5, "--set", "neighbours=0"], ["neighbours to be from 1 to 64, found 0"]),
        (["--points", 5, "--set", "neighbours=few"], ["neighbours to be int, found 'few'"]),
        (["--points", 5, "--set", "neighbours"], ["--set KEY=VALUE, found 'neighbours'"]),
        (["--points", 5, "--method", "random", "--set", "seed=-1"], ["seed to be at least 0, found -1"]),
        (["--points", 5, "--drop", "invalid,odd"], ["--drop with invalid or outliers, found 'odd'"]),
        (["--points", 5, "--workers", "0"], ["--workers as a number from 1 on", "found '0'"]),
        (["--points", 5, "--report", "page.ply"], ["page.ply: expected a name that ends in .html"]),
        (["b.ply", "-o", ".", "--points", 9, "--report", "p.html"], ["one input with --report, found 2"]),
        (["--points", 5, "--report", "none/page.html"], ["none/page.html: expected a folder"]),
        (["--points", 5, "--rato", 1], ["--rato", "--ratio"]),
        (["--points", 5, "-o", "none/out.ply"], ["none/out.ply: expected a folder"]),
        (
            ["--points", 5, "-o", "scan.ply"],
            ["scan.ply: expected a file other than the input scan.ply, found the same"],
        ),
        (["--points", 5, "-o", "out.foo"], ["out.foo: expected one of the formats .ply", "found '.foo'"]),
        (["--points", 5, "--add", "index:row"], ["--add with normals or scores or index or kept, found 'index:row'"]),
        (["--points", 5, "sub/scan.ply", "-o", "."], ["inputs with different names"]),
    ],
)
def test_options_that_cannot_be_used(gppcs_command, scan, arguments, parts):
    before = Path("scan.ply").read_bytes()
    assert_one_line(gppcs_command("simplify", "scan.ply", "-o", "out.ply", *arguments), *parts)
    assert files() == ["scan.ply"]
    assert Path("scan.ply").read_bytes() == before


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
