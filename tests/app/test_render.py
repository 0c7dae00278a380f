"""`gppcs render`, and the options of pictures in all commands: `--view`, `--up` and `--colour`."""

import gzip
from pathlib import Path

import numpy as np
import pytest

import gppcs


@pytest.fixture(autouse=True)
def matplotlib():
    return pytest.importorskip("matplotlib")


def image(path):
    from matplotlib.image import imread

    return imread(path)[..., :3]


def test_a_scan_is_drawn_by_its_rgb(printed, folder, scan):
    told = "scan.png: 320 x 200 pixels, coloured by RGB\n"
    assert printed("render", "scan.ply", "-o", "scan.png", "--size", "320x200") == told
    assert image("scan.png").shape == (200, 320, 3)


def test_the_stages_of_a_long_run_go_to_stderr_without_a_terminal(gppcs_command, folder, scan, monkeypatch):
    monkeypatch.setattr("gppcs.engine.progress.PATIENCE", 0.0)
    gppcs.write("few.ply", gppcs.simplify(scan, n_points=100))
    _, out, err = gppcs_command("render", "scan.ply", "few.ply", "-o", "both.png")
    assert out.startswith("both.png: ")
    assert err.splitlines() == [f"progress: {stage}" for stage in ("reading", "surface", "colours", "drawing")]


def test_the_options_turn_and_colour_the_picture(printed, folder, scan):
    options = ((), ("--colour", "curvature"), ("--colour", "variation"), ("--up", "x"), ("--view", "200,-10"))
    pictures = []
    for number, given in enumerate(options):
        name = f"{number}.png"
        assert printed("render", "scan.ply", "-o", name, "--size", "160x120", "-q", *given) == ""
        pictures.append(Path(name).read_bytes())
    assert len(set(pictures)) == len(options)
    printed("render", "scan.ply", "-o", "0.png", "--size", "160x120", "--force", "-q")
    assert Path("0.png").read_bytes() == pictures[0]


def test_what_the_picture_does_not_show_is_told(gppcs_command, folder, scan):
    points = np.vstack([scan.points, [[np.nan, 0.0, 0.0], [1e9, 0.0, 0.0]]])
    gppcs.write("more.npy", gppcs.PointCloud(points))
    code, out, err = gppcs_command("render", "more.npy", "-o", "a.png", "--size", "100x100")
    assert (code, out) == (0, "a.png: 100 x 100 pixels, coloured by surface variation\n")
    assert [line.split(":")[:3] for line in err.splitlines() if " note:" in line] == 2 * [
        ["gppcs", " note", " more.npy"]
    ]


def test_a_file_with_triangles_is_drawn_as_a_mesh(printed, folder):
    gppcs.write_mesh("tent.ply", gppcs.Mesh([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1, 1, 1]],
                                            [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]))  # fmt: skip
    assert printed("render", "tent.ply", "-o", "tent.png", "--size", "120x90") == "tent.png: 120 x 90 pixels\n"
    assert (image("tent.png").min(axis=2) < 0.98).mean() > 0.2
    Path("tent.ply.gz").write_bytes(gzip.compress(Path("tent.ply").read_bytes()))
    printed("render", "tent.ply.gz", "-o", "again.png", "--size", "120x90")
    assert Path("again.png").read_bytes() == Path("tent.png").read_bytes()


BALL = gppcs.sample("sphere", 3000)


def test_a_result_is_drawn_beside_its_original_with_the_surface_through_it(printed, folder):
    gppcs.write("ball.ply", BALL)
    gppcs.write("small.ply", gppcs.simplify(BALL, n_points=100, method="fps").cloud)
    assert printed("render", "ball.ply", "small.ply", "-o", "a.png") == "a.png: 3,000 points beside 100 points\n"
    pair = image("a.png")
    panels = np.split(pair[96:-96, : pair.shape[1] // 3 * 3].min(axis=2) < 0.97, 3, axis=1)
    closed = [panel.mean() for panel in panels]
    assert closed[2] == pytest.approx(closed[0], rel=0.1)  # as many pixels as the original
    printed("render", "ball.ply", "small.ply", "-o", "b.png", "--colour", "variation")
    assert np.abs(image("b.png")[: len(pair)] - pair).max() > 0.1


@pytest.mark.slow
def test_a_mesh_stands_beside_a_cloud(printed, folder):
    mesh = gppcs.mesh(BALL, n_points=100)
    gppcs.write("ball.ply", BALL)
    gppcs.write_mesh("mesh.ply", mesh.mesh)
    counts = f"100 vertices, {len(mesh.mesh.faces)} triangles"
    assert printed("render", "ball.ply", "mesh.ply", "-o", "a.png") == f"a.png: 3,000 points beside {counts}\n"
    assert printed("render", "mesh.ply", "ball.ply", "-o", "b.png") == f"b.png: {counts} beside 3,000 points\n"
    drawn = [image(name).min(axis=2)[150:-150] < 0.97 for name in ("a.png", "b.png")]
    left, right = drawn[0][:, : drawn[0].shape[1] // 2], drawn[1][:, : drawn[1].shape[1] // 2]
    assert left.mean() == pytest.approx(right.mean(), rel=0.1)
