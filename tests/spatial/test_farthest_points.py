import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from gppcs.spatial.farthest_points import farthest_points, fill_gaps
from gppcs.spatial.kdtree import KdTree


def plain_farthest_points(points, n_points, first=None, others=()):
    """The textbook algorithm; ties go to the first point."""
    squared = np.full(len(points), np.inf)
    for other in others:
        squared = np.minimum(squared, ((points - other) ** 2).sum(axis=1))
    index = int(np.argmin(((points - np.ascontiguousarray(points.T).mean(axis=1)) ** 2).sum(axis=1)))
    if len(others):
        index = int(np.argmax(squared))
    if first is not None:
        index = first
    chosen, distances = [], []
    for _ in range(n_points):
        chosen.append(index)
        distances.append(squared[index])
        squared = np.minimum(squared, ((points - points[index]) ** 2).sum(axis=1))
        squared[chosen] = -1.0
        index = int(np.argmax(squared))
    return np.array(chosen), np.sqrt(distances)


@given(st.integers(1, 400), st.sampled_from([0, 1, 20]), st.booleans(), st.booleans(), st.integers(0, 99), st.data())
def test_equals_the_plain_algorithm(n, n_others, with_first, on_grid, seed, data):
    rng = np.random.default_rng(seed)
    everything = rng.integers(0, 5, (n + n_others, 3)).astype(float) if on_grid else rng.random((n + n_others, 3))
    points, others = everything[:n], everything[n:]
    points = points[KdTree.build(points).order]
    first = data.draw(st.integers(0, n - 1)) if with_first else None
    n_points = data.draw(st.integers(1, n))
    indices, distances = farthest_points(points, n_points, KdTree.over(points.T), first=first, before=others)
    expected, expected_distances = plain_farthest_points(points, n_points, first, others)
    np.testing.assert_array_equal(indices, expected)
    np.testing.assert_array_equal(distances, expected_distances)


def test_a_tree_at_hand_changes_nothing_and_smaller_choices_are_prefixes(bracket):
    indices, distances = farthest_points(bracket, 5_000)
    again, _ = farthest_points(bracket, 900, KdTree.build(bracket))
    np.testing.assert_array_equal(again, indices[:900])
    assert (np.diff(distances) <= 0).all()


@given(st.integers(0, 99), st.sampled_from([3, 12, 10_000]), st.sampled_from([0.2, 0.5, 9.0]))
@settings(max_examples=20)
def test_gaps_are_filled_as_by_farthest_points_among_all(seed, sides, gap):
    """On a coarse grid, many points are equally far, and many repeat others."""
    points = np.random.default_rng(seed).integers(0, sides, (150, 3)) / sides
    kept = points[:3]
    added, reached = fill_gaps(points, kept, gap)
    if sides == 10_000:
        expected, _ = farthest_points(points, 150, before=kept, minimum=np.nextafter(gap, np.inf))
        np.testing.assert_array_equal(added, expected)
    for count, index in enumerate(added):
        before = cKDTree(np.concatenate([kept, points[added[:count]]])).query(points)[0]
        assert gap < before[index] == pytest.approx(before.max())
    assert reached <= gap
    assert reached == pytest.approx(cKDTree(np.concatenate([kept, points[added]])).query(points)[0].max())
