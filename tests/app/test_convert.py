"""`gppcs convert`."""

import json
from pathlib import Path

import numpy as np
import pytest

import gppcs


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


def test_a_virtual_point_cloud_becomes_one_file(printed, refused, two_systems):
    features = [{"assets": {"data": {"href": path.name}}} for path in two_systems]
    Path("all.vpc").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    told = ("b.las: expected one coordinate system", "assume_same_crs")
    refused(("convert", "all.vpc", "one.las"), *told)
    assert printed("convert", "all.vpc", "one.las", "--assume-same-crs") == ""
    expected = np.concatenate([gppcs.read(path).points for path in two_systems])
    assert gppcs.read("one.las").points.tobytes() == expected.tobytes()
    assert gppcs.info(gppcs.read("one.las")).crs == "UTM 32N"
