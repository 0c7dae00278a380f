"""`gppcs mesh`."""

import re
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import rows_of
from shapes import torus


@pytest.fixture
def ball(folder):
    """The cloud in the file ball.ply."""
    cloud = gppcs.sample("sphere", 3000)
    gppcs.write("ball.ply", cloud)
    return gppcs.read("ball.ply")


@pytest.fixture(autouse=True, scope="session")
def compiled():
    """Compile the kernels of meshes, so that the command does not print the notice of a first run."""
    gppcs.mesh(gppcs.sample("sphere", 3000), n_points=100, effort=1)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off"])
def test_a_mesh_is_written_with_its_vertices(gppcs_command, ball, suffix):
    expected = gppcs.mesh(ball, n_points=100)
    lost = "" if suffix == ".ply" else f"gppcs: note: small{suffix}: left out: attribute curvature (float32)\n"
    command = ("mesh", "ball.ply", "-o", f"small{suffix}", "--points", 100, "-q")
    assert gppcs_command(*command, *["--lossy"] * bool(lost)) == (0, "", lost)
    gppcs.write_mesh(f"expected{suffix}", expected.mesh, expected.cloud, lossy=True)
    assert Path(f"small{suffix}").read_bytes() == Path(f"expected{suffix}").read_bytes()


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        (["--ratio", "5%"], {"ratio": 0.05}),
        (["--faces", "0.2k"], {"n_faces": 200}),
        (["--tolerance", "1.5"], {"tolerance": 1.5}),
        (["--tolerance", "1.5:mean"], {"tolerance": "1.5:mean"}),
        (["--points", "80", "--moved"], {"n_points": 80, "moved": True}),
        (["--points", "80", "--effort", "2"], {"n_points": 80, "effort": 2}),
        (["--points", "80", "--fill-holes", "30"], {"n_points": 80, "fill_holes": 30}),
    ],
)
def test_options_are_arguments_of_the_function(record, ball, options, arguments):
    told, expected = record("mesh", "ball.ply", "-o", "small.ply", *options), gppcs.mesh(ball, **arguments)
    counts = (told["points_in"], told["vertices"], told["triangles"])
    assert counts == (3000, len(expected.mesh.vertices), len(expected.mesh.faces))
    assert told["diagnostics"] == pytest.approx(dict(expected.diagnostics))
    assert gppcs.read("small.ply").points == pytest.approx(expected.mesh.vertices, rel=1e-6)


def test_a_note_tells_that_a_mesh_has_the_noise_of_its_points(gppcs_command):
    gppcs.write("noisy.ply", gppcs.sample("sphere", n_points=10_000, noise=0.0075))
    for options, told in (((), True), (("--moved",), False), (("--effort", 1), False)):
        err = gppcs_command("mesh", "noisy.ply", "-o", "out.ply", "--force", "--points", 500, *options)[2]
        assert ("the points have noise of about" in err) == told
    gppcs.write("clean.ply", gppcs.sample("sphere", n_points=10_000))
    assert gppcs_command("mesh", "clean.ply", "-o", "out.ply", "--force", "--points", 500)[2] == ""


def test_notes_tell_what_a_tolerance_leaves_out_and_whether_it_is_below_the_noise(gppcs_command):
    cloud = gppcs.sample("sphere", n_points=10_000, noise=0.0075)
    noise = gppcs.mesh(cloud, n_points=100).diagnostics["noise"]
    gppcs.write("noisy.ply", cloud[np.r_[:10_000, :10_000]])
    for share in (0.9, 1.1):
        told = gppcs_command("mesh", "noisy.ply", "-o", "out.ply", "--force", "-q", "--tolerance", share * noise)[2]
        found = re.fullmatch(
            r"gppcs: note: noisy.ply: outliers \(\d+\) and other places that noise moved or no triangle reaches "
            r"\(([\d,]+)\) may be farther than the tolerance[^\n]*\n"
            r"(?:gppcs: note: noisy.ply: the tolerance of ([\d.]+) is below the noise [^\n]*\n)?",
            told,
        )
        assert 2000 < int(found[1].replace(",", "")) < 4000
        assert (found[2] is not None) == (share < 1.0)


def test_the_run_is_printed_as_a_table(printed, ball):
    out = printed("mesh", "ball.ply", "-o", "small.ply", "--points", 100)
    title, *rows = rows_of(out)
    dense = round(gppcs.mesh(ball, n_points=100).diagnostics["dense_points"])
    assert title == "ball.ply → small.ply"
    assert rows[:4] == [
        "points 3,000",
        "mesh 100 vertices, 196 triangles",
        "shape closed, no holes; 1 piece; genus 0",
        f"dense points {dense:,}",
    ]
    assert not any("small holes" in row for row in rows)
    assert re.fullmatch(
        r".*mean distance of the points, noise aside, from the mesh .*time \d+\.\d\d s.*", " ".join(rows)
    )


@pytest.mark.parametrize("unit", [None, "mm"])
def test_lengths_are_printed_with_their_unit_and_as_shares_of_the_diagonal(printed, ball, unit):
    options = ["--unit", unit] if unit else []
    rows = rows_of(printed("mesh", "ball.ply", "-o", "small.ply", "--tolerance", "1%", *options))
    diagonal = np.linalg.norm(np.ptp(ball.points, axis=0))
    assert f"tolerance {0.01 * diagonal:.4g} {unit + ' ' if unit else ''}(1.000% of the diagonal)" in rows
    words = {"mean distance of the points, noise aside, from the mesh", "largest distance of the points that count",
             "largest distance of a vertex from the points' surface"}  # fmt: skip
    of_unit = f" {unit}" if unit else ""
    pattern = rf"(.*?) \d[\d.e-]*{of_unit} \([\d.]+% of the diagonal\)"
    assert words < {found[1] for row in rows if (found := re.fullmatch(pattern, row))}
    assert ("lengths in the unit of the coordinates, which the file does not tell" in rows) == (unit is None)


@pytest.mark.parametrize("size", [1e-170, 1e180])
def test_shares_of_the_diagonal_hold_for_coordinates_whose_squares_overflow(gppcs_command, ball, size):
    gppcs.write("ball.npy", gppcs.PointCloud(ball.points * size), force=True)
    _, out, err = gppcs_command("mesh", "ball.npy", "-o", "small.ply", "--tolerance", "1%")
    assert any(row.startswith("tolerance ") and "(1.000% of the diagonal)" in row for row in rows_of(out))
    assert "overflow" not in err


def test_holes_pieces_and_handles_are_told(gppcs_command, folder):
    points, _ = torus(8000)
    cap = gppcs.sample("sphere", 3000).points / 100
    gppcs.write("both.ply", gppcs.PointCloud(np.concatenate([points, cap[cap[:, 2] < 0] + 5])))
    _, out, _ = gppcs_command("mesh", "both.ply", "-o", "small.ply", "--points", 400)
    assert "shape open at 1 hole or rim; 2 pieces; genus 1" in rows_of(out)


def test_points_that_a_method_has_chosen_become_the_vertices(gppcs_command, printed, ball):
    gppcs_command("simplify", "ball.ply", "-o", "kept.ply", "--points", 150, "--method", "fps")
    printed("mesh", "ball.ply", "-o", "small.ply", "--keep-points", "kept.ply")
    kept, made = gppcs.read("kept.ply").points, gppcs.read("small.ply").points
    assert np.array_equal(kept[np.lexsort(kept.T)], made[np.lexsort(made.T)])


def test_fewer_points_than_asked_for_are_told(gppcs_command, ball):
    told = "gppcs: note: ball.ply: the mesh has 3,000 vertices, fewer than the 5,000 asked for\n"
    assert gppcs_command("mesh", "ball.ply", "-o", "small.ply", "--points", "5k")[::2] == (0, told)


def test_scraps_are_told(gppcs_command, folder):
    ball = gppcs.sample("sphere", 3000).points
    gppcs.write("two.ply", np.concatenate([ball, [300, 0, 0] + np.eye(3)[[0, 1, 2, 0]] * [[20], [20], [20], [40]]]))
    told = "gppcs: note: two.ply: 0.2% of the points are on no piece of the surface that is large enough\n"
    assert gppcs_command("mesh", "two.ply", "-o", "small.ply", "--points", 200)[::2] == (0, told)


def test_what_the_format_cannot_hold_is_refused_before_the_work(refused, ball, monkeypatch):
    monkeypatch.setattr("gppcs.meshing.pipeline.mesh", None)
    parts = ("small.obj: expected a format that holds all", "OBJ cannot hold: attribute curvature", "with lossy")
    refused(("mesh", "ball.ply", "-o", "small.obj", "--points", 100), *parts)


def test_a_cloud_without_attributes_becomes_a_mesh_of_any_format(gppcs_command, ball):
    """The normals that are estimated to make the mesh are none of the cloud's."""
    gppcs.write("plain.npy", ball.points)
    assert gppcs_command("mesh", "plain.npy", "-o", "small.stl", "--points", 100, "-q") == (0, "", "")
