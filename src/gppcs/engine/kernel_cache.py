"""Where the compiled kernels are kept.

Numba keeps what it compiled in the folder that NUMBA_CACHE_DIR names, else beside the package's files, else in the
user's cache folder: the first of these that it can write to.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import Any

_passing: Any = None  # the folder that is removed at exit, where there had to be one


def provide_folder() -> None:
    """Give Numba a folder that is removed at exit where it could write to none, since it would refuse to compile."""
    global _passing
    beside = os.path.join(os.path.dirname(os.path.abspath(__file__)), "__pycache__")
    if _can_write(beside) or any(map(_can_write, _named_folders())):
        return
    import atexit
    import tempfile

    _passing = tempfile.TemporaryDirectory(prefix="gppcs-", ignore_cleanup_errors=True)
    atexit.register(_passing.cleanup)
    os.environ["NUMBA_CACHE_DIR"] = _passing.name
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = _passing.name


def are_kept() -> bool:
    """Tell whether what is compiled outlives this process."""
    return _passing is None


def _named_folders() -> Iterator[str]:
    """Give the folders that Numba would use instead of the one beside the package's files."""
    if named := os.environ.get("NUMBA_CACHE_DIR"):
        yield named
    yield os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "numba")


def _can_write(folder: str) -> bool:
    """Tell whether files can be made in a folder, which itself may have to be made first."""
    folder = os.path.abspath(folder)
    while not os.path.lexists(folder):
        folder = os.path.dirname(folder)
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)
