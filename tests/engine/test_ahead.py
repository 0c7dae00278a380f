"""A second process compiles kernels too, and helps only where it can."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numba import typeof

import gppcs
from gppcs.engine import ahead, kernel_cache, threads
from gppcs.gp.local.kernel import LocalField
from kernels_of_gp import as_text, described

TESTS = Path(__file__).parents[1]
CODE = "from gppcs.engine.ahead import compile_from_last; compile_from_last({!r})"


def run_python(code, **environment):
    """Run code in a new process; return what it prints."""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ | environment
    )
    assert done.stderr == ""
    return done.stdout


@pytest.mark.slow
def test_the_list_of_kernels_is_that_of_gp():
    """If this fails, run `make kernels`."""
    code = f"import sys; sys.path.insert(0, {str(TESTS)!r})\n"
    code += "from kernels_of_gp import *; print(as_text(kernels_of_gp()), end='')"
    assert run_python(code) == ahead.KERNELS.read_text() == as_text(json.loads(ahead.KERNELS.read_text()))


@pytest.mark.parametrize(
    "value",
    [
        1,
        1.0,
        True,
        np.ones((2, 3), dtype=np.float32),
        np.ones((2, 3), dtype=bool).T,
        np.ones(6, dtype=np.uint64)[::2],
        LocalField(*(np.ones((3, 2)),) * 2, *(np.ones(2),) * 3, 1.0, 1.0),
    ],
)
def test_types_are_those_described(value):
    assert ahead._numba_type(json.loads(json.dumps(described(typeof(value))))) == typeof(value)


@pytest.fixture
def started(monkeypatch, tmp_path):
    """The commands of processes that would have started."""
    found = []

    class Process:
        def __init__(self, command, **options):
            found.append(command)

    monkeypatch.setattr(ahead, "_started", False)
    monkeypatch.setattr(ahead.subprocess, "Popen", Process)
    monkeypatch.setattr(ahead.atexit, "register", lambda *arguments: None)
    monkeypatch.setattr(threads, "_wanted", 2)
    monkeypatch.setattr(kernel_cache, "folder_to_write", lambda: tmp_path)
    return found


def test_one_process_starts_while_gp_runs(started):
    ahead.start_if_expected()
    with ahead.compiled_ahead("voxel"):
        ahead.start_if_expected()
    assert started == []
    with ahead.compiled_ahead("gp"):
        for _ in range(3):
            ahead.start_if_expected()
    assert [command[:2] for command in started] == [[sys.executable, "-c"]]
    ahead.start_if_expected()
    assert len(started) == 1


@pytest.mark.parametrize("executable", ["", None, "/opt/blender/blender"])
def test_none_starts_where_python_is_part_of_a_program(started, monkeypatch, executable):
    monkeypatch.setattr(sys, "executable", executable)
    with ahead.compiled_ahead("gp"):
        ahead.start_if_expected()
    assert started == []


def test_none_starts_with_one_thread(started, monkeypatch):
    monkeypatch.setattr(threads, "_wanted", 1)
    with ahead.compiled_ahead("gp"):
        ahead.start_if_expected()
    assert started == []


def test_none_starts_where_nothing_can_be_kept(started, monkeypatch):
    monkeypatch.setattr(kernel_cache, "folder_to_write", lambda: None)
    with ahead.compiled_ahead("gp"):
        ahead.start_if_expected()
    assert started == []


def test_a_process_that_cannot_start_does_no_harm(started, monkeypatch):
    monkeypatch.setattr(ahead.subprocess, "Popen", lambda *_, **__: os.stat("/does/not/exist"))
    with ahead.compiled_ahead("gp"):
        ahead.start_if_expected()


@pytest.fixture
def copy(tmp_path):
    """The environment of a process that uses a copy of the package, without compiled kernels."""
    shutil.copytree(
        Path(gppcs.__file__).parent, tmp_path / "copy" / "gppcs", ignore=shutil.ignore_patterns("__pycache__")
    )
    return {"PYTHONPATH": str(tmp_path / "copy"), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}


def helper(lock, copy):
    return subprocess.Popen(
        [sys.executable, "-c", CODE.format(str(lock))],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=os.environ | copy,
    )  # fmt: skip


def kept(folder):
    return {path.name for path in Path(folder).rglob("*.nbc")}


def wait_for(condition):
    end = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_it_compiles_until_the_process_that_waits_ends_and_never_twice_at_once(copy, tmp_path):
    cache = copy["NUMBA_CACHE_DIR"]
    with helper(tmp_path / "lock", copy) as first:
        wait_for(lambda: kept(cache))
        with helper(tmp_path / "lock", copy) as second:
            assert second.wait(timeout=60) == 0  # although its stdin has not ended
            assert second.stdout.read() == b""
        assert first.poll() is None
        first.stdin.close()  # as at the end of the process that started it
        assert first.wait(timeout=10) == 0
        assert first.stdout.read() == b""
    assert not any(".spatial.scaling" in name for name in kept(cache))  # the last kernels come first


@pytest.mark.slow
def test_a_first_run_has_the_same_result_with_help_and_without(copy):
    code = "import gppcs, sys; from gppcs.app.compilation import compile_method; gppcs.set_threads(int(sys.argv[1]));"
    code = code.replace("int(sys.argv[1])", "{}") + "print(hash(compile_method('gp')[1].points.tobytes()))"
    hashing = {"PYTHONHASHSEED": "0"}
    helped = run_python(code.format(2), **copy, **hashing)
    assert helped == run_python(code.format(1), **hashing)
