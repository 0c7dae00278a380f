"""`gppcs simplify` on several inputs, and what else makes it fit for scripts."""

import json
import re
from pathlib import Path

import numpy as np

import gppcs
from command_line import FAST, SIMPLIFY


def test_a_folder_is_thinned_into_folders_that_are_made(printed, scan):
    Path("tiles").mkdir()
    gppcs.write("tiles/a.ply", scan)
    gppcs.write("tiles/b.csv", gppcs.sample("fan", 200))
    words = ("simplify", "tiles", "-o", "new/deep/", "--ratio", "10%", "--separately", *FAST)
    first, second = printed(*words).splitlines()
    assert first.startswith("tiles/a.ply → new/deep/a.ply: 400 in, 40 out (10 %), ")
    assert second.startswith("tiles/b.csv → new/deep/b.csv: 200 in, 20 out (10 %), ")
    assert [len(gppcs.read(f"new/deep/{name}")) for name in ("a.ply", "b.csv")] == [40, 20]


def test_more_points_than_there_are_is_told(gppcs_command, printed, scan):
    note = "gppcs: note: scan.ply: all of its 400 points were kept, fewer than the 5,000 asked for\n"
    assert gppcs_command(*SIMPLIFY, "5k")[::2] == (0, note)
    printed(*SIMPLIFY, 400, "--force")


def test_a_virtual_point_cloud_stands_for_its_files(printed, refused, folder):
    features = []
    for i in range(3):
        gppcs.write(f"t{i}.ply", gppcs.sample("fan", 50, seed=i))
        features.append({"assets": {"data": {"href": f"./t{i}.ply"}}})
    Path("all.vpc").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    words = ["--points", 20, "--method", "random", "-q"]
    assert printed("simplify", "all.vpc", "-o", "out/", *words) == ""
    assert sum(len(gppcs.read(f"out/t{i}.ply")) for i in range(3)) == 20
    assert printed("simplify", "all.vpc", "-o", "one.ply", *words) == ""
    whole = np.concatenate([gppcs.read(f"t{i}.ply").points for i in range(3)])
    expected = gppcs.simplify(whole, n_points=20, method="random").cloud.points
    assert (gppcs.read("one.ply").points == expected).all()
    assert printed("info", "all.vpc", "--json").count('"points": 50') == 3
    for name in ("t1.ply", "all.vpc"):
        for command in (["convert", "all.vpc", name], ["simplify", "all.vpc", "-o", name, *words]):
            refused((*command, "--to", "ply", "--force"), f"{name}: ", "input")


def test_notes_in_a_folder_are_passed_over(gppcs_command, refused, scan, folder):
    (folder / "scans").mkdir()
    gppcs.write("scans/a.ply", scan)
    Path("scans/notes.txt").write_text("The second scan of the hall\n")
    _, _, err = gppcs_command("simplify", "scans", "-o", "out/", "--points", 5, *FAST)
    assert re.fullmatch(r"gppcs: note: scans/notes.txt: line 1: expected numbers.* this file is passed over\n", err)
    assert [path.name for path in Path("out").iterdir()] == ["a.ply"]
    refused(("simplify", "scans/notes.txt", "-o", "b.ply", "--points", 5), "scans/notes.txt: line 1")
