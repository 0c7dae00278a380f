import numpy as np
import pytest

from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_each


@pytest.mark.parametrize(("queries", "points"), [(1, 1), (5, 3), (20_000, 700), (700, 5_000), (3_000, 1)])
def test_the_nearest_point_of_each_query_is_that_of_brute_force(queries, points):
    rng = np.random.default_rng(queries)
    tree, asked = KdTree.build(rng.random((points, 3)) ** 3), KdTree.build(rng.random((queries, 3)))
    positions, squared = nearest_each(tree, asked)
    some = slice(None, None, -(-queries // 500))
    expected = ((asked.points.T[some, None] - tree.points.T[None]) ** 2).sum(axis=2)
    np.testing.assert_allclose(squared[some], expected.min(axis=1), rtol=1e-12)
    np.testing.assert_allclose(expected[np.arange(len(expected)), positions[some]], expected.min(axis=1), rtol=1e-12)
