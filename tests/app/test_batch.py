"""`gppcs simplify` on several inputs, and what else makes it fit for scripts."""

import json
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import FAST, assert_one_line


@pytest.fixture
def tiles(scan):
    """A folder with two clouds."""
    Path("tiles").mkdir()
    gppcs.write("tiles/a.ply", scan)
    gppcs.write("tiles/b.csv", gppcs.sample("fan", 200))


def test_a_folder_is_thinned_by_a_pattern_into_folders_that_are_made(printed, tiles):
    pattern = "new/deep/{stem}_small{suffix}"
    out = printed("simplify", "tiles", "-o", pattern, "--ratio", "10%", *FAST)
    first, second = out.splitlines()
    assert first.startswith("tiles/a.ply → new/deep/a_small.ply: 400 points in, 40 out, ")
    assert second.startswith("tiles/b.csv → new/deep/b_small.csv: 200 points in, 20 out, ")
    assert [len(gppcs.read(f"new/deep/{name}")) for name in ("a_small.ply", "b_small.csv")] == [40, 20]


@pytest.mark.parametrize("output", ["new/", "new"])
def test_a_folder_that_is_missing_is_made(printed, tiles, output):
    printed("simplify", "tiles", "-o", output, "--points", "0.1k", *FAST)
    assert sorted(path.name for path in Path("new").iterdir()) == ["a.ply", "b.csv"]


def test_more_points_than_there_are_is_told(gppcs_command, printed, scan):
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", "5k", *FAST)
    note = "gppcs: note: scan.ply: all of its 400 points were kept, fewer than the 5,000 asked for\n"
    assert (code, err) == (0, note)
    printed("simplify", "scan.ply", "-o", "out.ply", "--points", 400, "--force", *FAST)


def test_finite_points_are_counted_when_others_are_dropped(gppcs_command, scan):
    scan.points[3] = np.nan
    gppcs.write("scan.ply", scan, force=True)
    options = ("--points", 400, "--drop", "invalid")
    _, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", *options, *FAST)
    assert "all of its 399 points with finite coordinates were kept, fewer than the 400 asked for" in err


@pytest.mark.parametrize("flag", ["-q", "--quiet"])
def test_quiet_prints_errors_and_notes_only(gppcs_command, record, scan, flag):
    command = ("simplify", "scan.ply", "-o", "out.ply", "--points", 9, flag, *FAST)
    assert record(*command)["points_out"] == 9
    assert gppcs_command(*command, "--force") == (0, "", "")
    assert_one_line(gppcs_command(*command), "overwrite it with --force")
    assert gppcs_command("simplify", "scan.ply", "-o", "big.ply", "--points", 500, flag)[2].count("note") == 1


def test_names_of_columns_are_given(gppcs_command, folder):
    rows = "".join(f"{i} {i % 7} {i % 5} {i % 256} 0 255\n" for i in range(300))
    Path("table.txt").write_text(rows)
    assert gppcs_command("convert", "table.txt", "out.ply", "--columns", "x, y,z,red,green,blue") == (0, "", "")
    kept = gppcs.read("out.ply")
    assert {name: str(values.dtype) for name, values in kept.attributes.items()} == dict.fromkeys(
        ("red", "green", "blue"), "uint8"
    )
    np.testing.assert_array_equal(kept.attributes["red"], kept.points[:, 0] % 256)


def test_a_virtual_point_cloud_stands_for_its_files(gppcs_command, folder):
    features = []
    for i in range(3):
        gppcs.write(f"t{i}.ply", gppcs.sample("fan", 50, seed=i))
        features.append({"assets": {"data": {"href": f"./t{i}.ply"}}})
    Path("all.vpc").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    words = ["--points", 20, "--method", "random", "-q"]
    assert gppcs_command("simplify", "all.vpc", "-o", "out/", *words) == (0, "", "")
    assert [len(gppcs.read(f"out/t{i}.ply")) for i in range(3)] == [20] * 3
    assert gppcs_command("simplify", "all.vpc", "-o", "one.ply", *words) == (0, "", "")
    whole = np.concatenate([gppcs.read(f"t{i}.ply").points for i in range(3)])
    expected = gppcs.simplify(whole, n_points=20, method="random").cloud.points
    assert (gppcs.read("one.ply").points == expected).all()
    code, out, _ = gppcs_command("info", "all.vpc", "--json")
    assert (code, out.count('"points": 50')) == (0, 3)
    assert_one_line(gppcs_command("info", "none.vpc"), "none.vpc: No such file")
    for name in ("t1.ply", "all.vpc"):
        for command in (["convert", "all.vpc", name], ["simplify", "all.vpc", "-o", name, *words]):
            told = gppcs_command(*command, "--to", "ply", "--force")
            assert_one_line(told, f"{name}: expected a file other than the input {name}, found the same")


def test_notes_in_a_folder_are_passed_over(gppcs_command, scan, folder):
    (folder / "scans").mkdir()
    gppcs.write("scans/a.ply", scan)
    Path("scans/notes.txt").write_text("The second scan of the hall\n")
    code, _, err = gppcs_command("simplify", "scans", "-o", "out/", "--points", 5, *FAST)
    assert (code, err.count("\n")) == (0, 1)
    assert "scans/notes.txt: line 1: expected numbers" in err
    assert "passed over" in err
    assert [path.name for path in Path("out").iterdir()] == ["a.ply"]
    assert gppcs_command("simplify", "scans/notes.txt", "-o", "b.ply", "--points", 5, *FAST)[0] == 2
