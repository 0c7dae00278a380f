"""Placement, against a plain version and by what it promises."""

import numpy as np
import pytest

import gppcs
from dense import distances_to_triangles
from gppcs.gp.local.candidates import Measured
from gppcs.gp.local.detail import Detail
from gppcs.gp.local.placement import place
from gppcs.gp.local.placement.cells import NEAR, cells_of
from gppcs.gp.local.placement.check import farther
from gppcs.gp.local.settings import (
    DETAIL_INTERPOLATED,
    DETAIL_NEAREST,
    DETAIL_TRIED_ON,
    GAP_GROWTH,
    MAX_STEP,
    PULL,
    TRIALS,
)
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_of_each, nearest_others
from gppcs.spatial.samples import short_hashes
from gppcs.surface.local_surface import LocalSurface
from gppcs.surface.noise import Noise
from shapes import noisy, on_sphere

QUIET = Noise(None, 12, False, 0.0, True, True, 1.0)


def sphere_cap(n=4_000, seed=0):
    """A cap of the unit sphere."""
    points = on_sphere(4 * n, seed)
    return points[points[:, 2] > 0.5][:n]


def mean_distance(points, places):
    return LocalSurface.from_points(places).nearest_to(points)[0].mean()


def placed(points, chosen, fixed=0, noise=QUIET, passes=2, detail=None):
    return place(points, chosen, fixed, Measured(2 * np.pi * 0.5, noise, short_hashes(points, 16), detail), passes)


def test_with_attributes_each_place_goes_to_the_point_of_its_cell_with_the_least_sum_of_equation_20():
    """One pass, in NumPy, on cells all of whose points are judged, before the check."""
    points = sphere_cap()
    values = (points[:, :1] * 3.0 % 1.0 < 0.5).astype(np.float32)
    chosen = np.random.default_rng(1).choice(len(points), 800, replace=False)
    detail, surface = Detail(values, np.zeros(len(points), np.float32)), LocalSurface.from_points(points[chosen])
    found = placed(points, chosen, passes=1, detail=detail)
    nearest, squared = KdTree.build(points[chosen]).nearest_of(points, 1)
    gaps = np.sqrt(KdTree.build(points[chosen]).nearest_of(points[chosen], 4)[1])[:, 1:].mean(axis=1)
    agree = []
    for slot, v in list(enumerate(surface.tree.order))[::3]:
        cell, vertex = np.flatnonzero(nearest[:, 0] == v), chosen[v]
        if not 1 < len(cell) <= DETAIL_TRIED_ON or found[v] == vertex:  # the check sends points back
            continue
        fan = chosen[surface.tree.order[surface.corners[slot][surface.corners[slot][:, 0] >= 0]]]
        spread, middle = points[cell].mean(axis=0), values[cell].mean()

        def equation_20(x, cell=cell, fan=fan, gap=gaps[v], spread=spread, middle=middle):
            planes = (((points[cell] - points[x]) * points[cell]).sum(axis=1) ** 2).mean()
            squared = planes + PULL * ((points[x] - spread) ** 2).sum() + (gap * (values[x, 0] - middle)) ** 2
            corners = np.concatenate([np.full((len(fan), 1), x), fan], axis=1)
            distances, interpolated = nearest_values(points[cell], points[corners], values[corners, 0])
            around = np.unique(corners)
            owner = around[((points[cell][:, None] - points[around]) ** 2).sum(axis=2).argmin(axis=1)]
            errors = DETAIL_INTERPOLATED * np.abs(interpolated - values[cell, 0])
            errors += DETAIL_NEAREST * np.abs(values[owner, 0] - values[cell, 0])
            return np.sqrt(squared) + (distances + gap * errors).mean()

        near = ((points[cell] - points[vertex]) ** 2).sum(axis=1) <= (MAX_STEP * gaps[v]) ** 2
        farthest = ((points[cell][:, None] - points[cell]) ** 2).sum(axis=2).max(axis=0)
        may = cell[near & (farthest <= GAP_GROWTH**2 * squared.max())]
        agree.append(found[v] == min(may, key=equation_20))
    assert len(agree) > 100
    assert np.mean(agree) > 0.9  # normals of the planes are not quite those of the sphere


def nearest_values(points, triangles, values):
    """The distances of points, (n, 3), from triangles, (t, 3, 3), and values, (t, 3), interpolated at the feet."""
    steps = np.linspace(0.0, 1.0, 41)
    second, third = (grid.ravel() for grid in np.meshgrid(steps, steps))
    weights = np.stack([1.0 - second - third, second, third], axis=1)[second + third <= 1.0 + 1e-9]
    on_triangles, value = (weights @ triangles).reshape(-1, 3), (weights @ values[..., None]).ravel()
    squared = ((points[:, None] - on_triangles) ** 2).sum(axis=2)
    return np.sqrt(squared.min(axis=1)), value[squared.argmin(axis=1)]


@pytest.mark.parametrize("seed", range(3))
def test_the_surface_comes_nearer_and_gaps_hardly_grow(seed):
    points = sphere_cap(seed=seed)
    chosen = np.random.default_rng(seed).choice(len(points), 150, replace=False)
    found = placed(points, chosen)
    assert len(np.unique(found)) == len(found)
    assert mean_distance(points, points[found]) < 0.9 * mean_distance(points, points[chosen])
    before, after = (np.sqrt(KdTree.build(points[rows]).nearest_of(points, 1)[1].max()) for rows in (chosen, found))
    assert after <= GAP_GROWTH * before * (1 + 1e-12)


def surface_in_order(points):
    """The local surface of points, (m, 3), in this order."""
    return LocalSurface.over(KdTree.over(points.T))


def went_back(before, after, cells, moved, points, allowed):
    """The points that the check finds farther from the surface after the exchanges than before."""
    near, _ = nearest_others(before.tree, NEAR)
    return farther(before, after, near, cells, moved, np.ascontiguousarray(points.T), allowed)


def test_the_check_compares_the_distances_of_each_cell_from_both_surfaces():
    points = sphere_cap() * [1.0, 1.0, 0.5]
    rng = np.random.default_rng(4)
    vertices = points[rng.choice(len(points), 300, replace=False)]
    before = LocalSurface.over(KdTree.build(vertices).in_own_order())
    vertices = before.tree.points.T
    owners = before.tree.nearest_of(points, 1)[0][:, 0].astype(np.int32)
    moved = rng.random(300) < 0.7
    partner = np.array([rng.choice(np.append(np.flatnonzero(owners == v), 0)) for v in range(300)])
    after = surface_in_order(np.where(moved[:, None], points[partner], vertices))
    sums = [np.bincount(owners, surface.nearest_to(points)[0], 300) for surface in (before, after)]
    cells, counts = cells_of(owners, 300), np.bincount(owners, minlength=300)
    found, allowed = np.zeros(300, dtype=bool), np.median((sums[1] - sums[0]) / np.maximum(counts, 1))
    found[went_back(before, after, cells, moved, points, np.zeros(300))] = True
    assert not found[~moved].any()
    assert 0.2 < found[moved].mean() < 1.0
    assert (found == (sums[1] > sums[0]))[moved].mean() > 0.97  # the nearest fans are searched near the vertex only
    beyond_allowed = np.zeros(300, dtype=bool)
    beyond_allowed[went_back(before, after, cells, moved, points, np.full(300, allowed))] = True
    assert (beyond_allowed == (sums[1] > sums[0] + counts * allowed))[moved].mean() > 0.97


def test_fewer_points_go_back_beside_a_parallel_sheet():
    rng = np.random.default_rng(8)
    one, two = (rng.random((2_000, 3)) * [1.0, 1.0, 0.0] + [0.0, 0.0, z] for z in (0.0, 0.04))
    fractions = []
    for points in (np.concatenate([one, two]), one):
        before, n = LocalSurface.over(KdTree.build(points[::20]).in_own_order()), len(points) // 20
        after = surface_in_order(before.tree.points.T + 0.004 * rng.standard_normal((n, 3)))
        owners = before.tree.nearest_of(points, 1)[0][:, 0].astype(np.int32)
        back = went_back(before, after, cells_of(owners, n), np.ones(n, dtype=bool), points, np.zeros(n))
        fractions.append(len(back) / n)
    assert fractions[0] < 0.5  # planes of some reach across
    assert fractions[1] > 0.8


def test_points_to_keep_stay():
    points = sphere_cap()
    chosen = np.random.default_rng(2).choice(len(points), 150, replace=False)
    np.testing.assert_array_equal(placed(points, chosen, fixed=60)[:60], chosen[:60])
    kept = np.arange(0, 4_000, 100)
    assert set(gppcs.simplify(points, n_points=100, keep=kept).indices[:40]) == set(kept)


def test_points_on_dense_curves_stay():
    """Their planes are those of the curves, not of the cylinder."""
    angle, height = np.meshgrid(np.linspace(0, 2 * np.pi, 400, endpoint=False), np.linspace(0, 4, 20))
    points = np.stack([np.cos(angle), np.sin(angle), height], axis=-1).reshape(-1, 3)
    chosen = np.arange(0, len(points), 13)
    np.testing.assert_array_equal(placed(points, chosen), chosen)


def test_no_point_goes_through_a_thin_wall():
    """Cells reach about as far as the wall is thick, so most points stay where they are."""
    flat = np.random.default_rng(7).random((6_000, 3)) * [1.0, 1.0, 0.0]
    points = flat + np.where(np.arange(6_000)[:, None] % 2, 0.05, 0.0) * [0.0, 0.0, 1.0]
    chosen = np.arange(0, 6_000, 41)
    found = placed(points, chosen)
    np.testing.assert_array_equal(points[found, 2], points[chosen, 2])
    assert (found == chosen).mean() > 0.7


def test_noise_is_placed_by_the_feet():
    """Places come nearer to the clean surface, which points off it cannot tell."""
    points = sphere_cap(12_000)
    scan = noisy(points, 0.02, seed=5)
    tree = KdTree.build(scan)
    noise = Noise.measure(tree, 300, np.sqrt(np.pi / 300))
    assert not noise.is_negligible
    chosen = np.random.default_rng(6).choice(len(points), 300, replace=False)
    with_feet, without = placed(scan, chosen, noise=noise), placed(scan, chosen)
    assert mean_distance(points, scan[with_feet]) < 0.9 * mean_distance(points, scan[without])


@pytest.mark.parametrize(("queries", "points"), [(1, 1), (5, 3), (20_000, 700), (700, 5_000), (3_000, 1)])
def test_the_nearest_point_of_each_query_is_that_of_brute_force(queries, points):
    rng = np.random.default_rng(queries)
    tree, asked = KdTree.build(rng.random((points, 3)) ** 3), KdTree.build(rng.random((queries, 3)))
    positions, squared = nearest_of_each(tree, asked)
    some = slice(None, None, -(-queries // 500))
    expected = ((asked.points.T[some, None] - tree.points.T[None]) ** 2).sum(axis=2)
    np.testing.assert_allclose(squared[some], expected.min(axis=1), rtol=1e-12)
    np.testing.assert_allclose(expected[np.arange(len(expected)), positions[some]], expected.min(axis=1), rtol=1e-12)


def off_fan(points, apex, corners):
    """The summed distance of points, (n, 3), from the triangles between an apex and other corners, (t, 2, 3)."""
    triangles = np.concatenate([np.broadcast_to(apex, (len(corners), 1, 3)), corners], axis=1)
    return distances_to_triangles(points, triangles).sum()


def test_each_place_goes_to_a_point_of_its_cell_with_a_small_error_whose_triangles_are_the_nearest():
    """One pass, in NumPy, on cells all of whose points are judged."""
    points = sphere_cap()
    chosen = np.random.default_rng(1).choice(len(points), 800, replace=False)
    found, surface = placed(points, chosen, passes=1), LocalSurface.from_points(points[chosen])
    nearest, squared = KdTree.build(points[chosen]).nearest_of(points, 1)
    gaps = np.sqrt(KdTree.build(points[chosen]).nearest_of(points[chosen], 4)[1])[:, 1:].mean(axis=1)
    normals = points  # of the sphere
    agree = []
    for slot, v in enumerate(surface.tree.order):
        cell = np.flatnonzero(nearest[:, 0] == v)
        assert found[v] in cell
        if not 1 < len(cell) <= 10:
            continue
        fan = surface.tree.order[surface.corners[slot][surface.corners[slot][:, 0] >= 0]]
        steps = points[cell][:, None] - points[cell]
        errors = (np.einsum("ijk,ik->ij", steps, normals[cell]) ** 2).sum(axis=0)
        errors += PULL * len(cell) * ((points[cell] - points[cell].mean(axis=0)) ** 2).sum(axis=1)
        farthest = (steps**2).sum(axis=2).max(axis=0)
        near = ((points[cell] - points[chosen[v]]) ** 2).sum(axis=1) <= (MAX_STEP * gaps[v]) ** 2
        errors[~near | (farthest > GAP_GROWTH**2 * squared.max())] = np.inf
        better = [x for x in np.argsort(errors)[:TRIALS] if errors[x] < errors[cell == chosen[v]][0]]
        tried = [chosen[v], *cell[better]]
        agree.append(found[v] == min(tried, key=lambda x: off_fan(points[cell], points[x], points[chosen[fan]])))
    assert len(agree) > 500
    assert np.mean(agree) > 0.9  # normals of the planes are not quite those of the sphere
