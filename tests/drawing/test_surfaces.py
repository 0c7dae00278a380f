"""The surface through the kept points of a cloud."""

import numpy as np
import pytest

import gppcs
from gppcs.clouds.cloud import PointCloud
from gppcs.drawing.surfaces import MAX_DENSE, surface_of_few, surface_through
from gppcs.drawing.web.contents import Named, report_page
from gppcs.evaluation.reconstruction import distances_to
from scans import sample

CLOUD = gppcs.sample("medallion", n_points=30_000)


@pytest.mark.parametrize("offset", [0.0, 5e6])
def test_its_vertices_are_the_points(offset):
    kept = gppcs.simplify(CLOUD, n_points=1000)
    surface = surface_through(PointCloud(kept.points + offset), PointCloud(CLOUD.points + offset))
    vertices = {*map(tuple, surface.mesh.vertices[np.unique(surface.mesh.faces)])}
    points = {*map(tuple, kept.points + offset)}
    assert len(vertices & points) >= 0.99 * len(points)
    assert len(vertices - points) <= 0.01 * len(points)


def test_points_that_a_method_has_moved_are_its_vertices():
    moved = gppcs.simplify(CLOUD, n_points=500, method=gppcs.Voxel(keep="mean")).cloud.points
    surface = surface_through(PointCloud(moved), CLOUD)
    assert np.isin(moved, surface.mesh.vertices).all(axis=1).mean() > 0.9


def test_the_original_tells_how_the_points_are_joined():
    """Small letters are there: the surface is nearer to all points than the one that the kept points alone have."""
    kept = gppcs.simplify(CLOUD, n_points=1500).cloud
    joined, alone = surface_through(kept, CLOUD), surface_of_few(kept)
    errors = [distances_to(surface.mesh, CLOUD.points).mean() for surface in (joined, alone)]
    assert errors[0] < 0.8 * errors[1]


def test_wires_are_no_band():
    avenue = sample("avenue", n_points=40_000)
    kept = gppcs.simplify(avenue, n_points=2000)
    wires = kept.points[kept.cloud.attributes["classification"] == 14].tolist()
    surface = surface_through(kept.cloud, avenue)
    on_wire = np.array([vertex in wires for vertex in surface.mesh.vertices.tolist()])
    assert on_wire[surface.mesh.faces].all(axis=1).sum() < 0.5 * len(wires)


def test_points_on_no_surface_and_those_of_dense_clouds_have_none():
    rng = np.random.default_rng(0)
    assert surface_through(PointCloud(rng.random((3, 3)))) is None
    assert surface_through(PointCloud(np.linspace(0, 1, 100)[:, None] * [1.0, 2.0, 3.0])) is None
    assert surface_through(PointCloud(rng.random((10, 3))), PointCloud(np.zeros((MAX_DENSE + 1, 3)))) is None
    assert surface_of_few(CLOUD) is None
    repeated = np.repeat(CLOUD.points[:3000], 2, axis=0)
    assert len(surface_through(PointCloud(repeated)).mesh.vertices) >= 2700


@pytest.mark.parametrize("noise", [0.0, 2e-3])
def test_noise_is_that_of_the_points_in_edges_and_pages_of_much_open_with_points(noise):
    scan = gppcs.sample("sphere", n_points=50_000, noise=noise)
    kept = gppcs.simplify(scan, n_points=2500).cloud
    surface = surface_through(kept, scan)
    corners = surface.mesh.vertices[surface.mesh.faces]
    edge = np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2))
    diagonal = np.linalg.norm(np.ptp(scan.points, axis=0))
    assert surface.noise == pytest.approx(noise * diagonal / edge, rel=0.25)
    page = report_page(Named("scan", scan), [Named("kept", kept)], []).described
    assert page["solid"] == (surface.noise <= 0.15) == (not page["notes"])
    assert page["clouds"][1]["mesh"]
