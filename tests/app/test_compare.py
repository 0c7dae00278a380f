"""`gppcs compare`."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import assert_one_line, files
from web_page import WebPage


def test_compare_writes_tables_and_prints_one(printed, scan):
    out = printed("compare", "scan.ply", "--ratio", 0.1, "--methods", "fps, random", "-o", "side", "--no-picture")
    assert sorted(path.name for path in Path("side").iterdir()) == ["table.csv", "table.md"]
    titles, *rows = Path("side/table.csv").read_text().splitlines()
    assert titles.startswith("method,parameters,seconds,points_in,points_out,")
    assert titles.endswith(",failure")
    assert rows[1].startswith("random,seed=0 even=False,")
    assert [row.split(",")[0] for row in rows] == ["fps", "random"]
    assert "| fps | 40 |" in Path("side/table.md").read_text()
    first = [line.split()[:2] for line in out.splitlines() if line]
    assert ["fps", "40"] in first
    assert ["random", "40"] in first
    assert out.endswith("side: table.csv, table.md\n")


def test_attributes_count_in_gp_and_are_measured_for_all(printed, tmp_path):
    gppcs.write("wall.ply", gppcs.sample("fresco", 8_000))
    words = ["compare", "wall.ply", "--points", 800, "--methods", "gp,fps", "-o", "side", "--no-picture", "--report"]
    printed(*words, "--detail", "rgb:1.5")
    titles, *rows = (line.split("|") for line in Path("side/table.md").read_text().splitlines() if "|" in line)
    column = [title.strip() for title in titles].index("rgb error mean")
    gp, fps = (float(row[column].strip(" *")) for row in rows[1:])
    assert gp < 0.8 * fps
    (original, *_) = WebPage(Path("side/report.html").read_text(encoding="utf-8")).described["clouds"]
    assert {"error:rgb:1", "error:rgb:2"} <= {each["key"] for each in original["values"]}


def test_compare_writes_a_report_of_all_methods(printed, scan):
    words = ["compare", "scan.ply", "--ratio", "10%", "--methods", "fps,random", "-o", "side", "--no-picture"]
    out = printed(*words, "--report", "--up", "y")
    assert out.endswith("side: table.csv, table.md, report.html\n")
    described = WebPage(Path("side/report.html").read_text(encoding="utf-8")).described
    assert [cloud["name"] for cloud in described["clouds"]] == ["scan.ply", "fps", "random"]
    assert all(len(cloud["prefixes"]) == 4 for cloud in described["clouds"][1:])
    reasons = [None, gppcs.METHODS["fps"].summary, gppcs.METHODS["random"].summary]
    assert [cloud["reason"] for cloud in described["clouds"]] == reasons
    assert dict(described["made"])["command"] == f"gppcs {' '.join(words)} --report --up y"
    assert described["up"] == "y"


def test_compare_json_is_one_object_a_method(gppcs_command, scan):
    options = ("--points", 40, "--methods", "fps,random", "--seed", 3, "-o", "side", "--no-picture", "--json")
    code, out, _ = gppcs_command("compare", "scan.ply", *options)
    records = [json.loads(line) for line in out.splitlines()]
    assert code == 0
    assert [(record["method"], record["parameters"]) for record in records] == [
        ("fps", {}),
        ("random", {"seed": 3, "even": False}),
    ]
    assert records[0]["figures"] == gppcs.compare(gppcs.read("scan.ply"), ["fps"], n_points=40)[0].report.figures()


@pytest.mark.parametrize("options", [("--points", "0.04k"), ("--ratio", "10%")])
def test_compare_into_an_empty_folder_and_again_with_force(gppcs_command, scan, options):
    Path("side").mkdir()
    arguments = ("compare", "scan.ply", *options, "--methods", "fps", "-o", "side", "--no-picture", "-q")
    assert gppcs_command(*arguments) == (0, "", "")
    assert "| fps | 40 |" in Path("side/table.md").read_text()
    assert gppcs_command(*arguments)[0] == 2
    assert gppcs_command(*arguments, "--force") == (0, "", "")


def test_compare_drops_invalid_points_when_asked_to(printed, scan):
    scan.points[9] = np.nan
    gppcs.write("broken.ply", scan)
    options = ("--points", 40, "--methods", "fps", "-o", "side", "--no-picture", "--drop", "invalid", "--json")
    out = printed("compare", "broken.ply", *options)
    assert json.loads(out)["figures"]["points_in"] == 399


@pytest.mark.slow
def test_compare_draws_clouds_and_meshes(gppcs_command, monkeypatch):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    columns = []
    monkeypatch.setattr("gppcs.drawing.side_by_side.draw_comparison", lambda file, given, *_: columns.extend(given))
    ball = gppcs.sample("sphere", 2000)
    ball.points[7] = np.nan
    gppcs.write("ball.ply", ball)
    options = ("--points", 200, "--methods", "fps,random", "-o", "side", "--drop", "invalid", "--report")
    assert gppcs_command("compare", "ball.ply", *options)[::2] == (0, "")
    assert [column.title for column in columns] == ["original", "fps", "random"]
    assert [len(column.cloud.points) for column in columns] == [1999, 200, 200]
    assert all(column.mesh for column in columns)
    page = WebPage(Path("side/report.html").read_text(encoding="utf-8")).described
    assert [cloud["mesh"]["triangles"] for cloud in page["clouds"]] == [len(column.mesh.faces) for column in columns]


@pytest.mark.slow
def test_compare_rebuilds_no_mesh_of_an_original_too_large_for_it(gppcs_command, monkeypatch):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    monkeypatch.setattr("gppcs.app.pages.MOST_TO_REBUILD", 1000)
    gppcs.write("ball.ply", gppcs.sample("sphere", 1999))
    code, _, err = gppcs_command("compare", "ball.ply", "--points", 200, "--methods", "random", "-o", "side")
    assert code == 0
    assert "no mesh of the original: it has 1,999 points" in err
    assert err.count("\n") == 1
    assert Path("side/picture.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("above", ["nowhere", "readonly"])
def test_a_folder_that_cannot_be_made_is_told_before_any_work(gppcs_command, scan, monkeypatch, above):
    Path(above).symlink_to("missing") if above == "nowhere" else Path(above).mkdir()
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "readonly" and access(path, mode))
    output, part = {
        "nowhere": ("nowhere", "nowhere: expected a folder, found a link to nothing"),
        "readonly": ("readonly/side", "no permission"),
    }[above]
    assert_one_line(gppcs_command("compare", "missing.ply", "--points", 9, "-o", output, "--no-picture"), part)


@pytest.fixture
def ball(folder):
    """The cloud in the file ball.ply."""
    pytest.importorskip("pymeshlab")
    cloud = gppcs.sample("sphere", 1000)
    gppcs.write("ball.ply", cloud)
    return cloud


MESHES = ("compare", "ball.ply", "--points", 100, "--meshes", "-o", "side")


def test_compare_meshes_writes_tables_and_prints_one(printed, ball):
    out = printed(*MESHES, "--methods", "mesh, ball-pivoting", "--no-picture")
    titles, *rows = Path("side/table.csv").read_text().splitlines()
    assert titles.startswith("way,seconds,vertices,triangles,")
    assert [row.split(",")[0] for row in rows] == ["mesh", "ball-pivoting"]
    assert "| mesh | 100 | 196 |" in Path("side/table.md").read_text()
    assert ["mesh", "100", "196"] in [line.split()[:3] for line in out.splitlines()]
    assert out.endswith("side: table.csv, table.md\n")


def test_compare_meshes_json_is_one_object_a_way_and_a_note_tells_of_failures(gppcs_command, ball):
    gppcs.write("ball.ply", np.random.default_rng(0).random((400, 3)), force=True)
    code, out, err = gppcs_command(*MESHES, "--methods", "mesh,ball-pivoting", "--no-picture", "--json")
    mesh, pivoted = map(json.loads, out.splitlines())
    assert (code, mesh["way"], mesh["figures"], pivoted["failure"]) == (0, "mesh", {}, None)
    assert "fill a volume" in mesh["failure"]
    assert err.startswith("gppcs: note: mesh: expected points on a surface")
    assert err.count("\n") == 1
    assert pivoted["figures"]["triangles"] > 0


def test_compare_meshes_draws_a_column_for_each_mesh(gppcs_command, ball, monkeypatch):
    for module in ("pyvista", "matplotlib"):
        pytest.importorskip(module)
    columns = []
    monkeypatch.setattr("gppcs.drawing.side_by_side.draw_comparison", lambda file, given, *_: columns.extend(given))
    monkeypatch.setattr("gppcs.engine.extras._opengl_works", lambda: True)
    surface = gppcs.mesh(ball, n_points=500).mesh
    gppcs.write_mesh("surface.ply", surface)
    ball.points[7] = np.nan
    gppcs.write("ball.ply", ball, force=True)
    options = ("--methods", "mesh,ball-pivoting", "--drop", "invalid", "--mesh", "surface.ply", "-q")
    assert gppcs_command(*MESHES, *options) == (0, "", "")
    assert [column.title for column in columns] == ["original", "mesh", "ball-pivoting"]
    original, mesh, _ = columns
    assert (len(original.cloud.points), len(original.mesh.faces)) == (999, len(surface.faces))
    assert (len(mesh.cloud.points), len(mesh.mesh.faces), mesh.counted) == (100, 196, "vertices")
    assert mesh.caption.startswith("mesh mean\n")


def test_compare_meshes_shows_them_in_the_report(printed, ball):
    out = printed(*MESHES, "--methods", "mesh,ball-pivoting", "--no-picture", "--report")
    assert out.endswith("side: table.csv, table.md, report.html\n")
    original, *results = WebPage(Path("side/report.html").read_text(encoding="utf-8")).described["clouds"]
    assert [cloud["name"] for cloud in (original, *results)] == ["ball.ply", "mesh", "ball-pivoting"]
    assert original["mesh"] is None
    assert results[0]["mesh"]["triangles"] == 196
    assert results[1]["mesh"]["triangles"] > 150


def test_compare_meshes_writes_tables_if_no_way_finds_a_surface(gppcs_command, ball):
    gppcs.write("ball.ply", np.random.default_rng(0).random((400, 3)), force=True)
    code, out, err = gppcs_command(*MESHES, "--methods", "mesh", "--no-picture", "--report")
    assert (code, err.count("\n")) == (0, 1)
    assert out.endswith("side: table.csv, table.md\n")


@pytest.mark.parametrize(("name", "read"), [("table.csv", "scan.ply"), ("table.md", "mesh.ply")])
def test_compare_never_overwrites_an_input_through_its_folder(gppcs_command, scan, name, read):
    gppcs.write("mesh.ply", scan)
    Path("side").mkdir()
    Path("side", name).hardlink_to(read)
    before = Path(read).read_bytes()
    options = ("--mesh", "mesh.ply", "--ratio", 0.1, "--methods", "fps", "--no-picture", "--force")
    told = f"side/{name}: expected a file other than the input {read}, found the same"
    assert_one_line(gppcs_command("compare", "scan.ply", *options, "-o", "side"), told)
    assert Path(read).read_bytes() == before
    assert [path.name for path in Path("side").iterdir()] == [name]


@pytest.mark.parametrize("module", ["pymeshlab", "pyvista"])
def test_compare_names_the_missing_extra_before_any_work(gppcs_command, scan, monkeypatch, module):
    pytest.importorskip("pymeshlab")
    monkeypatch.setitem(sys.modules, module, None)
    extra = {"pymeshlab": "evaluate", "pyvista": "view"}[module]
    code, _, err = gppcs_command("compare", "scan.ply", "--ratio", 0.1, "-o", "side")
    assert code == 2
    assert f"(the extra {extra}): pip install '" in err
    assert f"'{module}>=" in err
    assert files() == ["scan.ply"]
