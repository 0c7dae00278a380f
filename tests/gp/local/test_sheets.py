"""Thin parts: normals of one's own sheet where another is near."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import gppcs
from gppcs.gp.local.settings import EDGE_ROUGHNESS
from gppcs.gp.local.sheets import normal_factor_of, sheets_of, toward_other_sheet
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area
from gppcs.surface.noise import Noise
from scans import sample
from shapes import plate

N, SPACING, FINE = 20_000, 0.05, 5.0  # target spacing of a plate of two unit squares, five times that of its points


@pytest.mark.parametrize("thickness", [0.5, 0.8])
def test_ways_lead_to_the_other_sheet(thickness):
    points, outward, area = plate(N, thickness * FINE)
    sheets = sheets_of(KdTree.build(points), points, SPACING)
    assert sheets is not None
    thin = sheets.any(axis=1)
    assert thin.mean() > 0.8
    ways = sheets[thin, :3] / (thickness * FINE * np.sqrt(area / N))
    inward = -(ways * outward[thin]).sum(axis=1)
    lengths = np.linalg.norm(ways, axis=1)
    assert np.mean(inward > 0.95 * lengths) > 0.97  # others are at the rim
    assert np.mean(abs(lengths - 1.0) < 0.05) > 0.8


@pytest.mark.parametrize("is_tube", [True, False])
def test_densities_of_two_sheets_go_as_the_roots_of_their_curvatures(is_tube):
    """Those of a tube, and of a plate of the same thickness, which are equal."""
    rng = np.random.default_rng(0)
    inner, outer = (1.2, 1.8) if is_tube else (1.0, 1.0)
    inside, turn, z = rng.random(N) < inner / (inner + outer), 2.0 * np.pi * rng.random(N), 20.0 * rng.random(N)
    radius = np.where(inside, inner, outer)
    tube, plate = (radius * np.cos(turn), radius * np.sin(turn), z), (0.6 * inside, 1.5 * turn, z)
    kept = np.isin(np.arange(N), gppcs.simplify(np.stack(tube if is_tube else plate, 1), n_points=700).indices)
    assert kept[inside].mean() / kept[~inside].mean() == pytest.approx(np.sqrt(outer / inner), abs=0.1)


@pytest.mark.parametrize(
    ("fraction", "is_round", "is_last", "factor"),
    [(0.0, False, True, 1.0), (0.5, True, True, 0.5), (0.5, False, False, 0.5), (0.1, False, True, 0.9 * 0.6)],
)
def test_normals_count_less_with_flat_walls_in_the_last_stage(fraction, is_round, is_last, factor):
    """The roughness of flat faces is 0, that of their edges `EDGE_ROUGHNESS`."""
    sheets, thin = np.zeros((200, 4)), round(200 * fraction)
    sheets[:thin, 2] = SPACING
    sheets[: thin if is_round else thin // 2, 3] = EDGE_ROUGHNESS
    assert normal_factor_of(sheets, is_last) == pytest.approx(factor)


def test_thick_and_round_shapes_have_no_thin_parts(sphere):
    for points in (plate(N, 1.5 * FINE)[0], sphere[:N]):
        assert sheets_of(KdTree.build(points), points, SPACING) is None


def test_a_point_without_neighbours_has_no_sheet():
    points = np.random.default_rng(0).random((11, 3))
    for cloud in (points, points[:1], np.repeat(points[:1], 40, axis=0)):
        tree = KdTree.build(cloud)
        assert sheets_of(tree, cloud, 1.0) is None
        assert not toward_other_sheet(tree, tree, 1.0).any()


@pytest.mark.parametrize(("name", "count"), [("case", 2_000), ("plate", 2_500), ("plate", 3_500)])
def test_sheets_are_no_noise_in_any_order_of_the_rows(name, count):
    """Within the target spacing are fewer points than a quadric needs to lie in the middle of both sheets."""
    points = sample(name, n_points=N).points
    for seed in range(3):
        tree = KdTree.build(np.random.default_rng(seed).permutation(points))
        assert not Noise.measure(tree, count, np.sqrt(surface_area(tree) / count)).thick


def test_beyond_memory_thin_parts_count(tmp_path, monkeypatch):
    gppcs.write(tmp_path / "fan.ply", gppcs.sample("fan", n_points=N))

    def chosen():
        with ThreadPoolExecutor(1) as executor:
            return gppcs.simplify(tmp_path / "fan.ply", n_points=1_000, workers=executor).indices

    aware = chosen()
    assert len(np.unique(aware)) == 1_000
    monkeypatch.setattr("gppcs.gp.local.sheets.THIN_FRACTION", 2.0)
    assert len(np.intersect1d(aware, chosen())) < 900


def test_beyond_memory_two_sheets_have_the_same_area(tmp_path):
    """Noise is measured in spacings, which are the root of the area for each point."""
    cloud = sample("plate", n_points=N)
    gppcs.write(tmp_path / "plate.ply", cloud)
    with ThreadPoolExecutor(1) as executor:
        beyond = gppcs.simplify(tmp_path / "plate.ply", n_points=2_000, workers=executor)
    within = gppcs.simplify(cloud, n_points=2_000)
    assert beyond.diagnostics["noise_in_spacings"] == pytest.approx(within.diagnostics["noise_in_spacings"], rel=0.1)
