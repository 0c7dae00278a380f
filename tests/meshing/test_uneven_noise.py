"""Noise that differs from place to place, as that of depth cameras."""

import numpy as np
import pytest

import gppcs
from gppcs.clouds.topology import topology_of
from gppcs.meshing.uneven_noise import projected_across, uneven_noise
from gppcs.spatial.kdtree import KdTree
from scans import sample

SIGMA = 0.004  # standard deviation of the noise at the far end of the wall


def wall(n, seed=0, steps=True):
    """Points of a wall, z = 0, whose noise grows as that of a depth camera, and its standard deviation at each point.

    With steps, heights above a slanted plane are rounded to multiples of two standard deviations.
    """
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 1, (2, n))
    sigma = SIGMA * (0.3 + 0.7 * y) ** 2
    z = sigma * rng.standard_normal(n)
    if steps:
        z = 2 * sigma * np.round((z + 0.3 * x) / (2 * sigma)) - 0.3 * x
    return np.column_stack([x, y, z]), sigma


def test_noise_is_measured_at_each_place():
    points, sigma = wall(50_000, steps=False)
    tree = KdTree.build(points)
    ratio = uneven_noise(tree)[0] / sigma[tree.order]
    assert np.median(ratio) == pytest.approx(1, abs=0.1)
    assert np.quantile(ratio, 0.1) > 0.6
    assert np.quantile(ratio, 0.9) < 1.6


def test_projections_lie_on_the_surface_and_their_normals_across_it():
    points, sigma = wall(50_000)
    tree = KdTree.build(points)
    feet, normals, _ = projected_across(tree, uneven_noise(tree)[1])
    inner = (np.abs(feet[:, :2] - 0.5) < 0.45).all(axis=1)
    assert np.median(np.abs(feet[inner, 2]) / sigma[tree.order][inner]) < 0.5
    assert np.quantile(np.abs(normals[inner, 2]), 0.1) > 0.98


def test_no_noise_and_noise_of_the_same_thickness_everywhere_are_not_uneven():
    rng = np.random.default_rng(0)
    even = np.column_stack([rng.uniform(0, 1, (50_000, 2)), 0.003 * rng.standard_normal(50_000)])
    for points in (even, *(sample(name, n_points=50_000).points for name in ("bracket", "statue"))):
        assert uneven_noise(KdTree.build(points)) is None


@pytest.mark.parametrize("n", [40_000, pytest.param(80_000, marks=pytest.mark.slow)])
def test_a_wall_of_steps_is_one_piece_however_many_points_there_are(n):
    topology = topology_of(gppcs.mesh(wall(n)[0], n_points=2500).mesh.faces)
    assert (topology.pieces, topology.boundary_loops, topology.genus) == (1, 1, 0)


@pytest.mark.slow
def test_a_slot_about_as_narrow_as_joined_points_are_apart_has_no_ragged_bridges():
    points = wall(160_000)[0]
    points = points[(np.abs(points[:, 0] - 0.5) > 0.008) | (points[:, 1] < 0.2)]
    topology = topology_of(gppcs.mesh(points, n_points=2500).mesh.faces)
    assert (topology.pieces, topology.boundary_loops, topology.genus) == (1, 1, 0)


def test_noise_of_a_scan_is_about_the_same_however_many_of_its_points_there_are(shared_data):
    points = gppcs.read(shared_data / "nyu_basement.ply").points
    levels = [np.sqrt((uneven_noise(KdTree.build(points[::k]))[0] ** 2).mean()) for k in (4, 2, 1)]
    assert max(levels) < 1.4 * min(levels)


@pytest.mark.slow
@pytest.mark.parametrize("step", [4, 2, 1])
@pytest.mark.parametrize(("scan", "pieces"), [("nyu_basement", 5), ("redwood_livingroom_frame", 4), ("tum_desk", 10)])
def test_a_scan_has_few_pieces_however_many_of_its_points_there_are(shared_data, scan, pieces, step):
    points = gppcs.read(shared_data / f"{scan}.ply").points[::step]
    assert topology_of(gppcs.mesh(points, n_points=5_000, moved=True).mesh.faces).pieces <= pieces
