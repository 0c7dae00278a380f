import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest

from gppcs.spatial.samples import HASHES, even_sample, hashes, is_drawn


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
    rng = np.random.default_rng(0)
    points = rng.standard_normal((200_000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    chosen = points[even_sample(points, np.ones(len(points), dtype=bool), step)]
    axes = rng.standard_normal((3, 200))
    inside, wanted = ((p @ axes > 0.96 * np.linalg.norm(axes, axis=0)).sum(axis=0) for p in (chosen, points))
    assert np.std(inside - wanted / step) < 0.8 * np.sqrt(wanted.mean() / step)


def test_hashes_are_uniform_and_differ():
    found = hashes(np.arange(100_000, dtype=np.uint64))
    assert len(np.unique(found)) == 100_000
    assert kstest(found / HASHES, "uniform").pvalue > 0.01
    assert abs(np.corrcoef(found[:-1] / HASHES, found[1:] / HASHES)[0, 1]) < 0.01


@pytest.mark.parametrize("fraction", [0.0, 0.01, 0.3, 1.0])
def test_the_fraction_that_is_drawn(fraction):
    found = is_drawn(np.arange(100_000), fraction).mean()
    assert found == pytest.approx(fraction, abs=0.005)
    assert found == fraction or fraction not in (0.0, 1.0)
