"""All ways to run several simplifications at once give the bits of a single call."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

import gppcs
from one_choice import indices, points

RUNS = 3
pytestmark = pytest.mark.usefixtures("default_threads")
CONTEXTS = [each for each in ("fork", "spawn", "forkserver") if each in multiprocessing.get_all_start_methods()]
# From Python 3.12 on, a fork beside other threads gives this warning.
FORKS = pytest.mark.filterwarnings("ignore:This process.*is multi-threaded:DeprecationWarning")


@pytest.fixture(scope="module")
def expected():
    """The choice of one call in this process, after which its helping threads exist."""
    return indices(0)


def assert_all_equal(results, expected):
    results = list(results)
    assert len(results) == RUNS
    for result in results:
        np.testing.assert_array_equal(result, expected)


@FORKS
@pytest.mark.parametrize(
    "method", [pytest.param(each, marks=[] if each == "fork" else pytest.mark.slow) for each in CONTEXTS]
)
def test_pools_of_processes(method, expected):
    context = multiprocessing.get_context(method)
    with context.Pool(2) as pool:
        assert_all_equal(pool.map_async(indices, range(RUNS)).get(timeout=300), expected)
    with ProcessPoolExecutor(2, context) as pool:
        assert_all_equal(pool.map(indices, range(RUNS), timeout=300), expected)


def test_threads(expected):
    cloud = points()
    gppcs.set_threads(2)
    with ThreadPoolExecutor(RUNS) as pool:
        runs = [pool.submit(gppcs.simplify, cloud, n_points=3_000) for _ in range(RUNS)]
        results = [run.result(timeout=300).indices for run in runs]
    assert_all_equal(results, expected)
