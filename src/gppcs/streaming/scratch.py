"""Folders for temporary files."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gppcs.engine.unfinished import unfinished
from gppcs.errors import OutputError
from gppcs.streaming.sizes import size_of


@contextmanager
def scratch_folder(parent: Path | None, size: int) -> Iterator[Path]:
    """Make a folder for temporary files, and remove it at the end of the block.

    Parameters
    ----------
    parent : path or None
        Where to make it; by default where the system keeps temporary files.
    size : int
        How many bytes it is going to take.

    Yields
    ------
    path
        An empty folder.

    Raises
    ------
    OutputError
        If there is no such parent, or too little space on its disk.
    """
    parent = Path(tempfile.gettempdir()) if parent is None else parent
    if not parent.is_dir():
        raise OutputError(f"{parent}: expected an existing folder for temporary files; make it, or name another")
    free = shutil.disk_usage(parent).free
    if free < size:
        found = f"{parent}: expected at least {size_of(size)} of disk space for temporary files, found {size_of(free)}"
        raise OutputError(
            f"{found}; name a folder with more by scratch=, or raise memory=",
            command=f"{found}; name a folder with more by --scratch, or raise --memory",
        )
    folder = tempfile.mkdtemp(prefix="gppcs-", dir=parent)
    with unfinished(folder):
        yield Path(folder)
