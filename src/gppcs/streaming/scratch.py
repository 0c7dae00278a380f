"""Temporary files, and folders for them."""

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.memory import size_of
from gppcs.errors import OutputError
from gppcs.io.arrays import header_lock


@contextmanager
def scratch_folder(parent: str | os.PathLike[str] | None, size: int) -> Iterator[Path]:
    """Make a folder for temporary files, of this user only and under a new name; remove it at the end of the block."""
    parent = Path(tempfile.gettempdir() if parent is None else parent)
    if not parent.is_dir():
        raise OutputError(f"{parent}: expected an existing folder for temporary files; make it, or name another")
    free = shutil.disk_usage(parent).free
    expected = f"{parent}: expected about {size_of(size)} of disk space for temporary files, found"
    remedy = "name a folder with more by TMPDIR, in Python also by scratch, or raise `memory`"
    if free < size:
        raise OutputError(f"{expected} {size_of(free)}; {remedy}")
    with tempfile.TemporaryDirectory(prefix="gppcs-", dir=parent, ignore_cleanup_errors=True) as folder:
        try:
            yield Path(folder)
        except OSError as error:
            # NumPy does not say why a write is cut short: a disk with less than 1 MB is full.
            if error.errno == errno.ENOSPC or shutil.disk_usage(parent).free <= 1 << 20:
                raise OutputError(f"{expected} that it is full; {remedy}") from error
            raise


@contextmanager
def complete_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file that appears once it is complete: a task may be done by two workers at once."""
    unfinished = path.with_name(f"{path.name}.{uuid4().hex}")
    try:
        with unfinished.open("wb") as file:
            yield file
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays that tasks leave for each other, but those that are missing."""
    with complete_file(path) as file:
        np.savez(file, **{name: values for name, values in arrays.items() if values is not None})


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read arrays."""
    with header_lock, np.load(path) as stored:
        return dict(stored)
