"""`gppcs compare`."""

import json
from pathlib import Path

import gppcs
from web_page import WebPage

COMPARE = ("compare", "scan.ply", "--ratio", 0.1, "--methods", "fps, random", "-o", "side", "--no-picture")


def table_of(suffix):
    return Path(f"side/table.{suffix}").read_text()


def page():
    return WebPage(Path("side/report.html").read_text("utf-8")).described


def test_compare_writes_tables_and_a_page_and_prints_one(printed, scan):
    words = [*COMPARE, "--report", "--up", "y"]
    out = printed(*words)
    assert sorted(path.name for path in Path("side").iterdir()) == ["report.html", "table.csv", "table.md"]
    titles, *rows = table_of("csv").splitlines()
    assert titles.startswith("method,parameters,seconds,points_in,points_out,")
    assert titles.endswith(",failure")
    assert rows[1].startswith("random,seed=0 even=False,")
    assert [row.split(",")[0] for row in rows] == ["fps", "random"]
    assert "| fps | 40 |" in table_of("md")
    assert {("fps", "40"), ("random", "40")} <= {tuple(line.split()[:2]) for line in out.splitlines()}
    assert out.endswith("side: table.csv, table.md, report.html\n")
    assert [cloud["name"] for cloud in page()["clouds"]] == ["scan.ply", "fps", "random"]
    assert all(len(cloud["prefixes"]) == 4 for cloud in page()["clouds"][1:])
    reasons = [None, gppcs.METHODS["fps"].summary, gppcs.METHODS["random"].summary]
    assert [cloud["reason"] for cloud in page()["clouds"]] == reasons
    assert page()["up"] == "y"


def test_compare_json_is_one_object_a_method(printed, scan):
    records = [json.loads(line) for line in printed(*COMPARE, "--seed", 3, "--json").splitlines()]
    parameters = [("fps", {}), ("random", {"seed": 3, "even": False})]
    assert [(record["method"], record["parameters"]) for record in records] == parameters
    assert records[0]["figures"] == gppcs.compare(gppcs.read("scan.ply"), ["fps"], n_points=40)[0].report.figures()
