import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.gp.local.density import graded, roundness_of
from gppcs.spatial.kdtree import KdTree


@given(
    st.integers(1, 32), st.sampled_from([1, 2, 4, 8]), st.sampled_from([0.0, 0.1, 0.7, 5.0]), st.booleans(),
    st.integers(0, 99),
)  # fmt: skip
def test_limits_of_groups_of_one_are_those_of_all_pairs(in_leaf, leaves, slope, repeated, seed):
    n, rng = in_leaf * leaves, np.random.default_rng(seed)
    points = rng.integers(0, 3, (n, 3)).astype(float) if repeated else rng.random((n, 3))
    tree, spacings = KdTree.build(points), rng.random(n) + 0.1
    apart = np.linalg.norm(tree.points.T[:, None] - tree.points.T, axis=2)
    expected = (spacings + slope * apart).min(axis=1)
    np.testing.assert_allclose(graded(tree, spacings, slope, group_size=1), expected, rtol=1e-12)


def test_flat_faces_with_edges_are_not_round():
    for edges in (0.1, 0.5, 0.9):
        of_faces = np.where(np.arange(100) < 100 * edges, 0.29, 0.0)
        assert roundness_of(of_faces) == pytest.approx(0)
        assert roundness_of(np.where(of_faces > 0, 0.5, 0.0)) == pytest.approx(0)  # what is sharper counts no more
    assert roundness_of(np.full(9, 0.29)) == roundness_of(np.zeros(9)) == 1
    assert roundness_of(np.linspace(0, 0.29, 999)) == pytest.approx((1 - 1 / 9) ** 4, rel=0.01)
