"""The options that ask for an accuracy, a spacing, points to keep or leave out, and several sizes."""

import errno
import math
import re
from itertools import pairwise
from pathlib import Path

import laspy
import numpy as np
import pytest

import gppcs
from command_line import FAST, rows_of
from gppcs import io


def test_a_tolerance_is_reached_by_evaluate(gppcs_command, record, scan):
    rows = rows_of(gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--tolerance", "2%:mean")[1])
    ((reached,),) = filter(None, (re.findall(r"^surface mean (\S+) \(asked: 2%\)$", row) for row in rows))
    told = record("evaluate", "scan.ply", "out.ply")
    assert told["figures"]["surface_mean"] == pytest.approx(float(reached), rel=1e-3)
    assert told["relative"]["surface_mean"] <= 0.02


def test_a_tolerance_that_the_points_do_not_resolve_is_told(gppcs_command, scan):
    for tolerance, told in (("0.01%", True), ("9%", False)):
        _, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--force", "--tolerance", tolerance, *FAST)
        assert ("of the points; it is below what their spacing and noise resolve" in err) == told


def las_in(wkt, keys=()):
    """Write a.las, whose coordinate system is given as WKT or as keys of GeoTIFF."""
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.x, las.y, las.z = np.random.default_rng(0).uniform(0, 9, (200, 3)).T
    las.header.global_encoding.wkt = bool(wkt)
    number, content = (2112, wkt) if wkt else (34735, np.array([1, 1, 0, len(keys), *keys], "<u2").tobytes())
    las.header.vlrs.append(laspy.VLR("LASF_Projection", number, "", content))
    las.write("a.las")


def test_a_unit_that_is_not_that_of_the_file_is_told(gppcs_command, folder):
    las_in(b'PROJCS["UTM 32N",UNIT["metre",1]]\0')
    words = ["simplify", "a.las", "-o", "out.las", "--force", "--max-gap", "500cm", "-q", *FAST]
    for unit, told in (("m", False), ("mm", True)):
        code, _, err = gppcs_command(*words, "--unit", unit)
        assert code == 0
        assert ("note: a.las: its coordinate system says that the unit is m; --unit mm is used" in err) == told


SPECTRAL = ("--method", "gp-spectral", "--set", "k_add=5", "--set", "nu=inf", "--set", "seed=3")


def test_options_do_what_the_library_does(printed, scan):
    for options, wanted in (
        (["--spacing", "1cm", "--unit", "mm", *FAST], {"spacing": 10.0, "method": "fps"}),
        (["--points", 20, "--max-gap", 30, *FAST], {"n_points": 20, "max_gap": 30.0, "method": "fps"}),
        (["--points", 50, "--keep", "z > 60"], {"n_points": 50, "keep": "z > 60"}),
        (["--points", 50, "--weight", "red"], {"n_points": 50, "weight": "red"}),
        (["--points", 50, "--quota", "z > 60: 30%"], {"n_points": 50, "quota": {"z > 60": "30%"}}),
        (["--ratio", "20%", "--group", "red"], {"ratio": 0.2, "group": "red"}),
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


def test_each_file_of_a_level_is_named(printed, record, scan):
    command = ("simplify", "scan.ply", "-o", "scan_{level}.ply", "--levels", "20,40,100", *FAST, "--force")
    rows = rows_of(printed(*command))
    assert rows[:2] == ["scan.ply → scan_0.ply, scan_1.ply, scan_2.ply", "points 400 in, 100 out (25 %)"]
    assert rows[2:5] == [f"level {n} scan_{n}.ply: {count} points" for n, count in enumerate([20, 40, 100])]
    told, levels = record(*command), [{"output": f"scan_{n}.ply", "points_out": k} for n, k in enumerate([20, 40, 100])]
    assert (told["output"], told["levels"]) == ("scan_2.ply", levels)
    gppcs.write("other.ply", scan)
    command = ("simplify", "scan.ply", "other.ply", "-o", "{stem}_{level}.ply", "--levels", "20,40", *FAST, "--force")
    assert printed(*command).splitlines()[1].startswith("other.ply → other_0.ply, other_1.ply: 400 points in, 40 out")


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


def test_a_full_disk_leaves_no_level(refused, scan, monkeypatch):
    store, calls = io.store, []

    def on_full_disk(*arguments):
        calls.append(arguments)
        if len(calls) == 3:
            raise OSError(errno.ENOSPC, "No space left on device", "scan_2.ply")
        return store(*arguments)

    monkeypatch.setattr(io, "store", on_full_disk)
    words = ("simplify", "scan.ply", "-o", "scan_{level}.ply", "--levels", "20,40,60", *FAST)
    refused(words, "scan_2.ply: No space left on device")


def test_detail_that_counts_for_nothing_is_told(gppcs_command):
    rng = np.random.default_rng(0)
    cloud = gppcs.PointCloud(rng.random((2_000, 3)), {"grey": np.full(2_000, 7.0), "noise": rng.random(2_000)})
    gppcs.write("scan.ply", cloud)
    for name, told in (("grey", "attribute 'grey' is 7 everywhere"), ("noise", "the detail is only noise")):
        words = ("simplify", "scan.ply", "-o", f"{name}.ply", "--points", 200, "-q", "--detail", name)
        code, _, err = gppcs_command(*words)
        assert (code, err.count("\n")) == (0, 1)
        assert err.startswith(f"gppcs: note: {told}")
