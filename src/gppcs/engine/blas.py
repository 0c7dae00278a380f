"""Run linear algebra in one thread, as its results can differ in the last bits with the number of threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits

_lock = threading.RLock()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS and LAPACK run in one thread within a `with` statement or, as a decorator, within a function.

    The number of threads belongs to the whole process, and only the Python thread that has changed it can restore it.
    So such blocks of several Python threads run one after another. Keep them short.
    """
    with _lock, threadpool_limits(1, user_api="blas"):
        yield


def _unlock() -> None:
    """Replace the lock in a forked process: the thread that held it may be gone."""
    global _lock
    _lock = threading.RLock()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_unlock)
