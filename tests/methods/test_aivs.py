from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gppcs.methods.aivs import voxels
from gppcs.methods.aivs.voxels import Voxels, points_of_voxels, trimmed
from shapes import KINDS


def plain_voxels(points):
    """The points of each voxel by its numbers along the axes, and the edge."""
    n = len(points)
    steps = ((10_000, 10), (50_000, 20), (100_000, 30), (500_000, 40), (1_000_000, 50))
    along = next((voxels for below, voxels in steps if n < below), round((n / 8) ** (1 / 3)))
    local = points - points.min(axis=0)
    voxels = {}
    for index, cell in enumerate(np.minimum(np.floor(local * along / local.max()), along - 1).astype(int)):
        voxels.setdefault(tuple(cell.tolist()), []).append(index)
    return dict(sorted(voxels.items())), local, local.max() / along


def plain_quota(members, n, n_points):
    share = members * n_points
    return share // n + (5 * (share % n) > n)


def plain_filled(points, n_points):
    voxels, local, edge = plain_voxels(points)
    chosen = {}
    for parity in product((0, 1), repeat=3):
        for cell, members in voxels.items():
            if tuple(number % 2 for number in cell) != parity:
                continue
            centre = (np.array(cell) + 0.5) * edge
            squared = np.full(len(members), np.inf)
            for step in product((-1, 0, 1), repeat=3):
                for other in chosen.get(tuple(np.add(cell, step).tolist()), ()):
                    if np.abs(local[other] - centre).max() <= 0.75 * edge:
                        squared = np.minimum(squared, ((local[members] - local[other]) ** 2).sum(axis=1))
            pick = int(np.argmin(((local[members] - centre) ** 2).sum(axis=1)))
            chosen[cell] = []
            for _ in range(plain_quota(len(members), len(points), n_points)):
                chosen[cell].append(members[pick])
                squared = np.minimum(squared, ((local[members] - local[members[pick]]) ** 2).sum(axis=1))
                squared[pick] = -1.0
                pick = int(np.argmax(squared))
    return chosen


def plain_trimmed(counts, n_points):
    counts = np.array(counts)
    threshold = (counts.max() - counts.min()) // 3
    while counts.sum() > n_points:
        before = counts.sum()
        for voxel in [*range(0, len(counts), 2), *range(1, len(counts), 2)]:
            if counts[voxel] > threshold and counts.sum() > n_points:
                counts[voxel] -= 1
        if counts.sum() == before:
            threshold -= 1
    return counts


def plain_points_of_voxels(points, n_points):
    chosen = plain_filled(points, n_points)
    cells = sorted(chosen)
    kept = dict(zip(cells, plain_trimmed([len(chosen[cell]) for cell in cells], n_points), strict=True))
    indices = [index for cell, members in chosen.items() for index in members[: kept[cell]]]
    while len(indices) < n_points:
        if indices:
            squared = ((points[:, None] - points[indices]) ** 2).sum(axis=2).min(axis=1)
            squared[indices] = -1.0
            indices.append(int(np.argmax(squared)))
        else:
            indices.append(int(np.argmin(((points - points.mean(axis=0)) ** 2).sum(axis=1))))
    return indices


@given(
    st.sampled_from(["solid", "line", "uneven", "far outlier"]),
    st.integers(2, 300),
    st.booleans(),
    st.integers(0, 99),
    st.data(),
)
def test_equals_the_plain_algorithm(shape, n, with_trees, seed, data):
    points = KINDS[shape](np.random.default_rng(seed), n)
    n_points = data.draw(st.integers(1, n - 1))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(voxels, "LARGE", 5 if with_trees else 10**9)
        assert points_of_voxels(points, n_points).tolist() == plain_points_of_voxels(points, n_points)


@pytest.mark.parametrize(
    ("n", "along"), [(9_999, 10), (10_000, 20), (100_000, 40), pytest.param(1_728_000, 60, marks=pytest.mark.slow)]
)
def test_voxels_part_the_points(n, along):
    points = np.random.default_rng(0).random((n, 3)) * [1.0, 0.2, 0.3] - 5
    voxels = Voxels.build(points)
    assert voxels.along == along
    np.testing.assert_array_equal(np.sort(voxels.order), np.arange(n))
    away = np.abs(voxels.points - (np.repeat(voxels.cells, np.diff(voxels.begins), axis=0).T + 0.5) * voxels.edge)
    assert away.max() <= 0.5 * voxels.edge * (1 + 1e-9)


@settings(max_examples=200)
@given(st.lists(st.integers(0, 30), min_size=1, max_size=30), st.data())
def test_trimming_equals_the_plain_algorithm(counts, data):
    n_points = data.draw(st.integers(1, sum(counts) + 2))
    kept = trimmed(np.array(counts), n_points)
    np.testing.assert_array_equal(kept, plain_trimmed(counts, n_points))
    assert kept.sum() == min(sum(counts), n_points)
