"""`gppcs evaluate`."""

import pytest

import gppcs
from command_line import SIMPLIFY, rows_of
from gppcs.evaluation.report import MeshReport
from meshes import hull_mesh


def test_evaluate_prints_each_figure_with_its_unit_and_json_holds_them_raw_and_relative(printed, record, scan):
    printed(*SIMPLIFY, 40)
    report = gppcs.evaluate(gppcs.read("scan.ply"), gppcs.read("out.ply"))
    out = printed("evaluate", "scan.ply", "out.ply")
    parts = ["of the diagonal)", "of the squared diagonal)", " degrees"]
    parts += [name.replace("_", " ") for name in gppcs.Report.definitions()]
    assert not [part for part in parts if part not in out]
    assert f"feature recall {100 * report.feature_recall:.4g} %" in rows_of(out)
    assert record("evaluate", "scan.ply", "out.ply") == {
        "original": "scan.ply", "simplified": "out.ply", "mesh": None,
        "figures": report.figures(), "relative": report.figures(relative=True),
    }  # fmt: skip


def test_evaluate_tells_the_order_if_the_second_cloud_has_more_points(gppcs_command, scan):
    gppcs.write("small.ply", scan[:60])
    code, _, err = gppcs_command("evaluate", "small.ply", "scan.ply", "--quiet")
    assert (code, err.count("\n")) == (0, 1)
    assert err.startswith("gppcs: note: ")


@pytest.mark.parametrize("with_surface", [False, True])
def test_evaluate_judges_a_mesh(printed, record, with_surface):
    pytest.importorskip("pymeshlab")
    ball = gppcs.sample("sphere", 3000)
    gppcs.write("scan.ply", ball)
    gppcs.write_mesh("surface.ply", hull_mesh(ball.points))
    gppcs.write_mesh("small.ply", gppcs.mesh(ball, n_points=100).mesh)
    options = ["--mesh", "surface.ply"] if with_surface else []
    out = printed("evaluate", "scan.ply", "--simplified-mesh", "small.ply", *options)
    assert all(name.replace("_", " ") in out for name in MeshReport.definitions())
    surface = gppcs.read_mesh("surface.ply") if with_surface else None
    report = gppcs.evaluate_mesh("scan.ply", gppcs.read_mesh("small.ply"), surface)
    assert record("evaluate", "scan.ply", "--simplified-mesh", "small.ply", *options) == {
        "original": "scan.ply", "simplified_mesh": "small.ply", "mesh": "surface.ply" if with_surface else None,
        "figures": report.figures(), "relative": report.figures(relative=True),
    }  # fmt: skip
