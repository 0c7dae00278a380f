"""The pages hold the clouds, their attributes and their figures."""

import io
from itertools import pairwise

import numpy as np
import pytest

import gppcs
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.drawing.camera import Viewpoint
from gppcs.drawing.web import layers
from gppcs.drawing.web.contents import Named, report_page, view_page
from gppcs.errors import InputError
from web_page import WebPage

N, M = 3000, 300


def written(page):
    file = io.BytesIO()
    file.write(page.content())
    return WebPage(file.getvalue().decode())


def view_of(cloud, mesh=None, name="scan.ply", made=()):
    """Return the page of one cloud, and its description."""
    page = written(view_page([Named(name, cloud, mesh)], made))
    return page, page.described["clouds"][0]


def rows_in(page, cloud, block):
    return page.array(cloud["blocks"][block], cloud["shown"], 1, np.uint32)[:, 0]


@pytest.fixture(scope="module")
def scan():
    cloud = gppcs.sample("medallion", n_points=N)
    kinds = (np.arange(N) % 3).astype(np.uint8)
    depth = np.linspace(-2.0, 5.0, N, dtype=np.float32)
    depth[7] = np.nan
    return PointCloud(cloud.points, {**cloud.attributes, "kind": kinds, "depth": depth, "name": np.full(N, "point")})


@pytest.fixture(scope="module")
def results(scan):
    return [gppcs.simplify(scan, n_points=M, method=method).cloud for method in ("fps", "voxel")]


@pytest.fixture(scope="module")
def report(scan, results):
    named = [Named(name, cloud) for name, cloud in zip(("fps.ply", "voxel.ply"), results, strict=True)]
    return written(report_page(Named("scan.ply", scan), named, []))


def test_the_points_are_those_of_the_clouds_to_the_quantisation(report, scan, results):
    clouds = report.described["clouds"]
    assert [cloud["role"] for cloud in clouds] == ["original", "result", "result"]
    for described, cloud in zip(clouds, [scan, *results], strict=True):
        assert described["points"] == described["shown"] == len(cloud)
        half = 0.5001 * np.array(described["step"])
        assert (np.abs(report.points(described) - cloud.points) <= half).all()
        assert (half <= np.ptp(cloud.points, axis=0) / 131_000).all()


def test_errors_of_attributes_are_those_of_evaluate(scan, results):
    page = written(report_page(Named("scan.ply", scan), [Named("fps.ply", results[0])], [], detail=["depth", "kind"]))
    original, result = page.described["clouds"]
    assert page.described["unit"] == ""  # not that of the errors of attributes
    figures = gppcs.evaluate(scan, results[0], detail=["depth", "kind"]).figures()
    assert {name: result["prefixes"][-1]["figures"][name] for name in figures} == figures
    assert {"depth_error_mean", "kind_nearest_error_p95"} <= {each["name"] for each in page.described["figures"]}
    for name in ("depth", "kind"):
        errors, half = page.values(original, f"error:{name}:1")
        assert errors.mean() == pytest.approx(figures[f"{name}_error_mean"], abs=2 * half)


def test_attributes_and_colours_are_held(report, scan):
    (original, *_) = report.described["clouds"]
    kinds, half = report.values(original, "attribute:kind")
    assert half == 0
    assert (kinds == scan.attributes["kind"]).all()
    depth, half = report.values(original, "attribute:depth")
    assert 0 < half < 1e-4
    np.testing.assert_allclose(depth, scan.attributes["depth"], atol=1.01 * half)
    colours = report.array(original["blocks"]["colours"], N, 3, np.uint8)
    assert (colours == np.stack([scan.attributes[name] for name in ("red", "green", "blue")], axis=1)).all()
    assert not {"name", "nx", "red"} & {values["title"] for values in original["values"]}


def test_surface_variation_of_a_result_is_that_of_the_original(report, scan, results):
    original, first, _ = report.described["clouds"]
    variation, _ = report.values(original, "variation")
    kept, half = report.values(first, "variation")
    rows = rows_in(report, first, "originals")
    assert (scan.points[rows] == results[0].points).all()
    np.testing.assert_allclose(kept, variation[rows], atol=2 * half + 1e-5)
    features = gppcs.estimate_features(scan)
    near = features.neighbours >= 8
    np.testing.assert_allclose(variation[near], features.surface_variation[near], atol=1e-5)


def test_distances_and_figures_are_those_of_evaluate(report, scan, results):
    original, *simplified = report.described["clouds"]
    for number, (described, result) in enumerate(zip(simplified, results, strict=True), start=1):
        distances, half = report.values(original, f"distance:{number}")
        prefixes = described["prefixes"]
        assert [prefix["points"] for prefix in prefixes] == [M // 8, M // 4, M // 2, M]
        for prefix in prefixes[-2:]:
            figures = gppcs.evaluate(scan, result.points[: prefix["points"]]).figures()
            assert prefix["figures"] == figures
        assert distances.mean() == pytest.approx(figures["surface_mean"], rel=1e-3)
        assert distances.max() == pytest.approx(figures["surface_max"], abs=2 * half)
    errors = [prefix["figures"]["surface_mean"] for prefix in simplified[0]["prefixes"]]
    assert all(more > less for more, less in pairwise(errors))


def test_invalid_points_are_left_out_and_rows_stay_those_of_the_file(scan):
    points = scan.points.copy()
    points[[3, 50]] = np.nan
    made = [("command", "gppcs report")]
    moved = Named("b", PointCloud(scan.points[:100] + 1e-3))
    page = written(report_page(Named("scan.ply", PointCloud(points)), [moved], made, Viewpoint("-y", (30, 20))))
    described = page.described
    cloud, other = described["clouds"]
    assert (cloud["points"], cloud["shown"]) == (N, N - 2)
    assert rows_in(page, cloud, "rows").tolist() == np.delete(np.arange(N), [3, 50]).tolist()
    assert (rows_in(page, other, "originals") == 2**32 - 1).all()
    assert described["notes"] == ["scan.ply: 2 points with NaN or infinite coordinates are left out."]
    assert (described["up"], described["azimuth"], described["elevation"]) == ("-y", 30, 20)
    assert described["made"] == [["command", "gppcs report"]]


def test_large_clouds_are_thinned_by_gp_and_large_meshes_left_out_and_the_page_says_so(scan, monkeypatch):
    monkeypatch.setattr(layers, "MOST_SHOWN", 500)
    monkeypatch.setattr(layers, "MOST_TRIANGLES", 1)
    page, cloud = view_of(scan, Mesh(np.eye(3), [[0, 1, 2], [0, 2, 1]]))
    expected = np.sort(gppcs.simplify(scan, n_points=500).indices)
    assert rows_in(page, cloud, "rows").tolist() == expected.tolist()
    assert cloud["mesh"] is None
    for note in ("500 of 3,000 points are drawn, chosen by the method gp", "its mesh of 2 triangles is left out"):
        assert any(said.startswith(f"scan.ply: {note}") for said in page.described["notes"])


def test_a_mesh_comes_back_without_vertices_that_no_triangle_uses(scan):
    corners = np.array([[5, 5, 9], [0, 0, 0], [4, 0, 1], [0, 3, 2], [99, 0, 0]], dtype=float)
    page, cloud = view_of(scan, Mesh(corners, [[3, 1, 2], [0, 2, 1]]))
    assert (cloud["mesh"]["vertices"], cloud["mesh"]["triangles"]) == (4, 2)
    np.testing.assert_allclose(page.triangles(cloud["mesh"]), corners[[[0, 2, 1], [1, 2, 3]]], atol=1e-4)


def test_a_mesh_and_points_kept_of_it_are_shown_as_surfaces_without_its_stray_vertices(scan):
    mesh = gppcs.mesh(scan, n_points=1500).mesh
    vertices = np.vstack([mesh.vertices, [[0.0, 0.0, 0.5]]])
    original = Named("dense.ply", PointCloud(vertices), Mesh(vertices, mesh.faces), is_mesh=True)
    kept = gppcs.simplify(mesh.vertices, n_points=M).cloud
    shown = [cloud["mesh"] for cloud in report_page(original, [Named("kept.ply", kept)], []).described["clouds"]]
    assert all(shown)
    assert (shown[0]["vertices"], shown[0]["missed"]) == (1500, 0)


@pytest.mark.parametrize("points", [np.empty((0, 3)), np.full((5, 3), np.nan)])
def test_a_cloud_without_points_is_refused_by_name(points):
    with pytest.raises(InputError, match=r"empty\.ply: expected points with finite coordinates"):
        view_of(PointCloud(points), name="empty.ply")


@pytest.mark.parametrize("points", [[[1.0, 2.0, 3.0]], [[1.0, 2.0, 3.0]] * 9, [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]])
def test_clouds_of_few_points_can_be_shown(points):
    page, cloud = view_of(PointCloud(np.array(points)))
    np.testing.assert_allclose(page.points(cloud), points, atol=2 / 65535)
    assert cloud["spacing"] >= 0
    assert np.isnan(page.values(cloud, "variation")[0]).all()  # too few neighbours to measure it


def test_markup_in_names_stays_text(scan):
    name = "</script><script>alert(1)</script><!--"
    page, cloud = view_of(PointCloud(scan.points, {name: scan.attributes["kind"]}), None, name, [("x", name)])
    assert "alert(1)</script>" not in page.text
    assert cloud["name"] == name
    assert page.described["made"] == [["x", name]]
