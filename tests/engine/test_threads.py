import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from gppcs.engine import threads
from gppcs.engine.threads import RANGES, beside, number_of_threads, on_ranges, set_threads, sharing_cores

pytestmark = pytest.mark.usefixtures("default_threads")


@given(n=st.integers(0, 500), minimum=st.integers(1, 50), count=st.integers(1, 8))
def test_ranges_hold_each_item_once(n, minimum, count):
    set_threads(count)
    calls = []
    on_ranges(lambda begin, end: calls.append((begin, end)), n, minimum=minimum)
    assert len(calls) <= RANGES
    assert sorted(i for begin, end in calls for i in range(begin, end)) == list(range(n))
    assert len(calls) == 1 or all(end - begin >= minimum for begin, end in calls)


def test_several_threads_work_at_once():
    set_threads(3)
    all_here = threading.Barrier(3, timeout=20)
    on_ranges(lambda begin, end: all_here.wait(), 3)  # a single thread would wait in vain


@pytest.mark.parametrize("count", [1, 2, 5])
def test_an_error_in_any_thread_reaches_the_caller_and_the_next_call_works(count):
    set_threads(count)

    def fail(begin, end):
        time.sleep(0.001)
        if end > 30:
            raise MemoryError("no room")

    for _ in range(5):
        with pytest.raises(MemoryError, match="no room"):
            on_ranges(fail, 64)
    done = []
    on_ranges(lambda begin, end: done.append(end - begin), 64)
    assert sum(done) == 64


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_fork_starts_its_own_helpers():
    set_threads(3)
    on_ranges(lambda begin, end: None, 10)
    with sharing_cores():
        child = os.fork()
        if child == 0:
            signal.alarm(20)
            barrier = threading.Barrier(3, timeout=10)
            on_ranges(lambda begin, end: barrier.wait(), 3)
            os._exit(0)
    assert os.waitpid(child, 0)[1] == 0


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs an affinity")
def test_the_default_is_that_of_the_affinity():
    before = os.sched_getaffinity(0)
    gppcs.set_threads(99)  # more than cores are allowed
    assert number_of_threads() == 99
    gppcs.set_threads(None)
    try:
        os.sched_setaffinity(0, {min(before)})
        assert number_of_threads() == 1
    finally:
        os.sched_setaffinity(0, before)


def test_threads_that_work_on_parts_share_the_cores():
    set_threads(4)
    both_are_here = threading.Barrier(2, timeout=20)

    def share(part):
        with sharing_cores():
            both_are_here.wait()
            threads = number_of_threads()
            both_are_here.wait()
        return threads

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(share, range(2))) == [2, 2]
    with sharing_cores():
        assert number_of_threads() == 4


@pytest.mark.parametrize(
    ("groups", "files", "expected"),
    [
        ("", {}, np.inf),
        ("0::/a/b\n", {"a/b/cpu.max": "150000 100000", "a/cpu.max": "max 100000"}, 2),
        ("0::/a/b\n", {"a/b/cpu.max": "800000 100000", "a/cpu.max": "300000 100000"}, 3),
        ("0::/a/b\n", {"cpu.max": "20000 100000"}, 1),  # a container sees its own group as the root
        ("5:cpu,cpuacct:/x\n", {"cpu,cpuacct/cpu.cfs_quota_us": "25", "cpu,cpuacct/cpu.cfs_period_us": "10"}, 3),
        ("nonsense\n", {"cpu.max": "nonsense"}, np.inf),
    ],
)
def test_the_quota_of_a_container_counts(container, groups, files, expected):
    assert threads._quota(container(groups, files)) == expected


INTERRUPTED = """
import os, signal, threading, time
from gppcs.engine.threads import on_ranges, set_threads
set_threads(2)
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell may have ignored for background work
threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
try:
    on_ranges(lambda begin, end: time.sleep(0.05), 64)
except KeyboardInterrupt:
    print("interrupted")
done = []
on_ranges(lambda begin, end: done.append(1), 64)
print(len(done))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_ctrl_c_ends_a_call_and_the_next_one_works():
    output = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=60, check=True)
    assert output.stdout == "interrupted\n64\n"


@pytest.mark.parametrize("count", [1, 2])
def test_a_task_beside_returns_its_result_or_error_also_if_no_thread_is_free(count):
    set_threads(count)
    is_free = threading.Event()
    waits = [beside(is_free.wait) for _ in range(3)]  # more than there are helping threads
    result, error = beside(lambda: 7), beside(lambda: [][0])
    assert result() == 7
    with pytest.raises(IndexError):
        error()
    is_free.set()
    assert all(wait() for wait in waits)
