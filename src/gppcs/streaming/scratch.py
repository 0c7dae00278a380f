"""Folders for temporary files."""

from __future__ import annotations

import errno
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gppcs.engine.memory import size_of
from gppcs.engine.unfinished import unfinished
from gppcs.errors import OutputError

FULL = 1 << 20  # A disk with less space is full: NumPy tells of a write that is cut short, and not why.


@contextmanager
def scratch_folder(parent: Path | None, size: int) -> Iterator[Path]:
    """Make a folder for temporary files, of this user alone and under a new name; remove it at the end of the block."""
    parent = Path(tempfile.gettempdir()) if parent is None else parent
    if not parent.is_dir():
        raise OutputError(f"{parent}: expected an existing folder for temporary files; make it, or name another")
    free = shutil.disk_usage(parent).free
    if free < size:
        raise _too_little(parent, f"expected at least {size_of(size)} of disk space", size_of(free))
    folder = tempfile.mkdtemp(prefix="gppcs-", dir=parent)
    with unfinished(folder):
        try:
            yield Path(folder)
        except OSError as error:
            if error.errno != errno.ENOSPC and shutil.disk_usage(parent).free > FULL:
                raise
            raise _too_little(parent, f"expected about {size_of(size)} of disk space", "that it is full") from error


def _too_little(parent: Path, expected: str, free: str) -> OutputError:
    """Return the error for a disk that is too full."""
    found = f"{parent}: {expected} for temporary files, found {free}"
    return OutputError(f"{found}; name a folder with more by scratch or TMPDIR, or raise memory")
