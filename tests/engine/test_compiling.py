"""The library says once that it compiles, and reports the time apart."""

import gc
import logging
import os
import subprocess
import sys
import time

import pytest

import gppcs
from gppcs.engine import timer as compiling
from gppcs.engine.kernels import kernel
from gppcs.engine.timer import NOTICE


@pytest.fixture
def fresh(monkeypatch):
    """No compilation so far."""
    monkeypatch.setattr(compiling, "compile_timer", compiling.CompileTimer())


def compile_for(seconds):
    """Two compilations, one inside the other."""
    compiling.compile_timer.start()
    compiling.compile_timer.start()
    assert gc.isenabled()  # other threads go on
    time.sleep(seconds)
    compiling.compile_timer.stop()
    compiling.compile_timer.stop()


def test_compilation_is_logged_once_and_timed(fresh, caplog):
    with caplog.at_level(logging.INFO, "gppcs"):
        compile_for(0.02)
        compile_for(0.02)
    assert caplog.messages == [NOTICE]
    assert 0.04 <= compiling.compile_timer.seconds < 1


@pytest.mark.parametrize("fails", [False, True])
def test_stages_report_compilation_apart(fresh, fails):
    @kernel
    def impossible(x):
        return x.nothing

    timer = gppcs.Timer()
    with timer("first"):
        pass
    assert list(timer.seconds) == ["first"]
    start = time.perf_counter()
    with timer("second"):
        if fails:
            with pytest.raises(Exception, match="nothing"):
                impossible(1)
        compile_for(0.2)
    elapsed = time.perf_counter() - start
    time.sleep(0.01)
    assert 0.2 <= timer.seconds["compilation"] <= elapsed
    assert compiling.compile_timer.seconds == pytest.approx(timer.seconds["compilation"], abs=0.005)  # both have ended
    assert 0 <= timer.seconds["second"] <= elapsed - 0.2


@pytest.mark.slow
def test_kernels_that_share_functions_compile_one_after_another(tmp_path):
    """A choice with detail, after one without: LLVM leaves out what nothing calls when it is linked."""
    code = (
        "import numpy as np, gppcs\n"
        "points = np.random.default_rng(0).random((4000, 3))\n"
        "cloud = gppcs.PointCloud(points, {'a': np.sin(9 * points[:, 0])})\n"
        "print(len(gppcs.simplify(cloud, n_points=100)), len(gppcs.simplify(cloud, n_points=100, detail='a')))\n"
    )
    variables = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=variables, capture_output=True, text=True)
    assert done.stdout.split() == ["100", "100"], done.stderr
