"""`gppcs evaluate`."""

from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import FAST, SIMPLIFY, rows_of, write_scan_with
from gppcs.evaluation.report import MeshReport, Rebuilt
from meshes import hull_mesh


def test_evaluate_prints_each_figure_with_its_unit(printed, scan):
    printed(*SIMPLIFY, 40)
    out = printed("evaluate", "scan.ply", "out.ply")
    parts = ["of the diagonal)", "of the squared diagonal)", " degrees"]
    parts += [name.replace("_", " ") for name in gppcs.Report.definitions()]
    assert not [part for part in parts if part not in out]
    recall = gppcs.evaluate(scan, gppcs.read("out.ply")).feature_recall
    assert f"feature recall {100 * recall:.4g} %" in rows_of(out)


def test_evaluate_json_holds_raw_and_relative_figures(printed, record, scan):
    printed(*SIMPLIFY, 40)
    report = gppcs.evaluate(gppcs.read("scan.ply"), gppcs.read("out.ply"))
    assert record("evaluate", "scan.ply", "out.ply") == {
        "original": "scan.ply", "simplified": "out.ply", "mesh": None,
        "figures": report.figures(), "relative": report.figures(relative=True),
    }  # fmt: skip


def test_evaluate_leaves_out_points_that_are_not_finite(printed):
    def spoil(points):
        points[3, 1] = np.nan

    write_scan_with(spoil)
    assert {"points in 399", "points out 399"} <= set(rows_of(printed("evaluate", "scan.ply", "scan.ply")))


def test_evaluate_tells_the_order_if_the_second_cloud_has_more_points(gppcs_command, scan):
    gppcs.write("small.ply", scan[:60])
    code, _, err = gppcs_command("evaluate", "small.ply", "scan.ply", "--quiet")
    assert (code, err.count("\n")) == (0, 1)
    assert err.startswith("gppcs: note: ")


def test_a_note_tells_that_the_faces_of_a_simplified_cloud_do_not_count(gppcs_command, scan):
    gppcs.write_mesh("mesh.ply", hull_mesh(scan.points))
    _, _, told = gppcs_command("evaluate", "scan.ply", "mesh.ply", "-q")
    assert told.startswith("gppcs: note: mesh.ply: only its points are judged")
    assert gppcs_command("evaluate", "scan.ply", "scan.ply", "-q")[2] == ""
    Path("mesh.ply").rename("mesh")
    assert gppcs_command("evaluate", "scan.ply", "mesh", "-q")[2] == told.replace("mesh.ply", "mesh")


def test_the_help_of_evaluate_defines_every_figure(printed):
    out = " ".join(printed("evaluate", "--help").split())
    for report in (gppcs.Report, Rebuilt, MeshReport):
        assert all(f"{name.replace('_', ' ')} (" in out for name in report.definitions())


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


def test_the_unit_of_the_file_is_named(gppcs_command, folder):
    """In evaluate, in the table of simplify, and on the page."""
    import laspy
    from laspy.vlrs.known import WktCoordinateSystemVlr

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [1e-3] * 3
    header.vlrs.append(WktCoordinateSystemVlr('PROJCS["Oregon",UNIT["foot",0.3048]]'))
    scan = laspy.LasData(header)
    scan.x, scan.y, scan.z = gppcs.sample("bracket", 400).points.T
    scan.write("scan.las")
    options = ("--tolerance", "30ft", *FAST)
    _, table, _ = gppcs_command("simplify", "scan.las", "-o", "out.las", *options)
    assert " ft  (asked: 30ft)" in table
    gppcs_command("report", "scan.las", "out.las", "-o", "page.html")
    assert '"unit": "ft"' in Path("page.html").read_text()
    _, table, _ = gppcs_command("evaluate", "scan.las", "out.las")
    assert " ft  (" in table
