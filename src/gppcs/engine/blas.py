"""Run linear algebra in one thread, as its results can differ in the last bits with the number of threads."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController

_lock = threading.RLock()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS run in one thread within a `with` or a function; such blocks of several Python threads wait in turn."""
    with _lock, _libraries().limit(limits=1, user_api="blas"):
        yield


@cache
def _libraries() -> ThreadpoolController:
    """Find the libraries of NumPy and SciPy, once, as that takes some milliseconds."""
    import scipy.linalg  # noqa: F401 - it loads a library of its own

    return ThreadpoolController()


def _unlock() -> None:
    """Start anew in a forked process: the thread that held the lock may be gone."""
    global _lock
    _lock = threading.RLock()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_unlock)
