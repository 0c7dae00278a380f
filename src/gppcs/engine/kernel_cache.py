"""Choose the folder in which Numba keeps the compiled kernels.

Numba tries three folders and takes the first that it can write to: the folder that NUMBA_CACHE_DIR names, the
`__pycache__` folder beside the package's files, and the user's cache folder.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import Any

_temporary: Any = None  # the temporary cache folder, if one was needed


def provide_folder() -> None:
    """Give Numba a temporary cache folder if it can write to no other; it is removed at exit.

    Without a folder that it can write to, Numba refuses to compile kernels.
    """
    global _temporary
    beside = os.path.join(os.path.dirname(os.path.abspath(__file__)), "__pycache__")
    if _can_write(beside) or any(map(_can_write, _named_folders())):
        return
    import atexit
    import tempfile

    _temporary = tempfile.TemporaryDirectory(prefix="gppcs-", ignore_cleanup_errors=True)
    atexit.register(_temporary.cleanup)
    os.environ["NUMBA_CACHE_DIR"] = _temporary.name
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = _temporary.name


def are_kept() -> bool:
    """Return whether compiled kernels are still there after this process ends.

    Returns
    -------
    bool
        False if the kernels are in a temporary folder.
    """
    return _temporary is None


def _named_folders() -> Iterator[str]:
    """Yield the folders that Numba would use instead of the one beside the package's files."""
    if named := os.environ.get("NUMBA_CACHE_DIR"):
        yield named
    yield os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "numba")


def _can_write(folder: str) -> bool:
    """Return whether files can be created in a folder; the folder itself need not exist yet."""
    folder = os.path.abspath(folder)
    while not os.path.lexists(folder):
        folder = os.path.dirname(folder)
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)
