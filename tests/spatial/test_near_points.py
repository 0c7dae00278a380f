"""Points within a distance, and medians of groups, against a comparison of all pairs."""

import numpy as np
import pytest

from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.near_points import has_within, medians, others_within


@pytest.mark.parametrize("grid", [False, True])
def test_all_others_within_a_distance_are_found(grid):
    """Also those at just this distance, and more than there is room for at first."""
    rng = np.random.default_rng(0)
    points = rng.integers(0, 9, (900, 3)).astype(float) if grid else rng.random((900, 3))
    points = np.unique(points, axis=0)
    tree, queries = KdTree.build(points), points[::3]
    squared = rng.choice([0.0, 1.0, 5.0, 30.0], len(queries)) * (1.0 if grid else 0.01)
    starts, found = others_within(tree, queries, squared)
    pairs = ((queries[:, None] - points) ** 2).sum(axis=2)
    for i, own in enumerate(np.split(tree.order[found], starts[1:-1])):
        assert sorted(own) == np.flatnonzero((pairs[i] <= squared[i]) & (pairs[i] > 0)).tolist()
    assert max(np.diff(starts)) > 32
    places = queries + 0.5
    pairs = ((places[:, None] - points) ** 2).sum(axis=2)
    np.testing.assert_array_equal(has_within(tree, places, squared), (pairs <= squared[:, None]).any(axis=1))


def test_medians_of_groups():
    starts, values = np.array([0, 1, 3, 3, 6, 10]), np.array([5.0, 2, 4, 7, np.nan, 1, 9, 3, 0, 4])
    np.testing.assert_array_equal(medians(starts, values), [5.0, 3.0, np.nan, np.nan, 3.5])
