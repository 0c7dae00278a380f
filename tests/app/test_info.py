"""`gppcs info`."""

import dataclasses
import json
import os

import numpy as np
import pytest

import gppcs
from command_line import write_scan_with


def test_info_prints_the_facts(gppcs_command):
    def spoil(points):
        points[5] = points[4]
        points[9, 1] = np.inf

    write_scan_with(spoil)
    code, out, err = gppcs_command("info", "scan.ply")
    assert (code, err) == (0, "")
    rows = [" ".join(row.split()) for row in out.splitlines()]
    assert rows[:2] == ["scan.ply", "points 400"]
    for row in ("low corner -50 -30 0", "repeats 1", "not finite 1", "coordinates float32", "attribute red uint8"):
        assert row in rows
    assert any(row.startswith("spacing 3.") for row in rows)


def test_info_json_is_the_summary(gppcs_command, scan):
    code, out, err = gppcs_command("info", "scan.ply", "--json")
    summary = json.loads(json.dumps(dataclasses.asdict(gppcs.info(scan))))
    assert (code, json.loads(out), err) == (0, {"file": "scan.ply"} | summary, "")


@pytest.mark.parametrize("points", [np.empty((0, 3)), np.full((2, 3), np.nan)])
def test_info_of_clouds_without_finite_points(gppcs_command, points):
    gppcs.write("scan.ply", gppcs.PointCloud(points))
    code, out, err = gppcs_command("info", "scan.ply", "--json")
    record = json.loads(out, parse_constant=pytest.fail)
    assert (code, err) == (0, "")
    assert (record["points"], record["non_finite"], record["low"]) == (len(points), len(points), [None] * 3)
    code, out, err = gppcs_command("info", "scan.ply")
    assert (code, err) == (0, "")
    assert "spacing nan" in " ".join(out.split())


@pytest.mark.parametrize("name", ["[red]a:smile:.ply", f"{'long' * 40}.ply", "två\n.ply", os.fsdecode(b"\xff.ply")])
def test_any_file_name_is_printed_as_it_is(gppcs_command, name):
    gppcs.write(name, gppcs.sample("sphere", 30))
    code, out, err = gppcs_command("info", name)
    assert (code, err) == (0, "")
    assert out.startswith(name.encode(errors="backslashreplace").decode() + "\n")
