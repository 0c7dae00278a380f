"""Writes files that appear only when they are complete."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from gppcs.errors import OutputError


def check_writable(path: str | os.PathLike[str], force: bool = False) -> None:
    """Check that a file can be written. Call it before long work.

    Parameters
    ----------
    path : str or path
        The file to be written.
    force : bool
        Whether an existing file may be overwritten.

    Raises
    ------
    OutputError
        If the file exists and `force` is False, `path` is a folder or device, or its folder is missing or not writable.
    """
    target = Path(path)
    folder = Path(os.path.realpath(target)).parent
    if target.exists() and not target.is_file():
        raise OutputError(f"{target}: expected a file, found a folder or device; choose another name")
    if target.exists() and not force:
        raise OutputError(
            f"{target}: expected a new file, found one; choose another name, or overwrite with --force (force=True)"
        )
    if not folder.is_dir():
        raise OutputError(f"{target}: expected a folder {folder}, found none; make it or choose another")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{target}: expected a writable folder {folder}, found no permission; choose another")


@contextmanager
def whole_file(path: str | os.PathLike[str], force: bool = False) -> Iterator[BinaryIO]:
    """Open a file for writing that appears under its name only when it is complete.

    The content goes to a temporary file in the same folder. If the block ends without an exception, that file is
    renamed to the target; otherwise it is removed.

    Parameters
    ----------
    path : str or path
        The file to be written.
    force : bool
        Whether an existing file may be overwritten.

    Yields
    ------
    binary file
        Open for writing.

    Raises
    ------
    OutputError
        If the file exists and `force` is False, `path` is a folder or device, or its folder is missing or not writable.
    """
    check_writable(path, force)
    target = Path(os.path.realpath(path))  # so that a symbolic link stays one
    temporary = target.with_name(f".gppcs-{secrets.token_hex(8)}.part")
    try:
        with open(temporary, "xb") as file:  # permissions follow the umask, unlike those of tempfile
            yield file
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
