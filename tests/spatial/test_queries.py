import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.queries import nearest_unused


def plain_nearest_unused(positions, points):
    free = np.ones(len(points), dtype=bool)
    indices = []
    for position in positions:
        indices.append(np.argmin(np.where(free, ((points - position) ** 2).sum(axis=1), np.inf)))
        free[indices[-1]] = False
    return indices


@given(st.integers(1, 300), st.booleans(), st.integers(0, 99), st.data())
def test_equals_the_plain_algorithm(n, on_grid, seed, data):
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 4, (n, 3)).astype(float) if on_grid else rng.random((n, 3))
    positions = points[rng.integers(0, n, data.draw(st.integers(1, n)))] + (0 if on_grid else 0.01)
    np.testing.assert_array_equal(
        nearest_unused(positions, KdTree.build(points)), plain_nearest_unused(positions, points)
    )
