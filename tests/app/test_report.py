"""`gppcs report` and `gppcs view`."""

import hashlib
import os
import webbrowser
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import described, files
from gppcs.evaluation.reconstruction import distances_to
from web_page import WebPage


@pytest.fixture
def small(scan):
    """Two simplified clouds in files."""
    gppcs.write("small.ply", gppcs.simplify(scan, n_points=60, method="fps").cloud)
    gppcs.write("voxel.csv", gppcs.simplify(scan, n_points=60, method="voxel").cloud)


@pytest.fixture
def opened(monkeypatch):
    """The pages that were opened in the browser."""
    pages = []
    monkeypatch.setattr(webbrowser, "open", lambda page: pages.append(page) or True)
    return pages


def test_a_report_holds_the_clouds_and_how_it_was_made(printed, folder, scan, small):
    words = ["report", "scan.ply", "small.ply", "voxel.csv", "-o", "a b.html", "--up", "y"]
    out = printed(*words)
    assert out.startswith("a b.html: 0.")
    page = described("a b.html")
    assert [cloud["name"] for cloud in page["clouds"]] == ["scan.ply", "small.ply", "voxel.csv"]
    assert all(len(cloud["prefixes"]) == 4 for cloud in page["clouds"][1:])
    made = dict(page["made"])
    assert made["gppcs"] == gppcs.__version__
    assert made["command"] == "gppcs report scan.ply small.ply voxel.csv -o 'a b.html' --up y"
    assert made["SHA-256 of scan.ply"] == hashlib.sha256((folder / "scan.ply").read_bytes()).hexdigest()
    assert page["up"] == "y"


def test_the_notes_of_a_report_are_printed_too(gppcs_command, folder, scan):
    gppcs.write("far.ply", scan[:60].points + 1e5)
    code, _, err = gppcs_command("report", "scan.ply", "far.ply", "-o", "r.html", "--quiet")
    notes = described("r.html")["notes"]
    assert code == 0
    assert "far.ply: there are no figures" in notes[0]
    assert err.splitlines() == [f"gppcs: note: {note}" for note in notes]


def test_view_opens_a_temporary_page(printed, scan, small, opened, tmp_path_factory, monkeypatch):
    temporary = tmp_path_factory.mktemp("temporary")
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    earlier = [Path(printed("view", "scan.ply").strip()) for _ in range(2)]
    opened.clear()
    os.utime(earlier[0], (0, 0))
    out = printed("view", "scan.ply", "voxel.csv")
    assert {*temporary.iterdir()} == {earlier[1].parent, Path(out.strip()).parent}  # not the old one
    assert [page.startswith("file://") for page in opened] == [True]
    assert [cloud["role"] for cloud in described(out.strip())["clouds"]] == ["cloud", "cloud"]
    assert files() == ["scan.ply", "small.ply", "voxel.csv"]


def test_view_shows_the_faces_of_a_mesh(printed, refused, folder, opened):
    tent = gppcs.Mesh([[0, 0, 0], [2, 0, 0], [2, 2, 0], [1, 1, 1]], [[0, 1, 3], [1, 2, 3], [2, 0, 3]])
    gppcs.write_mesh("tent.ply", tent)
    assert printed("view", "tent.ply", "-o", "v.html", "--no-open") == "v.html\n"
    [cloud] = described("v.html")["clouds"]
    assert (cloud["points"], cloud["mesh"]["triangles"]) == (4, 3)
    content = (folder / "tent.ply").read_bytes()
    (folder / "tent.ply").write_bytes(content[:-4] + b"\xff\xff\xff\x7f")  # the last corner is no vertex
    refused(("view", "tent.ply", "-o", "bad.html", "--no-open"), "tent.ply: ", "indices of vertices 0 to 3")


def test_results_have_the_surface_through_them_and_a_mesh_is_judged_by_its_surface(gppcs_command, folder):
    ball = gppcs.sample("sphere", 3000)
    result, mesh = gppcs.simplify(ball, n_points=200, method="fps"), gppcs.mesh(ball, n_points=100).mesh
    gppcs.write("ball.ply", ball)
    gppcs.write("small.ply", result)
    gppcs.write_mesh("mesh.ply", mesh)
    assert gppcs_command("report", "ball.ply", "small.ply", "mesh.ply", "-o", "r.html", "-q")[0] == 0
    page = described("r.html")
    original, small, light = page["clouds"]
    assert (original["mesh"], page["solid"]) == (None, True)
    assert (small["counted"], small["mesh"]["vertices"], small["mesh"]["missed"]) == ("points", 200, 0)
    assert (light["counted"], light["mesh"]["triangles"]) == ("vertices", len(mesh.faces))
    [prefix] = light["prefixes"]
    distances = distances_to(mesh, ball.points)
    assert prefix["figures"]["surface_mean"] == pytest.approx(distances.mean(), rel=1e-4)
    assert prefix["figures"]["surface_max"] == pytest.approx(distances.max(), rel=1e-4)
    assert f"100 vertices, {len(mesh.faces)} triangles" in page["lead"]
    err = gppcs_command("report", "small.ply", "ball.ply", "-o", "s.html", "-q")[2]
    assert err.count("more points than the first") == 1  # not for each number of points


def test_a_sparse_cloud_is_seen_as_the_surface_through_it(printed, folder):
    gppcs.write("small.ply", gppcs.sample("sphere", 300))
    printed("view", "small.ply", "-o", "v.html", "--no-open")
    page = described("v.html")
    assert (page["lead"], page["solid"], page["clouds"][0]["mesh"]["vertices"]) == ("300 points", True, 300)


def test_points_that_lie_on_no_surface_are_seen_beside_it(printed, folder):
    ball = gppcs.sample("sphere", 3000)
    stray = np.random.default_rng(0).uniform(60, 90, (10, 3))
    gppcs.write("ball.npy", np.vstack([ball.points, stray]))
    gppcs.write("small.npy", np.vstack([ball.points[:300], stray]))
    printed("report", "ball.npy", "small.npy", "-o", "r.html")
    page = WebPage(Path("r.html").read_text("utf-8"))
    mesh = page.described["clouds"][1]["mesh"]
    assert mesh["missed"] == 10
    assert page.array(mesh["blocks"]["missed"], 10, 1, np.uint32).ravel().tolist() == [*range(300, 310)]
