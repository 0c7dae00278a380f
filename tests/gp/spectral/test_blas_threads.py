"""The results do not depend on the number of threads of BLAS, LAPACK or Numba."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from gppcs.engine.blas import one_blas_thread

DIGESTS = """
import hashlib
import gppcs

cloud = gppcs.sample("bracket", 4_000)  # large enough for BLAS to share the work out
for landmarks in (390, 2_000):  # a dense eigensolver, and a sparse one
    method = gppcs.SpectralGP(eigenfunctions=100, k_opt=2_000, landmarks=landmarks, iterations=3)
    result = gppcs.simplify(cloud, n_points=300, method=method)
    print(hashlib.sha256(result.indices.tobytes()).hexdigest(), result.diagnostics)
"""


def digests(threads):
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "NUMBA_NUM_THREADS")
    environment = {**os.environ, **dict.fromkeys(names, str(threads))}
    run = subprocess.run([sys.executable, "-c", DIGESTS], capture_output=True, text=True, check=True, env=environment)
    return run.stdout.splitlines()


@pytest.mark.slow
def test_one_thread_or_two_give_the_same_bits():
    one, two = digests(1), digests(2)
    assert len(one) == 2
    assert one == two


def blas_threads():
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_each_of_several_python_threads_has_one():
    """Were their blocks to overlap, the one that ends first would restore the number for all."""

    def seen_within(_):
        with one_blas_thread():
            before = set(blas_threads())
            time.sleep(0.01)
            return before | set(blas_threads())

    before = blas_threads()
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(seen_within, range(24))) == [{1}] * 24
    with pytest.raises(np.linalg.LinAlgError), one_blas_thread():
        np.linalg.cholesky(-np.eye(3))
    assert blas_threads() == before


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore:This process")  # is multi-threaded, which newer Pythons warn of
def test_a_process_forked_while_another_thread_is_in_a_block_can_enter_one():
    with ThreadPoolExecutor(1) as pool:
        inside, leave = threading.Event(), threading.Event()

        def stay():
            with one_blas_thread():
                inside.set()
                leave.wait()

        other = pool.submit(stay)
        inside.wait()
        if (child := os.fork()) == 0:
            signal.alarm(20)  # ends the process if it waits for the lock
            with one_blas_thread():
                os._exit(0)
        leave.set()
        other.result()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
