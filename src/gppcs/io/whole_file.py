"""Writes files that appear only when they are complete."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from gppcs.engine.unfinished import unfinished
from gppcs.errors import OutputError
from gppcs.io.vpc import files_of

STANDARD = "-"  # The path of standard input and standard output.


def is_standard(path: str | os.PathLike[str]) -> bool:
    """Return whether a path stands for standard input or output."""
    return os.fspath(path) == STANDARD


def check_writable(path: str | os.PathLike[str], force: bool = False, makes_folders: bool = False) -> None:
    """Check that a file, or standard output, can be written. Call it before long work."""
    if is_standard(path):
        return
    target = Path(path)
    folder = Path(os.path.realpath(target)).parent
    while makes_folders and not folder.exists():
        folder = folder.parent
    if target.exists() and not target.is_file():
        raise OutputError(f"{target}: expected a file, found a folder or device; choose another name")
    if target.exists() and not force:
        raise _exists(target)
    if not folder.is_dir():
        found = "a file" if folder.exists() else "none"
        raise OutputError(f"{target}: expected a folder {folder}, found {found}; make it or choose another")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{target}: expected a writable folder {folder}, found no permission; choose another")


def check_distinct(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Check that no output of a command is one of its inputs or another output. Call it before any work."""
    sources = [file for path in inputs if not is_standard(path) for file in (path, *files_of(path))]
    known = {_identity(source): source for source in sources}
    read = set(known)
    for output in (output for output in outputs if not is_standard(output)):
        identity = _identity(output)
        other = known.setdefault(identity, output)
        if identity in read:
            raise OutputError(
                f"{output}: expected a file other than the input {other}, found the same; choose another name"
            )
        if other is not output:
            raise OutputError(
                f"{output}: expected a file for this result alone, found {other} again; choose another name"
            )


def _identity(path: Path) -> tuple[int, int] | str:
    """Return what is equal for two paths if and only if they lead to the same file."""
    try:
        status = path.stat()
    except OSError:
        return os.path.normcase(os.path.realpath(path))
    return status.st_dev, status.st_ino


@contextmanager
def whole_file(path: str | os.PathLike[str], force: bool = False) -> Iterator[BinaryIO]:
    """Open a file for writing that appears under its name only when it is complete.

    The content goes to a temporary file in the same folder. If the block ends without an exception, that file is
    renamed to the target; otherwise it is removed. A file that replaces another keeps the other's permissions.
    """
    check_writable(path, force)
    target = Path(os.path.realpath(path))  # so that a symbolic link stays one
    temporary = target.with_name(f".gppcs-{secrets.token_hex(8)}.part")
    with unfinished(str(temporary)):
        with open(temporary, "x+b") as file:  # permissions follow the umask, unlike those of tempfile
            with suppress(OSError):  # there is no file to replace, or its file system stores no permissions
                shutil.copymode(target, temporary)
            yield file
        if force:
            os.replace(temporary, target)
        else:
            _rename_to_new(temporary, target)


def _rename_to_new(temporary: Path, target: Path) -> None:
    """Rename a file. Of several processes that do so at the same time with one target, exactly one succeeds."""
    try:
        os.link(temporary, target)
    except FileExistsError as error:
        raise _exists(target) from error
    except OSError:  # the file system has no hard links
        try:
            open(target, "xb").close()
        except FileExistsError as error:
            raise _exists(target) from error
        try:
            os.replace(temporary, target)
        except BaseException:
            target.unlink()
            raise


def _exists(target: Path) -> OutputError:
    return OutputError(f"{target}: expected a new file, found one; choose another name, or overwrite it with force")
