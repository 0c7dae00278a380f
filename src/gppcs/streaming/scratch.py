"""Folders for temporary files."""

from __future__ import annotations

import hashlib
import importlib
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gppcs.engine.unfinished import unfinished
from gppcs.errors import OutputError, ParameterError
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.whole_file import is_standard
from gppcs.streaming.sizes import size_of


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
        If there is no such parent, or too little space on its disk.
    """
    parent = Path(tempfile.gettempdir()) if parent is None else parent
    if not parent.is_dir():
        raise OutputError(f"{parent}: expected an existing folder for temporary files; make it, or name another")
    used = sum(file.stat().st_size for file in (parent / name).rglob("*")) if name else 0
    free = shutil.disk_usage(parent).free + used
    if free < size:
        found = f"{parent}: expected at least {size_of(size)} of disk space for temporary files, found {size_of(free)}"
        raise OutputError(
            f"{found}; name a folder with more by scratch=, or raise memory=",
            command=f"{found}; name a folder with more by --scratch, or raise --memory",
        )
    if name:
        (parent / name).mkdir(mode=0o700, exist_ok=True)
        yield parent / name
        shutil.rmtree(parent / name)
        return
    folder = tempfile.mkdtemp(prefix="gppcs-", dir=parent)
    with unfinished(folder):
        yield Path(folder)


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
