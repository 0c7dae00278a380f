"""`gppcs convert`."""

import json
from pathlib import Path

import numpy as np
import pytest

import gppcs

FACES = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".csv", ".xyz", ".ply.gz"])
def test_a_cloud_goes_to_another_format_and_back(printed, scan, suffix):
    assert printed("convert", "scan.ply", f"other{suffix}") == ""
    assert printed("convert", f"other{suffix}", "back.ply") == ""
    back = gppcs.read("back.ply")
    assert (back.points.astype(np.float32) == scan.points).all()  # text does not say that a number has four bytes
    for name, values in scan.attributes.items():
        assert (back.attributes[name].astype(values.dtype) == values).all()


def test_what_is_lost_is_left_out_by_name(gppcs_command, scan):
    code, out, err = gppcs_command("convert", "scan.ply", "other.obj", "--lossy")
    assert (code, out) == (0, "")
    assert err.startswith("gppcs: note: other.obj: left out: attribute nx (float32)")
    assert (gppcs.read("other.obj").points.astype(np.float32) == scan.points).all()


def test_faces_are_left_out_with_a_word(gppcs_command, folder):
    (folder / "square.off").write_text(FACES)
    code, out, err = gppcs_command("convert", "square.off", "square.ply")
    assert (code, out, err) == (0, "", "gppcs: note: square.ply: left out: faces (2)\n")


def test_points_that_are_not_finite_are_kept_or_dropped_with_a_word(gppcs_command, refused, folder):
    (folder / "a.csv").write_text("x,y,z,label\n0,0,0,1\nnan,0,0,2\n1,2,inf,3\n1,2,3,4\n")
    assert gppcs_command("convert", "a.csv", "kept.ply") == (0, "", "")
    assert gppcs.read("kept.ply").attributes["label"].tolist() == [1, 2, 3, 4]
    told = ("found 2 points with NaN or infinite ones", "drop")
    refused(("convert", "a.csv", "a.las", "--lossy"), *told)
    note = "gppcs: note: a.las: left out: points with NaN or infinite coordinates (2)\n"
    assert gppcs_command("convert", "a.csv", "a.las", "--invalid", "drop") == (0, "", note)
    assert gppcs.read("a.las").attributes["label"].tolist() == [1, 4]


def test_a_virtual_point_cloud_becomes_one_file(printed, refused, two_systems):
    features = [{"assets": {"data": {"href": path.name}}} for path in two_systems]
    Path("all.vpc").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    told = ("b.las: expected one coordinate system", "assume_same_crs")
    refused(("convert", "all.vpc", "one.las"), *told)
    assert printed("convert", "all.vpc", "one.las", "--assume-same-crs") == ""
    expected = np.concatenate([gppcs.read(path).points for path in two_systems])
    assert gppcs.read("one.las").points.tobytes() == expected.tobytes()
    assert gppcs.info(gppcs.read("one.las")).crs == "UTM 32N"
