import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.spatial.kdtree import LEAF_SIZE, KdTree, leaves_near
from gppcs.spatial.nearest import nearest_others
from shapes import KINDS

SHAPES = ["solid", "grid, with ties and repeats", "line", "one place"]


@given(st.sampled_from(SHAPES), st.integers(1, 800), st.integers(1, 12), st.booleans(), st.integers(0, 99))
def test_nearest_are_those_of_brute_force(shape, n, k, elsewhere, seed):
    rng = np.random.default_rng(seed)
    points = KINDS[shape](rng, n)
    queries, k = rng.random((300, 3)) * 3 - 0.5 if elsewhere else points, min(k, n)
    indices, squared = KdTree.build(points).nearest_of(queries, k)
    everything = ((queries[:, None] - points) ** 2).sum(axis=2)
    np.testing.assert_array_equal(squared, np.sort(everything, axis=1)[:, :k])
    np.testing.assert_array_equal(np.take_along_axis(everything, indices, axis=1), squared)


@pytest.mark.parametrize(("n", "k"), [(1, 0), (2, 1), (500, 7), (5_000, 24)])
def test_neighbours_are_the_nearest_others_in_tree_order(n, k):
    points = np.random.default_rng(3).random((n, 3))
    tree = KdTree.build(points)
    positions, squared = nearest_others(tree, k)
    indices, expected = tree.nearest_of(points[tree.order], k + 1)
    np.testing.assert_array_equal(indices[:, 0], tree.order)
    np.testing.assert_array_equal(tree.order[positions], indices[:, 1:])
    np.testing.assert_array_equal(squared, expected[:, 1:])


@pytest.mark.parametrize("n", [1, LEAF_SIZE, LEAF_SIZE + 1, 1_000, 4_097])
def test_boxes_hold_their_points_tightly(n):
    points = np.random.default_rng(2).random((n, 3))
    tree = KdTree.build(points)
    np.testing.assert_array_equal(np.sort(tree.order), np.arange(n))
    np.testing.assert_array_equal(points[tree.order].T, tree.points)
    leaves = len(tree.lower) // 2
    for level in range(leaves.bit_length()):
        nodes = 1 << level
        for j in range(nodes):
            inside = tree.points[:, n * j // nodes : n * (j + 1) // nodes]
            np.testing.assert_array_equal(tree.lower[nodes + j], inside.min(axis=1))
            np.testing.assert_array_equal(tree.upper[nodes + j], inside.max(axis=1))


@given(st.sampled_from(SHAPES), st.integers(1, 500), st.floats(0, 2), st.integers(0, 99))
def test_no_point_near_a_box_is_outside_the_leaves_near_it(shape, n, radius, seed):
    rng = np.random.default_rng(seed)
    tree = KdTree.build(KINDS[shape](rng, n))
    low, high = np.sort(rng.standard_normal((2, 3)), axis=0)
    found = np.empty(len(tree.lower) // 2, dtype=np.int64)
    found = found[: leaves_near(tree.lower, tree.upper, low, high, radius**2, found)] - len(tree.lower) // 2
    leaf = np.searchsorted(
        n * np.arange(1, len(tree.lower) // 2 + 1) // (len(tree.lower) // 2), np.arange(n), side="right"
    )
    away = np.maximum(np.maximum(low - tree.points.T, tree.points.T - high), 0.0)
    assert set(leaf[(away**2).sum(axis=1) <= radius**2]) <= set(found.tolist())
    gaps = np.maximum(np.maximum(tree.lower - high, low - tree.upper), 0.0)[len(tree.lower) // 2 :]
    assert sorted(found.tolist()) == np.flatnonzero((gaps**2).sum(axis=1) <= radius**2).tolist()


@pytest.mark.parametrize("n", [1, 2, 32, 33, 1000])
def test_a_tree_over_sorted_points_has_their_boxes(n):
    built = KdTree.build(np.random.default_rng(n).random((n, 3)))
    over = KdTree.over(built.points, built.order)
    np.testing.assert_array_equal(over.lower[1:], built.lower[1:])
    np.testing.assert_array_equal(over.upper[1:], built.upper[1:])
    np.testing.assert_array_equal(KdTree.over(built.points).order, np.arange(n))


def test_queries_without_a_finite_distance_have_an_infinite_one():
    indices, squared = KdTree.build(np.eye(3)).nearest_of(np.array([[np.nan, 0, 0], [1e200, 0, 0], [1, 0, 0]]), 2)
    assert np.isinf(squared).all(axis=1).tolist() == [True, True, False]
    assert ((indices >= 0) & (indices < 3)).all()
