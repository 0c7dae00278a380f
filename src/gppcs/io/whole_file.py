"""Files that are either whole or not there."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from gppcs.errors import OutputError


def check_writable(path: str | os.PathLike[str], force: bool = False) -> None:
    """Check, before any work is done, that a file can be written.

    Parameters
    ----------
    path : path
        The file to be written.
    force : bool
        Whether it may take the place of a file that exists.

    Raises
    ------
    OutputError
        If the file exists and `force` is not given, or is no file, or its folder is missing or not writable.
    """
    target = Path(path)
    folder = Path(os.path.realpath(target)).parent
    if target.exists() and not target.is_file():
        raise OutputError(f"{target}: expected a file, found a folder or device; choose another name")
    if target.exists() and not force:
        raise OutputError(
            f"{target}: expected a new file, found one; choose another name or overwrite it with --force (force=True)"
        )
    if not folder.is_dir():
        raise OutputError(f"{target}: expected a folder {folder}, found none; make it or choose another")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{target}: no permission to write into the folder {folder}; choose another")


@contextmanager
def whole_file(path: str | os.PathLike[str], force: bool = False) -> Iterator[BinaryIO]:
    """Open a file for writing that appears under its name only once it is whole.

    The bytes go to a temporary file in the same folder, which takes the target's place when the block ends
    without an exception, and is removed otherwise.

    Parameters
    ----------
    path : path
        The file to be written.
    force : bool
        Whether it may take the place of a file that exists.

    Yields
    ------
    binary file, open for writing

    Raises
    ------
    OutputError
        As `check_writable` does.
    """
    check_writable(path, force)
    target = Path(os.path.realpath(path))  # a link stays a link
    temporary = target.with_name(f".gppcs-{secrets.token_hex(8)}.part")
    try:
        with open(temporary, "xb") as file:  # unlike tempfile's, these permissions follow the umask
            yield file
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
