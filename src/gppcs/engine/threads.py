"""Run kernels on several threads: Python threads take range after range of the work, and the caller takes part.

The kernels release the GIL. No thread waits actively, so a thread that loses its core delays at most the end of one
range. The helping threads are shared by all callers, and a forked process starts its own.
"""

import contextlib
import functools
import math
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from gppcs.engine.memory import control_groups
from gppcs.errors import whole_number

T = TypeVar("T")

RANGES = 64  # Ranges of the work at most: enough to balance threads, few enough that taking them costs nothing.

_wanted: int | None = None  # what `set_threads` set
_pool: ThreadPoolExecutor | None = None  # the helping threads, which start when they are first needed
_growing = threading.Lock()
_here = threading.local()  # `shares` is true in threads that share the cores, `alone` in those that use one thread
_sharing = 0  # how many threads these are


def on_ranges(kernel: Callable[..., Any], n: int, *arguments: Any, minimum: int = 1) -> None:
    """Call a kernel on ranges that together are 0 to n, on several threads at once."""
    count = min(RANGES, n // minimum)
    threads = min(number_of_threads(), count) if count > 1 else 1
    if threads == 1:
        kernel(0, n, *arguments)
        return
    left = iter(range(count))

    def take_part() -> None:
        """Run the kernel on ranges until none is left; after an error or Ctrl-C, none is."""
        try:
            for i in left:
                kernel(n * i // count, n * (i + 1) // count, *arguments)
        except BaseException:
            deque(left, maxlen=0)
            raise

    helpers: list[Future[None]] = []
    with contextlib.suppress(RuntimeError):  # no thread can start: the caller does all the work
        for _ in range(threads - 1):
            helpers.append(_pool_of(threads - 1).submit(take_part))
    try:
        take_part()
        for helper in helpers:
            if not helper.cancel():  # it has begun
                helper.result()
    except BaseException:
        deque(left, maxlen=0)
        raise


def beside(task: Callable[[], T]) -> Callable[[], T]:
    """Start a task on a helping thread, if there is one; return a function that waits for what it returns."""
    threads = number_of_threads()
    if threads == 1:
        return task
    try:
        future = _pool_of(threads - 1).submit(task)
    except RuntimeError:  # no thread can start
        return task
    return lambda: task() if future.cancel() else future.result()


def _pool_of(size: int) -> ThreadPoolExecutor:
    """Return the pool of helping threads, which has at least that size."""
    global _pool
    with _growing:
        if _pool is None or _pool._max_workers < size:
            _pool = ThreadPoolExecutor(size, "gppcs")
        return _pool


def number_of_threads() -> int:
    """Return the number of threads that a call uses."""
    if getattr(_here, "alone", False):
        return 1
    threads = _wanted or int(min(_cores(), _quota()))
    return max(1, threads // _sharing) if getattr(_here, "shares", False) else threads


def _cores() -> int:
    """Return on how many cores this process may run."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def sharing_cores() -> Iterator[None]:
    """Let the calling thread have its share of the cores, which grows when other threads leave such a block."""
    global _sharing
    with _growing:
        _sharing += 1
    _here.shares = True
    try:
        yield
    finally:
        _here.shares = False
        with _growing:
            _sharing -= 1


@contextlib.contextmanager
def on_one_thread() -> Iterator[None]:
    """Let the calls of the calling thread use no other one."""
    before, _here.alone = getattr(_here, "alone", False), True
    try:
        yield
    finally:
        _here.alone = before


def set_threads(count: int | None) -> None:
    """Set the number of threads that a call uses. Results do not depend on it.

    Parameters
    ----------
    count : int or None
        At least 1. None, the default, stands for the cores that this process may use.

    Examples
    --------
    >>> gppcs.set_threads(1)
    >>> gppcs.set_threads(None)
    """
    global _wanted
    _wanted = None if count is None else whole_number("the number of threads", count, 1)


@functools.cache
def _quota(root: Path = Path("/")) -> float:
    """Return how many cores of time the control groups of this process may use, rounded up; infinite without limit."""
    return min(
        (max(1, math.ceil(cores)) for cores in map(_limit, control_groups("cpu", root)) if cores), default=math.inf
    )


def _limit(group: Path) -> float | None:
    """Return how many cores of time a control group may use, None without a limit."""
    for files in (("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")):
        try:
            quota, period = " ".join((group / file).read_text() for file in files).split()
            return int(quota) / int(period) if int(quota) > 0 else None
        except (OSError, ValueError):  # the file of the other version; "max" stands for no limit
            continue
    return None


def _start_anew() -> None:
    """Forget the other threads, which a forked process lacks."""
    global _pool, _growing, _sharing
    _pool, _growing, _sharing = None, threading.Lock(), int(getattr(_here, "shares", False))
    _quota.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_start_anew)
