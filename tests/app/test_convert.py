"""`gppcs convert`."""

import json
from pathlib import Path

import numpy as np
import pytest

import gppcs


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".csv", ".xyz", ".ply.gz"])
def test_a_cloud_goes_to_another_format_and_back(printed, scan, suffix):
    assert printed("convert", "scan.ply", f"other{suffix}") == f"scan.ply → other{suffix}: 400 points\n"
    assert printed("convert", f"other{suffix}", "back.ply", "--quiet") == ""
    back = gppcs.read("back.ply")
    assert (back.points.astype(np.float32) == scan.points).all()  # text does not say that a number has four bytes
    for name, values in scan.attributes.items():
        assert (back.attributes[name].astype(values.dtype) == values).all()


def test_what_is_lost_is_left_out_by_name(gppcs_command, scan):
    code, out, err = gppcs_command("convert", "scan.ply", "other.obj", "--lossy", "-q")
    assert (code, out) == (0, "")
    assert err.startswith("gppcs: note: other.obj: does not hold: attribute nx (float32)")
    assert (gppcs.read("other.obj").points.astype(np.float32) == scan.points).all()


@pytest.mark.parametrize("inputs", [["tiles"], ["tiles/a.ply", "tiles/b.csv"]])
def test_several_files_become_one(printed, scan, inputs):
    Path("tiles").mkdir()
    rows = np.arange(len(scan))
    gppcs.write("tiles/a.ply", scan.take(rows[:150]))
    gppcs.write("tiles/b.csv", scan.take(rows[150:]))
    assert printed("convert", *inputs, "all.ply") == "tiles/a.ply and 1 more → all.ply: 400 points\n"
    assert (gppcs.read("all.ply").points.astype(np.float32) == scan.points).all()


def test_a_virtual_point_cloud_becomes_one_file(printed, refused, two_systems):
    features = [{"assets": {"data": {"href": path.name}}} for path in two_systems]
    Path("all.vpc").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    told = ("b.las: expected one coordinate system", "--assume-same-crs")
    refused(("convert", "all.vpc", "one.las"), *told)
    printed("convert", "all.vpc", "one.las", "--assume-same-crs")
    expected = np.concatenate([gppcs.read(path).points for path in two_systems])
    assert gppcs.read("one.las").points.tobytes() == expected.tobytes()
    assert gppcs.info(gppcs.read("one.las")).crs == "UTM 32N"
    refused(("simplify", "all.vpc", "-o", "half.las", "--ratio", "0.5"), "gppcs convert --assume-same-crs")


@pytest.mark.parametrize("target", ["none.csv", "none.ply"])
@pytest.mark.parametrize("condition", ["z > 999", "x == x + 1 and z > 0"])
def test_an_empty_result_is_noted(gppcs_command, scan, target, condition):
    code, out, err = gppcs_command("convert", "scan.ply", target, "--only", condition)
    assert (code, out) == (0, f"scan.ply → {target}: 0 points\n")
    assert err == f"gppcs: note: scan.ply: the result is empty, as it has no points with {condition}\n"
    code, out, err = gppcs_command("info", "scan.ply", "--only", condition, "--json")
    assert (code, json.loads(out)["points"]) == (0, 0)
    assert err.startswith("gppcs: note: scan.ply: the result is empty")


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nvt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1\n"
UNUSED = "faces (1), normals (1), texture coordinates (2)"


@pytest.mark.parametrize(
    "command",
    [
        "simplify tent.obj -o out.ply --points 2 --method fps",
        "convert tent.obj out.ply",
        "mesh tent.obj -o out.ply --points 4",
        "evaluate tent.obj tent.ply",
        "compare tent.obj --points 2 --methods fps --no-picture -o out",
        "view tent.obj -o out.html --no-open",
        "report tent.obj tent.obj -o out.html",
    ],
)
def test_all_commands_name_what_they_do_not_use_of_a_file(gppcs_command, folder, command):
    """Faces that are drawn are used."""
    Path("tent.obj").write_text(TRIANGLE)
    gppcs.write("tent.ply", gppcs.read("tent.obj")[:3])
    code, _, err = gppcs_command(*command.split(), "-q")
    assert code == 0 or (command.startswith("mesh") and code == 2)  # so few points may span no mesh
    unused = UNUSED.removeprefix("faces (1), ") if ".html" in command else UNUSED
    assert f"gppcs: note: tent.obj: not used: {unused}\n" in err
