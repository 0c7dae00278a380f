"""`gppcs convert`."""

import numpy as np
import pytest

import gppcs
from command_line import assert_one_line

FACES = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".csv", ".xyz", ".ply.gz"])
def test_a_cloud_goes_to_another_format_and_back(gppcs_command, scan, suffix):
    assert gppcs_command("convert", "scan.ply", f"other{suffix}") == (0, "", "")
    assert gppcs_command("convert", f"other{suffix}", "back.ply") == (0, "", "")
    back = gppcs.read("back.ply")
    assert (back.points.astype(np.float32) == scan.points).all()  # text does not say that a number has four bytes
    for name, values in scan.attributes.items():
        assert (back.attributes[name].astype(values.dtype) == values).all()


def test_what_is_lost_is_refused_by_name_or_left_out_by_name(gppcs_command, scan, folder):
    code, out, err = gppcs_command("convert", "scan.ply", "other.obj")
    assert (code, out) == (2, "")
    assert "OBJ cannot hold: attribute nx (float32)" in err
    assert "--lossy" in err
    assert not (folder / "other.obj").exists()
    code, out, err = gppcs_command("convert", "scan.ply", "other.obj", "--lossy")
    assert (code, out) == (0, "")
    assert err.startswith("gppcs: note: other.obj: left out: attribute nx (float32)")
    assert (gppcs.read("other.obj").points.astype(np.float32) == scan.points).all()


def test_faces_are_left_out_with_a_word(gppcs_command, folder):
    (folder / "square.off").write_text(FACES)
    code, out, err = gppcs_command("convert", "square.off", "square.ply")
    assert (code, out, err) == (0, "", "gppcs: note: square.ply: left out: faces (2)\n")


def test_the_input_and_existing_files_are_safe(gppcs_command, scan, folder):
    before = (folder / "scan.ply").read_bytes()
    for arguments in (["scan.ply"], ["scan.ply", "--force"]):
        assert gppcs_command("convert", "scan.ply", *arguments)[0] == 2
    (folder / "other.csv").write_text("precious")
    assert gppcs_command("convert", "scan.ply", "other.csv")[0] == 2
    assert (folder / "other.csv").read_text() == "precious"
    assert (folder / "scan.ply").read_bytes() == before


def test_points_that_are_not_finite_are_kept_or_dropped_with_a_word(gppcs_command, folder):
    (folder / "a.csv").write_text("x,y,z,label\n0,0,0,1\nnan,0,0,2\n1,2,inf,3\n1,2,3,4\n")
    assert gppcs_command("convert", "a.csv", "kept.ply") == (0, "", "")
    assert gppcs.read("kept.ply").attributes["label"].tolist() == [1, 2, 3, 4]
    result = gppcs_command("convert", "a.csv", "a.las")
    assert_one_line(result, "found 2 points with NaN or infinite ones, the first at index 1", "--invalid drop")
    note = "gppcs: note: a.las: left out: points with NaN or infinite coordinates (2)\n"
    assert gppcs_command("convert", "a.csv", "a.las", "--invalid", "drop") == (0, "", note)
    assert gppcs.read("a.las").attributes["label"].tolist() == [1, 4]
