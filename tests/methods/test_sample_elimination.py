import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from gppcs.methods.sample_elimination.elimination import (
    BETA,
    EARLIER_RATIO,
    GAMMA,
    LAST_RATIO,
    REMOVED,
    WHOLE,
    eliminate,
    thin,
)
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area
from shapes import KINDS


def plain_stage(points, n_points, area):
    """Rows removed by one stage, with a table of all pairs; ties go to the first in the order of a tree."""
    order = KdTree.build(points).order
    points = points[order]
    reach = 2.0 * np.sqrt(area / (2.0 * np.sqrt(3.0) * n_points))
    dx, dy, dz = (points[:, None] - points).transpose(2, 0, 1)
    limit = reach * BETA * (1.0 - (n_points / len(points)) ** GAMMA)
    terms = np.maximum(1.0 - np.maximum(np.sqrt(dx * dx + dy * dy + dz * dz), limit) / reach, 0.0)
    for _ in range(3):
        terms *= terms
    terms = np.floor(WHOLE * terms)
    np.fill_diagonal(terms, 0.0)
    weights = terms.sum(axis=1)
    removed = []
    while len(removed) < len(points) - n_points and weights.max() > 0:
        removed.append(int(np.argmax(weights)))
        weights -= terms[removed[-1]]
        weights[removed[-1]] = REMOVED
    return order[removed]


def plain_elimination(points, n_points):
    area = surface_area(KdTree.build(points))
    kept, order = np.arange(len(points)), []
    while len(kept) > 1:
        if len(kept) > n_points:
            last = len(kept) <= LAST_RATIO * n_points
            target = n_points if last else max(LAST_RATIO * n_points, len(kept) // EARLIER_RATIO)
        else:
            target = len(kept) // 2
        removed = plain_stage(points[kept], target, area)
        order.extend(kept[removed])
        kept = np.delete(kept, removed)
        if len(kept) > target:
            area = max(4.0 * area, surface_area(KdTree.build(points[kept])))
    return np.array([*order, *kept])[::-1][:n_points]


def spacings(points):
    return cKDTree(points).query(points, 2)[0][:, 1]


@pytest.mark.slow
@given(st.integers(1, 250), st.sampled_from(["solid", "lattice", "clump", "dot"]), st.integers(0, 99), st.data())
def test_equals_the_plain_algorithm(n, shape, seed, data):
    points = KINDS[shape](np.random.default_rng(seed), n)
    n_points = data.draw(st.integers(1, n))
    expected = plain_elimination(points, n_points)
    np.testing.assert_array_equal(eliminate(points, n_points), expected)
    np.testing.assert_array_equal(thin(points, n_points)[0], np.sort(expected))


@pytest.mark.parametrize("n_points", [7, 150])
@pytest.mark.parametrize("dot", [1.0, 0.02])
def test_stages_equal_the_plain_algorithm(n_points, dot):
    """Half of the points lie in a part of the slab, which is wide or so small that the limit holds in all of it."""
    points = np.random.default_rng(1).random((1_500, 3)) * [1.0, 1.0, 0.01]
    points[::2] *= dot
    np.testing.assert_array_equal(eliminate(points, n_points), plain_elimination(points, n_points))


@pytest.mark.parametrize("n_points", [200, 4_000])
def test_is_blue_noise_and_so_is_its_beginning(sphere, n_points):
    chosen = sphere[eliminate(sphere, n_points)]
    for some in (chosen, chosen[: n_points // 2]):
        densest = 2.0 * np.sqrt(4.0 * np.pi / (2.0 * np.sqrt(3.0) * len(some)))
        assert spacings(some).min() > 0.6 * densest  # Yuksel reports 0.7 and above for whole sets
