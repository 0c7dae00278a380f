"""The options that ask for an accuracy, a spacing, points to keep or leave out, and several sizes."""

import math
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import FAST, assert_one_line, rows_of
from gppcs.io import files, ply


def test_a_tolerance_is_reached_by_evaluate(gppcs_command, record, scan):
    rows = rows_of(gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--tolerance", "2%:mean")[1])
    ((row,),) = filter(None, (re.findall(r"^surface mean (\S+) \(asked: 2% = (\S+)\)$", row) for row in rows))
    reached, asked = map(float, row)
    assert asked == pytest.approx(0.02 * gppcs.info(scan).diagonal, rel=1e-5)
    told = record("evaluate", "scan.ply", "out.ply")
    assert told["figures"]["surface_mean"] == pytest.approx(reached, rel=1e-3)
    assert told["relative"]["surface_mean"] <= 0.02


SPECTRAL = ("--method", "gp-spectral", "--set", "k_add=5", "--set", "nu=inf", "--set", "seed=3")


def test_options_do_what_the_library_does(printed, scan):
    for options, wanted in (
        (["--spacing", "1cm", "--unit", "mm", *FAST], {"spacing": 10.0, "method": "fps"}),
        (["--points", 20, "--max-gap", 30, *FAST], {"n_points": 20, "max_gap": 30.0, "method": "fps"}),
        (["--points", 50, "--keep", "z > 60"], {"n_points": 50, "keep": "z > 60"}),
        (["--points", 50, "--weight", "red"], {"n_points": 50, "weight": "red"}),
        (["--points", 50, "--quota", "z > 60: 30%"], {"n_points": 50, "quota": {"z > 60": "30%"}}),
        (["--points", 40, "--scores"], {"n_points": 40, "scores": True}),
        (["--points", 40, "--normals"], {"n_points": 40, "normals": True}),
        (["--points", 40, "--drop-outliers", "--invalid", "drop"], {"n_points": 40, "drop_outliers": True}),
        ([*SPECTRAL, "--points", 30], {"n_points": 30, "method": gppcs.SpectralGP(k_add=5, nu=math.inf, seed=3)}),
    ):
        printed("simplify", "scan.ply", "-o", "out.ply", "--force", *options)
        assert gppcs.read("out.ply") == gppcs.simplify(scan, **wanted).cloud, options


def test_conditions_boxes_and_polygons(printed, record, scan):
    Path("area.json").write_text('{"type": "Polygon", "coordinates": [[[-60, -60], [60, -60], [0, 60]]]}')
    options = ["--only", "z > 5 and not nx > 0.5", "--inside", "area.json", "--inside", "-50,-50,60,60"]
    printed("convert", "scan.ply", "part.ply", *options)
    x, y, z = scan.points.T
    wanted = (z > 5) & (scan.attributes["nx"] <= 0.5) & (np.abs([x, y]).max(axis=0) <= 50) & (y < 60 - 2 * np.abs(x))
    part = gppcs.read("part.ply")
    assert 0 < len(part) < len(scan)
    assert part == scan[wanted]
    assert record("info", "scan.ply", *options)["points"] == len(part)
    printed("simplify", "scan.ply", "-o", "out.ply", "--ratio", 1, *options)
    assert gppcs.read("out.ply") == part


@pytest.mark.parametrize("sizes", ["25%,10%,5%", "20,100,40", ".25,0.1,5%", "0.1k,40,0.02k"])
def test_levels_are_nested_files_or_an_attribute(printed, scan, sizes):
    printed("simplify", "scan.ply", "-o", "scan_{level}.ply", "--levels", sizes, *FAST)
    levels = [gppcs.read(f"scan_{level}.ply").points for level in range(3)]
    assert [len(level) for level in levels] == [20, 40, 100]
    for coarse, fine in pairwise(levels):
        assert (fine[: len(coarse)] == coarse).all()
    printed("simplify", "scan.ply", "-o", "all.ply", "--levels", sizes, *FAST)
    everything = gppcs.read("all.ply")
    assert (everything.points == levels[-1]).all()
    assert np.bincount(everything.attributes["level"]).tolist() == [20, 20, 60]


@pytest.mark.parametrize("force", [False, True])
def test_all_files_of_the_levels_are_written_or_none(gppcs_command, scan, monkeypatch, force):
    command = ("simplify", "scan.ply", "-o", "scan_{level}.ply", "--levels", "20,40,100", "--force", *FAST)
    if force:
        assert gppcs_command(*command)[0] == 0
    before = {path.name: path.read_bytes() for path in Path().iterdir()}
    write = ply.FORMAT.write

    def fail(file, cloud, *more, **options):
        write(file, cloud, *more, **options)
        if len(cloud) == 100:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(files, "FORMATS", [replace(ply.FORMAT, write=fail)])
    assert_one_line(gppcs_command(*command), "scan_2.ply: expected space", "write to another disk")
    assert {path.name: path.read_bytes() for path in Path().iterdir()} == before


def test_what_was_asked_for_is_reported_also_if_there_was_nothing_to_do(printed, scan):
    rows = rows_of(printed("simplify", "scan.ply", "-o", "out.ply", "--points", 50, "--max-gap", 99, *FAST))
    assert "added in gaps 0" in rows
    command = ("simplify", "scan.ply", "-o", "out.ply", "--points", 50, "--drop-outliers", "--force")
    assert "outliers 0" in rows_of(printed(*command, *FAST))
