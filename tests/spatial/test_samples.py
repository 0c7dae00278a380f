import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest

from gppcs.spatial.samples import even_sample, point_hashes, short_hashes
from shapes import on_sphere


@given(st.integers(1, 3000), st.integers(1, 40), st.sampled_from([0.0, 1e-6, 1.0]), st.integers(0, 10**6))
def test_one_in_k_of_the_usable_points_is_chosen(n, step, thickness, seed):
    rng = np.random.default_rng(seed)
    points = rng.random((n, 3)) * [1.0, 5.0, thickness] - 2.0
    usable = rng.random(n) < 0.8
    chosen = even_sample(points, usable, step)
    assert (np.diff(chosen) > 0).all()
    assert usable[chosen].all()
    assert len(chosen) == -(-np.count_nonzero(usable) // step)


@pytest.mark.parametrize("step", [20, 200])
def test_each_part_of_a_sphere_keeps_its_share(step):
    """In caps of 2 % of it, a random sample has the square root of their number of points more or less."""
    points = on_sphere(80_000)
    chosen = points[even_sample(points, np.ones(len(points), dtype=bool), step)]
    axes = on_sphere(200, seed=1).T
    inside, wanted = ((p @ axes > 0.96).sum(axis=0) for p in (chosen, points))
    assert np.std(inside - wanted / step) < 0.8 * np.sqrt(wanted.mean() / step)


@pytest.mark.parametrize("seed", [0, 1])
def test_random_numbers_of_places_are_uniform_and_differ(seed):
    """Of a lattice: neighbours differ in few bits."""
    points = np.indices((50, 50, 40)).reshape(3, -1).T.astype(float)
    hashes = point_hashes(points, seed)
    assert len(np.unique(hashes)) == 100_000
    assert kstest(hashes / 2.0**64, "uniform").pvalue > 0.01
    assert abs(np.corrcoef(hashes[:-1] / 2.0**64, hashes[1:] / 2.0**64)[0, 1]) < 0.01
    assert abs(np.corrcoef(hashes / 2.0**64, point_hashes(points, seed + 1) / 2.0**64)[0, 1]) < 0.01


@pytest.mark.parametrize("factor", [1.0, 2.0**-70, 3.0, 1000.0])
def test_random_numbers_depend_on_neither_the_order_of_points_nor_their_unit(factor):
    rng = np.random.default_rng(0)
    points = rng.integers(-5000, 5000, (40_000, 3)) / 1024
    order = rng.permutation(len(points))
    np.testing.assert_array_equal(point_hashes(factor * points[order]), point_hashes(points)[order])
    np.testing.assert_array_equal(short_hashes(factor * points, 20), point_hashes(points) >> np.uint64(44))
