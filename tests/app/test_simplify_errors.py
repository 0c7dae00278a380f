"""`gppcs simplify`: what it leaves alone when some of its work fails."""

import json
from pathlib import Path

import gppcs
from command_line import FAST


def test_one_bad_file_does_not_cost_the_others(gppcs_command, scan):
    gppcs.write("done.ply", scan)
    Path("broken.ply").write_bytes(Path("done.ply").read_bytes()[:-10])
    gppcs.write("empty.ply", scan[:0])
    Path("results").mkdir()
    Path("results/done.ply").write_text("old")
    inputs = ["broken.ply", "missing.ply", "empty.ply", "done.ply", "scan.ply"]
    code, out, err = gppcs_command("simplify", *inputs, "-o", "results", "--points", 9, "--json", *FAST)
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
    Path("results/scan.ply").hardlink_to("more.ply")
    told = "results/scan.ply: expected a file other than the input more.ply, found the same"
    refused(("simplify", "scan.ply", "more.ply", "-o", "results", "--points", 5, "--force", *FAST), told)


def test_what_a_file_loses_is_told_in_one_line(gppcs_command, refused, scan):
    content = Path("scan.ply").read_bytes().replace(b"element vertex", b"comment mine\nobj_info old\nelement vertex")
    face = b"element face 1\nproperty uchar flag\nend_header"
    Path("scan.ply").write_bytes(content.replace(b"end_header", face) + b"1")
    command = ("simplify", "scan.ply", "--points", 5, *FAST, "-o")
    lost = "attribute curvature (float32)"
    refused((*command, "out.off"), f"OFF cannot hold: {lost}; choose another format, or leave this out with --lossy")
    told = f"gppcs: note: out.off: left out: faces (1), {lost}, 1 comment, 1 line of obj_info\n"
    assert gppcs_command(*command, "out.off", "--lossy")[::2] == (0, told)
    assert gppcs_command(*command, "out.ply")[2].endswith(": faces (1)\n")
