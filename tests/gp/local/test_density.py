import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.gp.local.density import graded, roundness_of
from gppcs.spatial.kdtree import LEAF_SIZE, KdTree


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


def groups_of(tree):
    """The points of each leaf, parted evenly."""
    n, leaves = len(tree.order), len(tree.lower) // 2
    for leaf in range(leaves):
        begin, end = n * leaf // leaves, n * (leaf + 1) // leaves
        parts = max(1, round(n / leaves / 8))
        for part in range(parts):
            yield slice(begin + (end - begin) * part // parts, begin + (end - begin) * (part + 1) // parts)


@pytest.mark.parametrize("n", [1, 7, 8, LEAF_SIZE, LEAF_SIZE + 1, 5_000])
def test_graded_spacings_are_of_groups_and_no_greater_than_before(n):
    rng = np.random.default_rng(n)
    tree = KdTree.build(rng.random((n, 3)))
    spacings = 0.5 + rng.random(n)
    found = graded(tree, spacings, 0.1)
    assert (found <= spacings).all()
    groups = list(groups_of(tree))
    centres = np.array([tree.points[:, group].mean(axis=1) for group in groups])
    means = np.array([np.mean(spacings[group] ** -2.0) ** -0.5 for group in groups])
    limits = (means + 0.1 * np.linalg.norm(centres[:, None] - centres, axis=2)).min(axis=1)
    for group, limit in zip(groups, limits, strict=True):
        np.testing.assert_allclose(found[group], np.minimum(spacings[group], limit), rtol=1e-9)
