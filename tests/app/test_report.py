"""`gppcs report` and `gppcs view`."""

import hashlib
import warnings
import webbrowser

import numpy as np
import pytest

import gppcs
from command_line import FAST, described, files


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


@pytest.mark.slow
def test_meshes_are_rebuilt_when_asked_for(gppcs_command, folder, monkeypatch):
    pytest.importorskip("pymeshlab")
    ball = gppcs.sample("sphere", 2000)
    gppcs.write("ball.ply", ball)
    gppcs.write("small.ply", ball.take(np.arange(500)))
    monkeypatch.setattr("gppcs.app.pages.MOST_TO_REBUILD", 1999)
    code, _, err = gppcs_command("report", "ball.ply", "small.ply", "-o", "r.html", "--meshes")
    assert code == 0
    assert (err.split(": ")[:2], err.count("\n")) == (["gppcs", "note"], 1)
    original, result = described("r.html")["clouds"]
    assert original["mesh"] is None
    low, step = (np.array(result["mesh"][key]) for key in ("low", "step"))
    np.testing.assert_allclose([low, low + 65535 * step], [ball.points.min(axis=0), ball.points.max(axis=0)], atol=5)


def test_files_of_one_name_are_told_apart_by_their_folders(printed, folder, scan, small):
    (folder / "other").mkdir()
    gppcs.write("other/small.ply", scan.take(np.arange(50)))
    printed("report", "scan.ply", "small.ply", "other/small.ply", "-o", "r.html")
    assert [cloud["name"] for cloud in described("r.html")["clouds"]] == ["scan.ply", "small.ply", "other/small.ply"]


def test_view_opens_a_temporary_page(printed, scan, small, opened, tmp_path_factory, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path_factory.mktemp("temporary")))
    out = printed("view", "scan.ply", "voxel.csv")
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


def test_without_a_browser_view_says_where_the_page_is(gppcs_command, printed, scan, monkeypatch):
    monkeypatch.setattr(webbrowser, "open", lambda page: False)
    told = "gppcs: note: no browser was found; open v.html yourself\n"
    assert gppcs_command("view", "scan.ply", "-o", "v.html") == (0, "v.html\n", told)
    assert printed("view", "scan.ply", "-o", "v.html", "--no-open", "--force") == "v.html\n"


def test_a_cloud_of_any_size_is_shown_without_a_warning(gppcs_command, folder):
    gppcs.write("huge.ply", np.random.default_rng(0).random((300, 3)) * 1e300)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        command = "simplify huge.ply -o out.ply --points 30"
        assert gppcs_command(*command.split(), *FAST)[0] == 0
        assert gppcs_command("report", "huge.ply", "out.ply", "-o", "page.html")[0] == 0
