"""Run kernels on several threads: Python threads take range after range of the work, and the caller takes part.

The kernels release the GIL. No thread waits actively, so a thread that loses its core delays at most the end of one
range. The helping threads are shared by all callers, and a forked process starts its own.
"""

from __future__ import annotations

import contextlib
import functools
import math
import os
import threading
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from gppcs.engine.control_groups import control_groups
from gppcs.errors import whole_number

RANGES = 64  # Ranges of the work at most: enough to balance threads, few enough that taking them costs nothing.

_wanted: int | None = None  # what `set_threads` set
_here = threading.local()  # `alone` is true in threads that work without helpers


class _Helpers:
    """Threads that wait for work in a queue; they start when they are first needed."""

    def __init__(self) -> None:
        self.queue: SimpleQueue[_Work] = SimpleQueue()
        self.count = 0
        self.lock = threading.Lock()

    def call(self, work: _Work, helpers: int) -> None:
        """Ask some helpers to take part in the work."""
        with self.lock, contextlib.suppress(RuntimeError):  # no thread can start: the caller does all the work
            while self.count < helpers:
                threading.Thread(target=self._serve, name="gppcs", daemon=True).start()
                self.count += 1
        for _ in range(min(helpers, self.count)):  # work that nobody takes would hold its arrays in memory
            self.queue.put(work)

    def _serve(self) -> None:
        while True:
            self.queue.get().take_part()


class _Work:
    """A kernel and the ranges that no thread has taken yet."""

    def __init__(self, kernel: Callable[..., Any], ranges: list[tuple[int, int]], arguments: tuple[Any, ...]) -> None:
        self.kernel, self.ranges, self.arguments = kernel, ranges, arguments
        self.unfinished = len(ranges)
        self.error: BaseException | None = None
        self.lock = threading.Lock()
        self.finished = threading.Event()

    def take_part(self) -> None:
        """Run the kernel on ranges until none is left."""
        while True:
            with self.lock:
                if not self.ranges:
                    return
                begin, end = self.ranges.pop()
            try:
                self.kernel(begin, end, *self.arguments)
            except BaseException as error:
                self.stop(error)
            self._done(1)

    def stop(self, error: BaseException) -> None:
        """Drop the ranges that no thread has taken."""
        with self.lock:
            self.error = error
            dropped = len(self.ranges)
            self.ranges.clear()
        self._done(dropped)

    def _done(self, count: int) -> None:
        with self.lock:
            self.unfinished -= count
            if self.unfinished == 0:
                self.finished.set()


_helpers = _Helpers()


def on_ranges(kernel: Callable[..., Any], n: int, *arguments: Any, least: int = 1) -> None:
    """Call a kernel on ranges that together are 0 to n, on several threads at once."""
    count = min(RANGES, n // least)
    threads = min(number_of_threads(), count)
    if threads <= 1:
        kernel(0, n, *arguments)
        return
    ranges = [(n * i // count, n * (i + 1) // count) for i in reversed(range(count))]
    work = _Work(kernel, ranges, arguments)
    _helpers.call(work, threads - 1)
    try:
        work.take_part()
        work.finished.wait()
    except BaseException as error:  # Ctrl-C
        work.stop(error)
        raise
    if work.error:
        raise work.error


def number_of_threads() -> int:
    """Return the number of threads that a call uses."""
    return 1 if getattr(_here, "alone", False) else _wanted or int(min(_cores(), _quota()))


def work_alone() -> None:
    """Let the calling thread work without helpers, as it is itself one of several."""
    _here.alone = True


def set_threads(count: int | None) -> None:
    """Set the number of threads that a call uses. Results do not depend on it.

    Parameters
    ----------
    count : int or None
        At least 1; it may exceed the number of cores. None stands for the default: the cores that this process may
        use.

    Raises
    ------
    ParameterError
        If the number is not whole or below 1.

    Examples
    --------
    >>> import gppcs
    >>> gppcs.set_threads(1)
    >>> gppcs.set_threads(None)
    """
    global _wanted
    _wanted = None if count is None else whole_number("the number of threads", count, 1)


def _cores() -> int:
    """Return the number of cores on which this process may run."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@functools.cache
def _quota(root: Path = Path("/")) -> float:
    """Return the number of cores whose time the control groups of this process may use, rounded up.

    It is infinite without a limit, and where there are no control groups.
    """
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
    """Forget the helping threads, which a forked process lacks."""
    global _helpers
    _helpers = _Helpers()
    _quota.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_start_anew)
