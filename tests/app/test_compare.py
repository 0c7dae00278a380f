"""`gppcs compare`."""

import csv
import json
from pathlib import Path

import gppcs
from command_line import described
from gppcs.app.tables import SHOWN
from gppcs.evaluation.report import definition_of

COMPARE = ("compare", "scan.ply", "--ratio", 0.1, "--methods", "fps, random", "-o", "side", "--no-picture")


def test_compare_writes_tables_and_a_page_and_prints_one(printed, scan):
    words = [*COMPARE, "--report", "--up", "y"]
    out = printed(*words)
    assert sorted(path.name for path in Path("side").iterdir()) == ["report.html", "table.csv", "table.md"]
    assert {("fps", "40"), ("random", "40")} <= {tuple(line.split()[:2]) for line in out.splitlines()}
    assert out.endswith("side: table.csv, table.md, report.html\n")
    page = described("side/report.html")
    assert [cloud["name"] for cloud in page["clouds"]] == ["scan.ply", "fps", "random"]
    assert all(len(cloud["prefixes"]) == 4 for cloud in page["clouds"][1:])
    reasons = [None, gppcs.METHODS["fps"].summary, gppcs.METHODS["random"].summary]
    assert [cloud["reason"] for cloud in page["clouds"]] == reasons
    assert page["up"] == "y"


def test_compare_json_is_one_object_a_method(printed, scan):
    records = [json.loads(line) for line in printed(*COMPARE, "--seed", 3, "--json").splitlines()]
    parameters = [("fps", {}), ("random", {"seed": 3, "even": False})]
    assert [(record["method"], record["parameters"]) for record in records] == parameters
    assert records[0]["figures"] == gppcs.compare(gppcs.read("scan.ply"), ["fps"], n_points=40)[0].report.figures()


def test_csv_holds_every_figure_raw_and_relative_and_markdown_the_best_in_bold(printed, scan):
    printed(*COMPARE)
    entries = gppcs.compare(gppcs.read("scan.ply"), ["fps", "random"], ratio=0.1)
    rows = [*csv.DictReader(Path("side/table.csv").read_text().splitlines())]
    assert ([*rows[0]][:3], [*rows[0]][-1]) == (["method", "parameters", "seconds"], "failure")
    assert rows[1]["parameters"] == "seed=0 even=False"
    for row, entry in zip(rows, entries, strict=True):
        raw, relative = entry.report.figures(), entry.report.figures(relative=True)
        assert row["method"] == entry.method.name
        assert {name: float(row[name]) for name in raw} == raw
        lengths = {name for name in raw if definition_of(name).power} - {"diagonal"}
        assert {name: float(row[f"{name}_relative"]) for name in lengths} == {name: relative[name] for name in lengths}
    titles, _, fps, random = (
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in Path("side/table.md").read_text().split("\n")[:4]
    )
    radius = titles.index("covering radius")
    best = 1e4 * entries[0].report.covering_radius / entries[0].report.diagonal
    assert (random[0], random[titles.index("points")], fps[radius]) == ("random", "40", f"**{best:.0f}**")
    assert "*" not in random[radius]
    assert "surface mean" in titles
    assert "hausdorff mean" not in titles
    assert all(definition_of(name) for name in SHOWN if name != "seconds")
