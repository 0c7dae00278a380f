"""`gppcs mesh`."""

import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import rows_of


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


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".glb"])
def test_a_mesh_is_written_with_its_vertices(gppcs_command, ball, suffix):
    expected = gppcs.mesh(ball, n_points=100)
    lost = "" if suffix == ".ply" else f"gppcs: note: small{suffix}: does not hold: attribute curvature (float32)\n"
    command = ("mesh", "ball.ply", "-o", f"small{suffix}", "--points", 100, "-q")
    assert gppcs_command(*command, *["--lossy"] * (suffix in (".obj", ".off"))) == (0, "", lost)
    gppcs.write_mesh(f"expected{suffix}", expected.mesh, expected.cloud, lossy=True)
    assert Path(f"small{suffix}").read_bytes() == Path(f"expected{suffix}").read_bytes()


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        (["--faces", "0.2k"], {"n_faces": 200}),
        (["--tolerance", "1.5:mean"], {"tolerance": "1.5:mean"}),
        (["--points", "80", "--moved"], {"n_points": 80, "moved": True}),
        (["--points", "80", "--fill-holes", "30"], {"n_points": 80, "fill_holes": 30}),
    ],
)
def test_options_are_arguments_of_the_function(record, ball, options, arguments):
    told, expected = record("mesh", "ball.ply", "-o", "small.ply", *options), gppcs.mesh(ball, **arguments)
    counts = (told["points_in"], told["vertices"], told["triangles"])
    assert counts == (3000, len(expected.mesh.vertices), len(expected.mesh.faces))
    assert told["diagnostics"] == pytest.approx(
        {name: value for name, value in asdict(expected.diagnostics).items() if value is not None}
    )
    assert gppcs.read("small.ply").points == pytest.approx(expected.mesh.vertices, rel=1e-6)


@pytest.mark.parametrize(("n_points", "is_noted"), [(6, True), (300, False)])
def test_a_mesh_that_lacks_a_part_of_the_area_is_never_silent(gppcs_command, ball, n_points, is_noted):
    _, _, err = gppcs_command("mesh", "ball.ply", "-o", "small.ply", "--points", n_points, "-q")
    assert ("of the area of the cloud" in err) == is_noted
    assert (gppcs.mesh(ball, n_points=n_points).diagnostics.area_ratio < 0.9) == is_noted


def test_vertices_leave_noisy_points_unless_they_must_not_and_a_note_tells(gppcs_command):
    cloud = gppcs.sample("sphere", n_points=10_000, noise=0.0075)
    gppcs.write("noisy.ply", cloud)
    for options, is_moved, is_noted in (((), True, True), (("--moved",), True, False), (("--no-moved",), False, True)):
        err = gppcs_command("mesh", "noisy.ply", "-o", "out.ply", "--force", "--points", 500, *options)[2]
        assert ("noise" in err) == is_noted
        vertices = gppcs.read("out.ply").points
        assert np.isin(vertices, cloud.points.astype(np.float32)).all() != is_moved


def test_the_run_is_printed_as_a_table(printed, ball):
    title, *rows = rows_of(printed("mesh", "ball.ply", "-o", "small.ply", "--points", 100, "--unit", "mm"))
    assert title == "ball.ply → small.ply"
    assert rows[:3] == ["points in 3,000", "vertices 100", "triangles 196"]
    assert {"pieces 1", "unit mm"} <= set(rows)
    assert any(re.fullmatch(r"time \d+\.\d\d s.*", row) for row in rows)


def test_the_fraction_of_points_on_no_surface_is_a_percentage(gppcs_command):
    ball, speck = (gppcs.sample("sphere", n).points for n in (3000, 12))
    gppcs.write("two.npy", np.vstack([ball, 0.05 * speck + 9]))
    out = gppcs_command("mesh", "two.npy", "-o", "small.ply", "--points", 100)[1]
    assert any(re.fullmatch(r"points not covered by the mesh [\d.]+ %", row) for row in rows_of(out)), out


def test_points_that_a_method_has_chosen_become_the_vertices(gppcs_command, printed, ball):
    gppcs_command("simplify", "ball.ply", "-o", "kept.ply", "--points", 150, "--method", "fps")
    printed("mesh", "ball.ply", "-o", "small.ply", "--keep-points", "kept.ply")
    kept, made = gppcs.read("kept.ply").points, gppcs.read("small.ply").points
    assert np.array_equal(kept[np.lexsort(kept.T)], made[np.lexsort(made.T)])


def test_a_cloud_without_attributes_becomes_a_mesh_of_any_format(gppcs_command, ball):
    """The normals that are estimated to make the mesh are none of the cloud's."""
    gppcs.write("plain.npy", ball.points)
    assert gppcs_command("mesh", "plain.npy", "-o", "small.stl", "--points", 100, "-q") == (0, "", "")
