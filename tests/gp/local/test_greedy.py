import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dense
from gppcs.gp.local import greedy
from gppcs.gp.local.kernel import LocalField
from gppcs.gp.local.posterior import condition
from gppcs.spatial.kdtree import KdTree


def random_problem(n, seed, normal_weight, noise, spread):
    """A tree over random points and a field over it; spacings differ by up to exp(2 spread)."""
    rng = np.random.default_rng(seed)
    tree = KdTree.build(rng.random((n, 3)) * [6, 6, 1])
    field = dense.local_field(rng, tree.points, spread, normal_weight)
    return tree, field._replace(noise=1e-4 + noise * field.noise)


def extend(field, tree, chosen, n_points, k, w):
    added, scores, deviations = greedy.extend(field, tree, chosen, n_points - len(chosen), k, w)
    return np.r_[chosen, added], scores, deviations


def assert_greedy(tree, field, chosen, n_points, k, w, extended, scores, deviations):
    """Score every point again before each choice; those chosen have the largest score, but for rounding."""
    kernel, distances = dense.local_kernel(field), dense.local_squared_distances(field)
    nearest = [list(row[row >= 0]) for row in condition(field, tree, chosen, k).nearest]
    np.testing.assert_array_equal(extended[: len(chosen)], chosen)
    assert len(np.unique(extended)) == len(extended) == n_points
    taken = list(chosen)
    for new, score, deviation in zip(extended[len(chosen) :], scores, deviations, strict=True):
        expected, expected_deviations = dense.local_scores(kernel, field, nearest, w)
        expected[taken] = -np.inf
        assert expected[new] >= expected.max() * (1 - 1e-9)
        assert score == pytest.approx(expected[new], rel=1e-8, abs=1e-10)
        assert deviation == pytest.approx(expected_deviations[new], rel=1e-6, abs=1e-7)
        taken.append(new)
        for i, row in enumerate(nearest):
            row.append(new)
            row.sort(key=lambda j, i=i: distances[i, j])
            del row[k:]


@given(
    st.integers(2, 50),
    st.integers(0, 10**6),
    st.sampled_from([0.0, 0.5, 3.2]),
    st.sampled_from([0.0, 0.3, 100.0]),
    st.floats(0, 1.5),
    st.integers(1, 10),
    st.sampled_from([0.0, 0.025, 0.8]),
    st.data(),
)
def test_each_choice_is_the_largest_score_of_all(n, seed, weight, noise, spread, k, w, data):
    tree, field = random_problem(n, seed, weight, noise, spread)
    chosen = np.random.default_rng(seed).permutation(n)[: data.draw(st.integers(0, n))]
    n_points = data.draw(st.integers(len(chosen), n))
    assert_greedy(tree, field, chosen, n_points, k, w, *extend(field, tree, chosen, n_points, k, w))


@pytest.mark.parametrize(("k", "w", "start"), [(4, 0.8, 40), (1, 0.0, 0)])
def test_many_leaves_are_passed_by_without_loss(k, w, start):
    """1,100 points in 64 leaves, with spacings that differ by a factor of up to 20."""
    tree, field = random_problem(1_100, k, 1.6, 0.1, 1.5)
    chosen = np.random.default_rng(1).permutation(1_100)[:start]
    assert_greedy(tree, field, chosen, start + 8, k, w, *extend(field, tree, chosen, start + 8, k, w))


@given(
    seed=st.integers(0, 10**6),
    weight=st.sampled_from([0.0, 0.5, 3.2]),
    share=st.floats(0.05, 1.0),
    flat=st.floats(0.0, 1.0),
    size=st.sampled_from([1.0, 1e-3]),
)
def test_parts_choose_what_one_after_another_would(seed, weight, share, flat, size):
    """Conditioned on one point, with the same spacing and noise everywhere, scores never rise; then all is the same.

    In a cloud so small that every point reaches every part, nothing can be chosen at once.
    """
    tree, field = random_problem(2_000, seed, weight, 0.0, 0.0)
    field = field._replace(positions=field.positions * [[size], [size], [size * flat]])
    tree = KdTree.over(field.positions, tree.order)
    chosen = np.arange(0, 2_000, 20)
    n_points = 100 + round(1_900 * share)
    expected = extend(field, tree, chosen, n_points, 1, 0.0)
    with pytest.MonkeyPatch.context() as small:
        small.setattr(greedy, "PART_POINTS", 100)
        found = extend(field, tree, chosen, n_points, 1, 0.0)
    for array, wanted in zip(found, expected, strict=True):
        np.testing.assert_array_equal(array, wanted)


def test_parts_choose_what_one_after_another_would_beside_parts_without_chosen_points(monkeypatch):
    """Points that are far from all chosen ones reach across a gap to those of parts that do not reach them."""
    tree, field = random_problem(2_000, 1, 0.0, 0.0, 0.0)
    positions = field.positions * [[10.0], [10.0], [0.0]]
    positions[0, positions[0] >= 30.0] += 3.0
    tree = KdTree.build(positions.T)
    field = field._replace(positions=tree.points)
    chosen = np.flatnonzero(tree.points[0] < 10.0)[::3]
    expected = extend(field, tree, chosen, len(chosen) + 1_200, 1, 0.0)
    monkeypatch.setattr(greedy, "PART_POINTS", 100)
    for array, wanted in zip(extend(field, tree, chosen, len(chosen) + 1_200, 1, 0.0), expected, strict=True):
        np.testing.assert_array_equal(array, wanted)


@pytest.mark.parametrize(("k", "w"), [(4, 0.0), (4, 0.3), (12, 0.8)])
def test_parts_choose_nearly_the_same_where_scores_rise_with_any_number_of_threads(k, w, monkeypatch, on_threads):
    tree, field = random_problem(3_000, k, 1.6, 0.1, 0.3)
    field = field._replace(detail=field.detail[:0])  # random ones would make scores rise at all points
    chosen = np.arange(0, 3_000, 6)
    expected, best, _ = extend(field, tree, chosen, 900, k, w)
    monkeypatch.setattr(greedy, "PART_POINTS", 100)
    (extended, scores, deviations), *several = on_threads(lambda: extend(field, tree, chosen, 900, k, w))
    for found in several:
        for one, other in zip((extended, scores, deviations), found, strict=True):
            np.testing.assert_array_equal(one, other)
    assert len(np.unique(extended)) == len(extended) == 900
    assert len(scores) == len(deviations) == 400
    assert len(np.intersect1d(extended, expected)) > 0.97 * 900
    assert scores.mean() == pytest.approx(best.mean(), rel=0.01)


@pytest.mark.parametrize("n", [20, 500])
def test_ties_go_to_the_first_in_the_order_of_the_tree(n):
    """Points too far apart to know of each other."""
    points = np.random.default_rng(0).permutation(n)[:, None] * [1e4, 0.0, 0.0]
    tree = KdTree.build(points)
    upright, noise = np.tile([[0.0], [0], [1]], n), np.full(n, 0.1)
    field = LocalField(tree.points, upright, np.ones(n), np.ones(n), noise, np.empty((0, n)), 1.5, 1.0)
    extended, scores, deviations = extend(field, tree, np.array([n - 3]), n, 4, 0.5)
    np.testing.assert_array_equal(extended, [n - 3, *np.delete(np.arange(n), n - 3)])
    np.testing.assert_allclose(scores, np.sqrt(1 / 1.1) + 0.5 / 1.1, rtol=1e-12)
    np.testing.assert_array_equal(deviations, 1)
