import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import paper_radius
from gppcs.surface.normals import estimate_normals
from gppcs.surface.surface_variation import estimate_features, features_in_radius, features_of_nearest


def plain_features(points, neighbourhoods):
    """Surface variation and normals by NumPy's eigensolver (paper, Eqs. 1 and 2)."""
    variation, normals, isolated = [], [], []
    for neighbours in neighbourhoods:
        local = points[neighbours] - points[neighbours].mean(axis=0)
        values, vectors = np.linalg.eigh(local.T @ local)
        variation.append(values[0] / values.sum() if values.sum() > 0 else 0.0)
        normals.append(vectors[:, 0])
        isolated.append(values[1] - values[0] > 1e-6 * values.sum())
    return np.maximum(variation, 0.0), np.array(normals), np.array(isolated)


def assert_same(features, expected):
    variation, normals, isolated = expected
    # the closed form is good to the root of the rounding error where the two smallest eigenvalues coincide
    np.testing.assert_allclose(features.surface_variation, variation, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(features.normals, axis=1), 1.0, atol=1e-12)
    cosines = np.abs((features.normals * normals).sum(axis=1))
    np.testing.assert_allclose(cosines[isolated], 1.0, atol=1e-6)


@given(st.integers(1, 200), st.floats(0.05, 1.0), st.integers(0, 99))
def test_radius_equals_plain_numpy(n, radius, seed):
    rng = np.random.default_rng(seed)
    points = rng.random((n, 3)) * rng.choice([1.0, 1e-3, 1e-6], 3)
    inside = ((points[:, None] - points) ** 2).sum(axis=2) <= radius * radius
    assert_same(features_in_radius(KdTree.build(points), radius), plain_features(points, inside))


@given(st.integers(3, 200), st.integers(3, 30), st.integers(0, 99))
def test_nearest_equals_plain_numpy(n, k, seed):
    points = np.random.default_rng(seed).random((n, 3))
    order = np.argsort(((points[:, None] - points) ** 2).sum(axis=2), axis=1)
    assert_same(features_of_nearest(KdTree.build(points), k), plain_features(points, order[:, :k]))


@pytest.mark.parametrize("name", ["bracket", "medallion", "fan"])
def test_equals_jakteristics(name):
    jakteristics = pytest.importorskip("jakteristics")
    points = gppcs.sample(name, n_points=30_000, noise=0.001).points
    radius = paper_radius(points)
    features = features_in_radius(KdTree.build(points), radius)
    names = ["surface_variation", "number_of_neighbors"]
    expected = {
        name: jakteristics.compute_features(points, search_radius=radius, feature_names=[name])[:, 0] for name in names
    }
    np.testing.assert_array_equal(features.neighbours, expected["number_of_neighbors"])
    enough = features.neighbours >= 3
    assert enough.mean() > 0.99
    np.testing.assert_allclose(features.surface_variation[enough], expected["surface_variation"][enough], atol=1e-6)


@pytest.mark.parametrize("estimate", [estimate_features, estimate_normals])
def test_neither_threads_nor_the_unit_change_an_estimate(bracket, estimate, on_threads):
    """Also where the squares of coordinates vanish or overflow."""
    one, *others = on_threads(lambda: estimate(bracket))
    others += [estimate(np.ldexp(bracket, exponent)) for exponent in (-560, 560)]
    assert all(np.array_equal(other, one) if estimate is estimate_normals else other == one for other in others)


def test_repeats_count_as_neighbours_and_leave_the_radius(bracket):
    plain = estimate_features(bracket)
    repeated = estimate_features(np.vstack([bracket, bracket, bracket[:100]]))
    np.testing.assert_array_equal(repeated.neighbours[100:20_000], repeated.neighbours[20_100:40_000])
    assert np.median(repeated.neighbours) > np.median(plain.neighbours)
    assert np.abs(np.median(repeated.surface_variation) - np.median(plain.surface_variation)) < 1e-6


def test_what_cannot_be_measured_is_refused():
    with pytest.raises(gppcs.InputError, match="empty"):
        estimate_features(np.empty((0, 3)))
    with pytest.raises(gppcs.InputError, match="NaN"):
        estimate_features([[0, 0, np.nan]])
    for neighbours in (0, 2.5):
        with pytest.raises(gppcs.ParameterError, match=f"whole number from 1 on, found {neighbours}"):
            estimate_features(np.random.default_rng(0).random((9, 3)), neighbours)


def test_points_that_crowd_together_are_counted_as_by_brute_force():
    """Most of the points lie in two dots, within the radius of each other or of some of the rest."""
    rng = np.random.default_rng(0)
    dots = 1e-3 * rng.standard_normal((1_000, 3)), 1e-3 * rng.standard_normal((1_000, 3)) + [0.1, 0.0, 0.0]
    points = np.concatenate([*dots, rng.random((400, 3)) * [1.0, 1.0, 0.01]])
    features = features_in_radius(KdTree.build(points), 0.101)
    inside = ((points[:, None] - points) ** 2).sum(axis=2) <= 0.101**2
    np.testing.assert_array_equal(features.neighbours, inside.sum(axis=1))
    assert_same(features, plain_features(points, inside))


@pytest.mark.slow
@pytest.mark.parametrize("k", [3, 25, 40])
def test_the_nearest_are_found_where_density_jumps_and_points_tie(k):
    rng = np.random.default_rng(k)
    lattice = np.indices((20, 20, 2)).reshape(3, -1).T * 0.01
    points = np.concatenate(
        [rng.random((2_000, 3)) * [1, 1, 0], lattice, [[50.0, 0, 0]], 5 + 1e-6 * rng.random((300, 3))]
    )
    features = features_of_nearest(KdTree.build(points), k)
    squared = ((points[:, None] - points) ** 2).sum(axis=2)
    order = np.argsort(squared, axis=1)
    reach = np.take_along_axis(squared, order, axis=1)
    clear = reach[:, k] > reach[:, k - 1] * (1 + 1e-9)  # elsewhere there is a choice of neighbours
    assert 0.6 < clear.mean() < 1
    variation, _, _ = plain_features(points, order[:, :k])
    np.testing.assert_allclose(features.surface_variation[clear], variation[clear], atol=1e-7)
    np.testing.assert_array_equal(features.neighbours, k)
