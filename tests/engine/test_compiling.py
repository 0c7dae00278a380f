"""The library says once that it compiles, and reports the time apart."""

import gc
import logging
import subprocess
import sys
import threading
import time

import pytest

import gppcs
from gppcs.engine import compiling
from gppcs.engine.kernels import kernel

COMPILE = """
import sys, numba
@numba.njit
def of_another_package(x):
    return x + 1
of_another_package(1)
from gppcs.engine.compiling import seconds
print(seconds() == 0)
from gppcs.engine.kernels import kernel
import gppcs.engine.kernel_cache as kernels
kernels.folders = lambda: []
kernels.folder_to_write = lambda: None
@kernel
def f(x):
    return x * 2
f(1), f(1.5)
print(seconds() > 0)
"""
TWICE = "True\nTrue\n"


def run_python(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout, done.stderr


@pytest.mark.slow
def test_a_script_hears_of_compilation_only_by_logging():
    assert run_python(COMPILE) == (TWICE, "")
    log = "import logging; logging.basicConfig(level=logging.INFO)\n"
    assert run_python(log + COMPILE) == (TWICE, f"INFO:gppcs:{compiling.PASSING_NOTICE}\n")


@pytest.mark.slow
def test_an_interactive_session_is_told_once():
    assert run_python("import sys; sys.ps1 = 'In : '\n" + COMPILE) == (TWICE, f"gppcs: {compiling.PASSING_NOTICE}\n")


@pytest.fixture
def fresh(monkeypatch):
    """No compilation so far."""
    monkeypatch.setattr(compiling, "_clock", compiling._Clock())
    monkeypatch.setattr(compiling, "_told", False)


def compile_for(seconds):
    """Two compilations, one inside the other."""
    compiling.compilation_started()
    compiling.compilation_started()
    time.sleep(seconds)
    compiling.compilation_ended()
    compiling.compilation_ended()


def test_compilation_is_logged_once_and_timed(fresh, caplog):
    with caplog.at_level(logging.INFO, "gppcs"):
        compile_for(0.02)
        compile_for(0.02)
    assert caplog.messages == [compiling.NOTICE]
    assert 0.04 <= compiling.seconds() < 1


@pytest.mark.parametrize("collects", [True, False])
def test_the_garbage_collector_rests_meanwhile(fresh, collects):
    @kernel
    def impossible(x):
        return x.nothing

    (gc.enable if collects else gc.disable)()
    try:
        compiling.compilation_started()
        assert not gc.isenabled()
        compiling.compilation_started()
        compiling.compilation_ended()
        assert not gc.isenabled()
        compiling.compilation_ended()
        assert gc.isenabled() == collects
        with pytest.raises(Exception, match="nothing"):
            impossible(1)
        assert gc.isenabled() == collects
    finally:
        gc.enable()


def test_stages_report_compilation_apart(fresh):
    stages = gppcs.Stages()
    with stages("first"):
        pass
    assert list(stages.seconds) == ["first"]
    start = time.perf_counter()
    with stages("second"):
        compile_for(0.2)
    with stages("third"):
        compile_for(0.2)
    elapsed = time.perf_counter() - start
    assert 0.4 <= stages.seconds["compilation"] <= elapsed
    assert all(0 <= stages.seconds[name] <= elapsed - 0.4 for name in ("second", "third"))


def test_compilation_by_another_thread_counts_only_while_the_stage_runs(fresh):
    stages, ready = gppcs.Stages(), threading.Event()

    def compile_longer():
        compiling.compilation_started()
        ready.set()
        time.sleep(0.5)
        compiling.compilation_ended()

    thread = threading.Thread(target=compile_longer)
    thread.start()
    ready.wait()
    with stages("stage"):
        time.sleep(0.1)
    thread.join()
    assert 0.09 <= stages.seconds["compilation"] < 0.45
    assert stages.seconds["stage"] < 0.05


def test_a_failed_compilation_ends(fresh):
    @kernel
    def impossible(x):
        return x.nothing

    with pytest.raises(Exception, match="nothing"):
        impossible(1)
    before = compiling.seconds()
    time.sleep(0.01)
    assert before > 0
    assert compiling.seconds() == before


def test_a_result_tells_compilation_from_its_own_time(fresh):
    result = gppcs.simplify(gppcs.sample("sphere", 1000), n_points=10, method="random")
    assert "compilation" not in repr(result) or "compilation" in result.seconds
    known = gppcs.Result(result.indices, result.cloud, result.method, {"a": 1.0, "compilation": 40.0, "b": 2.0}, {})
    assert repr(known) == "Result(10 points by random in 3 s and 40 s of compilation)"
