import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import dense
from gppcs.gp.spectral import greedy


@given(
    st.integers(2, 80),
    st.integers(1, 20),
    st.sampled_from([1, 3, 40]),
    st.sampled_from([1e-3, 0.1, 10.0]),
    st.sampled_from([1, 7, 200]),
    st.sampled_from([1.0, 10.0]),
    st.floats(0, 0.99),
    st.floats(0, 1),
    st.integers(0, 999),
)
@example(80, 20, 1, 1e-3, 200, 10.0, 0.05, 0.6, 0)  # where each bucket is one point, its bound is the tightest
def test_order_is_that_of_a_dense_algorithm_1(n, features, k_add, noise, buckets, largest, start, more, seed):
    rng = np.random.default_rng(seed)
    phi, y = rng.standard_normal((n, features)), largest * rng.standard_normal(n)
    k_init = 1 + int(start * (n - 1))
    n_points = k_init + int(more * (n - k_init))
    initial = rng.permutation(n)[:k_init]
    order = rng.permutation(n)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(greedy, "BUCKETS", buckets)
        initial_places = np.argsort(order)[initial]
        chosen = greedy.select(phi[order], y[order], noise, initial_places, n_points, k_add, order)
    np.testing.assert_array_equal(order[chosen], dense.greedy(phi, y, noise, initial, n_points, k_add))


def test_ties_go_to_the_smallest_index():
    phi, y, order = np.ones((50, 1)), np.full(50, 2.0), np.random.default_rng(0).permutation(50)
    chosen = greedy.select(phi, y, 0.5, np.array([30]), 50, order=order)
    np.testing.assert_array_equal(order[chosen[1:]], np.delete(np.arange(50), order[30]))
