"""Temporary files and folders, so that a process that ends at once can still remove them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_paths: set[str] = set()


@contextmanager
def unfinished(path: str) -> Iterator[None]:
    """Remove a temporary file or folder at the end of the block, if it is still there."""
    _paths.add(path)
    try:
        yield
    finally:
        _remove(path)
        _paths.discard(path)


def remove_all() -> None:
    """Remove the files and folders of all blocks that have not ended. Call it before a process ends at once."""
    for path in _paths.copy():
        with suppress(OSError):  # the others are still to be removed, and the process is to end
            _remove(path)


def _remove(path: str) -> None:
    if os.path.isdir(path):
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(FileNotFoundError):
        os.unlink(path)
