import numpy as np
import pytest
from scipy.spatial import cKDTree

from gppcs.gp.local.candidates import gaps_of_isolated, nested_candidates
from gppcs.gp.local.settings import FIRST_STAGE, ISOLATION, MAX_CELLS, MIN_CANDIDATES
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area
from shapes import square


def finest_of(points, n_points):
    """Rows of the finest candidates, where all points are equally sharp."""
    alike = np.zeros(len(points), dtype=np.uint32)
    return nested_candidates(points, alike, n_points, surface_area(KdTree.build(points)), 8.0)[-1].indices


def test_scattered_outliers_are_no_candidates():
    """Only those near the plane are."""
    outliers = np.random.default_rng(1).uniform([0, 0, -0.5], [1, 1, 0.5], (400, 3))
    rows = finest_of(np.concatenate([square(40_000), outliers]), 1_000)
    assert 0 < (rows >= 40_000).sum() < 0.05 * 400
    assert (rows < 40_000).sum() > 7_500


def test_wires_and_sparse_parts_stay():
    """A wire, and ever sparser rows of points, as of a scanner that looks along the ground."""
    wire = np.column_stack([np.linspace(0, 1, 120), np.full(120, 0.5), np.full(120, 0.3)])
    gaps = np.repeat(0.01 * 1.1 ** np.arange(12), 30)
    rows = np.column_stack([np.tile(np.arange(30.0), 12) * gaps, 1 + 8 * gaps, np.zeros(360)])
    points = np.concatenate([square(40_000), wire, rows])
    kept = finest_of(points, 1_000)
    gaps = gaps_of_isolated(KdTree.build(points[kept] * np.sqrt(1_000)))
    assert (gaps > 0).sum() > 5
    for first, last in ((40_000, 40_120), (40_120, len(points))):
        others = points[kept[(kept >= first) & (kept < last)]]
        covered = np.linalg.norm(points[first:last, None] - others[None], axis=2).min(axis=1)
        assert (covered < np.sqrt(1.0 / 1_000)).all()


def sharpest_of_cells(points, edge, sharpness):
    order = np.lexsort([*points.T[::-1], -sharpness.astype(float)])
    return np.sort(order[np.unique(np.floor(points[order] * (1.0 / edge)), axis=0, return_index=True)[1]])


def plain_stages(points, sharpness, n_points, area, density):
    """Double and halve the area a step at a time, each time over all points."""
    stages = []
    target, candidates, grown = n_points, np.arange(len(points)), False
    while True:
        edge = np.sqrt(area / (target * density))
        kept = candidates[sharpest_of_cells(points[candidates], edge, sharpness[candidates])]
        if len(kept) > MAX_CELLS * density * target:
            area, grown = area * 2, True
        elif len(kept) < MIN_CANDIDATES * target and len(candidates) > MAX_CELLS * density * target and not grown:
            area /= 2
        else:
            thinned = len(kept) >= MIN_CANDIDATES * target
            candidates = kept if thinned else candidates
            stages.append((target, candidates, thinned, area))
            if target <= FIRST_STAGE:
                return stages[::-1]
            target, grown = -(-target // 2), False


@pytest.mark.parametrize("dot", [0, 9_500, 9_995])
@pytest.mark.parametrize("area", [1e-14, 12.0])
def test_stages_are_those_of_a_step_at_a_time_over_all_points(sphere, dot, area, monkeypatch):
    # Beside the dot, the sphere is sparse.
    monkeypatch.setattr("gppcs.gp.local.candidates.largest_gap", lambda *_: np.inf)
    rng = np.random.default_rng(0)
    points = sphere[:10_000] + 1
    points[:dot] = 0.5 + 1e-5 * sphere[10_000 : 10_000 + dot]
    points = rng.permutation(points)
    sharpness = rng.integers(0, 5, len(points)).astype(np.uint32)
    stages, plain = (way(points, sharpness, 300, area, 9.0) for way in (nested_candidates, plain_stages))
    for found, expected in zip(stages, plain, strict=True):
        np.testing.assert_array_equal(found.indices, expected[1])
        assert (found.target, found.thinned, found.area) == (expected[0], *expected[2:])


def test_gaps_are_the_distances_to_the_nearest_others(sphere):
    points = np.concatenate([sphere[:2_000], 3.0 * sphere[2_000:2_100]])
    nearest = cKDTree(points).query(points, 2)[0][:, 1]
    for spacing in (0.05, 0.2, 1.0):
        expected = np.where(nearest > ISOLATION[0] * spacing, nearest, 0.0)
        np.testing.assert_allclose(spacing * gaps_of_isolated(KdTree.build(points / spacing)), expected)
    assert np.isinf(gaps_of_isolated(KdTree.build(points[:1])))
