"""Run linear algebra in one thread, as its results can differ in the last bits with the number of threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from threadpoolctl import threadpool_limits

_lock = threading.Lock()
_users = 0  # blocks of `one_blas_thread` that are running now, in all Python threads
_limits: Any = None  # the numbers of threads from before the first of them, to be restored after the last


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS and LAPACK run in one thread within a `with` statement or, as a decorator, within a function.

    The libraries have one number of threads for the whole process. So other Python threads that use them at the same
    time have one, too, until the last block ends.
    """
    global _users, _limits
    with _lock:
        if _users == 0:
            _limits = threadpool_limits(1, user_api="blas")
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0:
                _limits.restore_original_limits()


def _unlock() -> None:
    """Replace the lock in a forked process: the thread that held it may be gone."""
    global _lock
    _lock = threading.Lock()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_unlock)
