import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gppcs.spatial.even_sample import even_sample


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 3000), st.integers(1, 40), st.sampled_from([0.0, 1e-6, 1.0]), st.integers(0, 10**6))
def test_one_in_k_of_the_usable_points_is_chosen(n, step, thickness, seed):
    rng = np.random.default_rng(seed)
    points = rng.random((n, 3)) * [1.0, 5.0, thickness] - 2.0
    usable = rng.random(n) < 0.8
    chosen = even_sample(points, usable, step)
    assert (np.diff(chosen) > 0).all()
    assert usable[chosen].all()
    assert len(chosen) == -(-np.count_nonzero(usable) // step)


def test_each_part_of_a_sphere_keeps_its_share():
    rng = np.random.default_rng(0)
    points = rng.standard_normal((200_000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    chosen = points[even_sample(points, np.ones(len(points), dtype=bool), 20)]
    for _ in range(50):  # caps of 2 % of the sphere: random samples of 10,000 have 200 +- 14 points there
        axis = rng.standard_normal(3)
        inside, wanted = (np.count_nonzero(p @ axis > 0.96 * np.linalg.norm(axis)) for p in (chosen, points))
        assert abs(inside - wanted / 20) < 20


def test_a_shifted_and_scaled_cloud_gives_the_same_sample():
    points = np.random.default_rng(1).integers(0, 1000, (5000, 3)) / 1024.0
    usable = np.ones(len(points), dtype=bool)
    chosen = even_sample(points, usable, 7)
    np.testing.assert_array_equal(even_sample(4.0 * points - 16.0, usable, 7), chosen)
