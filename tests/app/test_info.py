"""`gppcs info`."""

import dataclasses
import json
from pathlib import Path

import numpy as np

import gppcs
from command_line import rows_of
from gppcs.io.format import Reader


def test_info_prints_the_facts(printed):
    points = gppcs.sample("bracket", 400).points
    points[5] = points[4]
    points[9, 1] = np.inf
    gppcs.write("scan.ply", points)
    out = printed("info", "scan.ply")
    rows = rows_of(out)
    assert rows[:2] == ["scan.ply", "points 400"]
    assert {
        "minimum -50 -30 0",
        "repeats 1",
        "non finite 1",
        "unit that of the coordinates, which the file does not say",
    } <= set(rows)
    assert any(row.startswith("spacing 3.") for row in rows)


def test_info_prints_type_and_range_of_each_attribute(printed):
    attributes = {
        "class": np.array([2, 200, 7], np.uint8),
        "time": np.array([0.25, np.nan, 1e9 + 0.5]),
        "nothing": np.full(3, np.nan, np.float32),
        "same": np.full(3, 2**60 + 1),
        "number_of_returns": np.arange(3),
        "scan angle": np.arange(3),
    }
    gppcs.write("scan.npz", gppcs.PointCloud(np.eye(3), attributes))
    assert [row for row in rows_of(printed("info", "scan.npz")) if row.startswith("attribute")] == [
        "attribute class uint8 2 to 200",
        "attribute time float64 0.25 to 1e+09",
        "attribute nothing float32",
        "attribute same int64 1,152,921,504,606,846,977",
        "attribute number_of_returns int64 0 to 2",
        'attribute ["scan angle"] int64 0 to 2',
    ]
    for name in ("number_of_returns", 'attributes["scan angle"]'):  # names work in conditions as they are printed
        assert "points 1" in rows_of(printed("info", "scan.npz", "--only", f"{name} == 2"))


def test_info_json_is_the_summary(record, scan):
    summary = json.loads(json.dumps(dataclasses.asdict(gppcs.info(scan))))
    assert record("info", "scan.ply") == {"file": "scan.ply"} | summary | {"classes": {}, "faces": 0}


def test_of_large_las_files_the_header_is_shown_and_points_per_class_with_all(printed, record, monkeypatch):
    classes = np.repeat(np.array([2, 6, 200], np.uint8), [700, 200, 100])
    points = np.random.default_rng(0).integers(0, 1000, (1000, 3)) / 100
    gppcs.write("scan.laz", gppcs.PointCloud(points, {"classification": classes}))
    by_points = record("info", "scan.laz")
    assert by_points["classes"] == {"2 ground": 700, "6 building": 200, "200": 100}
    assert "class 2 ground 700 (70.0%)" in rows_of(printed("info", "scan.laz"))
    monkeypatch.setattr("gppcs.app.commands.info.LARGE", 500)
    assert record("info", "scan.laz", "--all") == by_points
    monkeypatch.setattr(Reader, "read", None)
    monkeypatch.setattr("gppcs.io.cloud_files.BLOCK", 10)
    by_header = record("info", "scan.laz")
    assert by_header["ranges"]["classification"] is by_header["spacing"] is None
    for name in ("points", "minimum", "maximum", "attributes"):
        assert by_header[name] == by_points[name]
    assert any(row.startswith("density 10.") for row in rows_of(printed("info", "scan.laz")))


def test_info_takes_several_files_and_folders(gppcs_command, printed, scan):
    Path("tiles").mkdir()
    gppcs.write("tiles/b.csv", scan)
    gppcs.write("tiles/a.ply", scan)
    Path("broken.ply").write_text("ply\n")
    code, out, err = gppcs_command("info", "scan.ply", "broken.ply", "missing.ply", "tiles", "--json")
    assert code == 2
    assert [json.loads(line)["file"] for line in out.splitlines()] == ["scan.ply", "tiles/a.ply", "tiles/b.csv"]
    assert [line.split(": ")[1] for line in err.splitlines()] == ["broken.ply", "missing.ply"]
    names = [line for line in printed("info", "scan.ply", "tiles").splitlines() if "." in line and " " not in line]
    assert names == ["scan.ply", "tiles/a.ply", "tiles/b.csv"]
