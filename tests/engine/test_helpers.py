"""Other processes compile parts of a pipeline; where they may not start, or die, this process does all of it."""

import importlib
import multiprocessing
import os
import subprocess
import sys
import time

import pytest

import gppcs
from gppcs.engine import helpers


@pytest.fixture
def alone(monkeypatch, default_threads):
    """A process of the user's own, with two cores."""
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    gppcs.set_threads(2)


PARTS = """
import os
def record(path):
    with open(path, "a") as file:
        file.write(f"{os.getpid()}\\n")
def record_or_die(path, main):
    if os.getpid() != main:
        os._exit(1)
    record(path)
def send_answer(results):
    from gppcs.engine.helpers import may_start_processes
    results.put(may_start_processes())
"""


@pytest.fixture
def parts(tmp_path, monkeypatch):
    """A module with parts, which write what process runs them; one of them ends all processes but the main one."""
    (tmp_path / "parts_of_test.py").write_text(PARTS)
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("parts_of_test")
    del sys.modules["parts_of_test"]


def written(path):
    return [int(line) for line in path.read_text().split()] if path.exists() else []


def test_parts_run_in_other_processes(alone, parts, tmp_path):
    assert list(helpers.run_all([(parts.record, str(tmp_path / name)) for name in "abc"])) == [0, 0, 0]
    processes = [process for name in "abc" for process in written(tmp_path / name)]
    assert len(processes) == 3
    assert os.getpid() not in processes


def test_parts_of_processes_that_die_run_in_this_one(alone, parts, tmp_path):
    both = [(parts.record_or_die, str(tmp_path / name), os.getpid()) for name in "ab"]
    assert list(helpers.run_all(both)) == [0, 0]
    assert written(tmp_path / "a") == written(tmp_path / "b") == [os.getpid()]


def test_a_block_without_compilation_starts_no_process(alone, parts, monkeypatch):
    scan = gppcs.sample("sphere", 1000)
    gppcs.simplify(scan, n_points=10, method="random")
    monkeypatch.setattr(subprocess, "Popen", lambda *arguments, **options: pytest.fail("a process was started"))
    with helpers.helped((parts.record, "never")):
        gppcs.simplify(scan, n_points=10, method="random")


def test_helpers_start_when_a_kernel_is_missing_and_end_with_the_block(alone, parts, tmp_path):
    path = tmp_path / "run"
    with helpers.helped((parts.record, str(path)), (parts.record, str(path))):
        helpers.call_helpers()
        helpers.call_helpers()
        helper = wait_for(path)
    assert helper != os.getpid()
    with pytest.raises(ProcessLookupError):
        os.kill(helper, 0)


def wait_for(path):
    """Return the process that wrote into a file, once it has."""
    for _ in range(1200):
        if lines := written(path):
            return lines[0]
        time.sleep(0.05)
    raise AssertionError("no helper has run")


@pytest.mark.parametrize("case", ["one core", "xdist", "embedded", "frozen"])
def test_no_process_starts_where_it_should_not(alone, monkeypatch, case):
    assert helpers.may_start_processes()
    if case == "one core":
        gppcs.set_threads(1)
    elif case == "xdist":
        monkeypatch.setenv("PYTEST_XDIST_WORKER", "gw0")
    elif case == "embedded":
        monkeypatch.setattr(sys, "executable", "/usr/bin/qgis")
    else:
        monkeypatch.setattr(sys, "frozen", True, raising=False)
    assert not helpers.may_start_processes()


def test_parts_run_in_this_process_where_no_other_can_start(alone, parts, tmp_path, monkeypatch):
    def no_process(*arguments, **options):
        raise BlockingIOError("Resource temporarily unavailable")

    monkeypatch.setattr(subprocess, "Popen", no_process)
    assert list(helpers.run_all([(parts.record, str(tmp_path / "a"))])) == [0]
    assert written(tmp_path / "a") == [os.getpid()]
    with helpers.helped((parts.record, "never")):
        helpers.call_helpers()


def test_workers_start_no_processes(alone, parts):
    context = multiprocessing.get_context("spawn")
    results = context.SimpleQueue()
    worker = context.Process(target=parts.send_answer, args=(results,))
    worker.start()
    assert not results.get()
    worker.join()
