import os
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:  # else each process would start as many threads as there are cores
    os.environ.setdefault("NUMBA_NUM_THREADS", str(min(2, os.cpu_count() or 1)))

import numpy as np
import pytest
from hypothesis import settings

import gppcs

settings.register_profile("untimed", deadline=None)  # a busy machine is no failure
settings.load_profile("untimed")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real clouds; tests that need it are skipped where it is missing."""
    folder = Path(os.environ.get("GPPCS_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real clouds at {folder}; set GPPCS_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def bracket() -> np.ndarray:
    """20,000 points of a machine part with sharp edges."""
    return gppcs.sample("bracket", n_points=20_000).points


@pytest.fixture(scope="session")
def sphere() -> np.ndarray:
    """40,000 random points of the unit sphere."""
    directions = np.random.default_rng(0).standard_normal((40_000, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.fixture(params=[1, 2])
def threads(request):
    """The number of threads that kernels run on."""
    import numba

    if request.param > numba.config.NUMBA_NUM_THREADS:
        pytest.skip("one core")
    before = numba.get_num_threads()
    numba.set_num_threads(request.param)
    yield request.param
    numba.set_num_threads(before)
