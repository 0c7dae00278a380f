"""Folders for temporary files."""

from __future__ import annotations

import hashlib
import importlib
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from gppcs.engine.locks import locks
from gppcs.engine.unfinished import unfinished
from gppcs.errors import OutputError, ParameterError
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.whole_file import is_standard
from gppcs.streaming.sizes import size_of

LOCK = "lock"  # a file in a folder that is kept; the process that works there has locked it


@contextmanager
def scratch_folder(parent: Path | None, size: int, name: str | None = None) -> Iterator[Path]:
    """Make a folder for temporary files, and remove it at the end of the block.

    Parameters
    ----------
    parent : path or None
        Where to make it; by default where the system keeps temporary files.
    size : int
        How many bytes it is going to take.
    name : str, optional
        If it is given, the folder has this name, may be there already, and stays if the block ends with an error.

    Yields
    ------
    path
        The folder.

    Raises
    ------
    OutputError
        If there is no such parent, too little space on its disk, or another process is at work in the folder.
    """
    parent = Path(tempfile.gettempdir()) if parent is None else parent
    if not parent.is_dir():
        raise OutputError(f"{parent}: expected an existing folder for temporary files; make it, or name another")
    if name:
        with _kept_folder(parent / name, size) as folder:
            yield folder
        return
    _check_space(parent, size)
    temporary = tempfile.mkdtemp(prefix="gppcs-", dir=parent)
    with unfinished(temporary):
        yield Path(temporary)


@contextmanager
def _kept_folder(folder: Path, size: int) -> Iterator[Path]:
    """Make a folder, unless it is there, for this process alone; remove it if the block ends without an error."""
    if not folder.exists():
        _check_space(folder.parent, size)  # before anything is made
    folder.mkdir(mode=0o700, exist_ok=True)
    with open(folder / LOCK, "w") as lock:
        if _is_locked(lock):
            found = (
                f"{folder}: expected no other run with the same files and parameters, found one under way; wait for it"
            )
            raise OutputError(
                f"{found}, or name another folder by scratch=",
                command=f"{found}, or name another folder by --scratch",
            )
        _check_space(folder.parent, size, sum(file.stat().st_size for file in folder.rglob("*")))
        yield folder
        for path in folder.iterdir():  # all but the lock, which not all systems remove while it is open
            if path.is_dir():
                shutil.rmtree(path)
            elif path.name != LOCK:
                path.unlink()
    shutil.rmtree(folder)


def _is_locked(file: IO[str]) -> bool:
    """Lock a file if that is possible, and return whether another run has done so before."""
    try:
        return not locks(file)
    except OSError:  # some file systems of networks have no locks; there, users must take care
        return False


def _check_space(parent: Path, size: int, used: int = 0) -> None:
    """Check that a disk has room for temporary files of a size, of which a part is there already."""
    free = shutil.disk_usage(parent).free + used
    if free < size:
        found = f"{parent}: expected at least {size_of(size)} of disk space for temporary files, found {size_of(free)}"
        raise OutputError(
            f"{found}; name a folder with more by scratch=, or raise memory=",
            command=f"{found}; name a folder with more by --scratch, or raise --memory",
        )


def work_name(files: CloudFiles, asked: object) -> str:
    """Return the name of a folder for some work, which is another if the files or the parameters are.

    Parameters
    ----------
    files : CloudFiles
        Their names, sizes and times of change count, their order, and how they are read.
    asked : object
        All that decides the result; its `repr` counts.

    Returns
    -------
    str

    Raises
    ------
    ParameterError
        If one of the files is standard input, which cannot be read again.
    """
    if any(is_standard(path) for path in files.paths):
        raise ParameterError("expected files to resume from, found standard input; write it to a file first")
    known = [(str(path.resolve()), path.stat().st_size, path.stat().st_mtime_ns) for path in files.paths]
    decisive = repr((known, files.settings, asked, importlib.import_module("gppcs").__version__))
    return f"gppcs-{hashlib.sha256(decisive.encode()).hexdigest()[:16]}"
