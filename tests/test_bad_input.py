"""Clouds that are hard on grids and trees cost the default method about what a well-spread cloud of that size does."""

import gc
import tracemalloc

import numpy as np
import pytest

import gppcs
from shapes import noisy, on_sphere

N, M = 50_000, 1_500
SHUFFLE = np.random.default_rng(2).permutation(N)


def with_far_point(direction, distance=1e6):
    """A sphere and a point so many diameters away."""
    return np.concatenate([on_sphere(N)[1:], 2 * 3**0.5 * distance * np.array([direction])])[SHUFFLE]


def mostly_in_a_dot():
    """A sphere's surface of which 99 of 100 points lie in a dot of a millionth of its size."""
    inside = int(0.99 * N)
    return np.concatenate([on_sphere(N)[inside:], [1.0, 0.0, 0.0] + 1e-6 * on_sphere(inside, seed=1)])[SHUFFLE]


NOISY = noisy(on_sphere(N), 0.01)
BAD = {
    "far point across all axes": lambda: with_far_point([0.6, 0.6, 0.5]),
    "99 of 100 on a tiny sphere": mostly_in_a_dot,
    "each point ten times": lambda: np.repeat(on_sphere(N // 10), 10, axis=0)[SHUFFLE],
    "a volume": lambda: np.random.default_rng(1).standard_normal((N, 3)),
}


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """Threads would share the time out, and wait for each other in it."""
    gppcs.set_threads(1)
    yield
    gppcs.set_threads(None)


def peak(points):
    """Return the most bytes that NumPy held at a time to choose from the points, for each point."""
    gc.collect()
    tracemalloc.start()
    gppcs.simplify(points, n_points=M)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most / len(points)


@pytest.fixture(scope="module")
def peak_of_spread():
    for points in (NOISY[::20], NOISY[::40]):  # compiles or loads the kernels
        gppcs.simplify(points, n_points=M // 20)
    return peak(on_sphere(N))


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD)
def test_memory_is_that_of_a_well_spread_cloud(name, peak_of_spread):
    assert peak(BAD[name]()) < 1.4 * peak_of_spread


def test_memory_does_not_grow_with_the_extent():
    """A grid over the box would have 10^9 times as many cells for the last."""
    near, far = (peak(with_far_point([0.6, 0.6, 0.5], distance)) for distance in (1e3, 1e12))
    assert far < 1.1 * near
