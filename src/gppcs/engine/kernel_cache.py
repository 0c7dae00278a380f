"""Keep the compiled code of kernels in files whose names tell all that the code depends on.

Compiled code is read from all of these folders, and written to the first that can be written:

1. the folder that NUMBA_CACHE_DIR names,
2. `__pycache__` in the folder of the package,
3. the user's cache folder.

Before them, code is looked for that came with the package: it runs on every usual processor (`make dist`). Unpickling
runs code, so a folder counts only if no other user can have written into it.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import stat
import sys
import tempfile
import uuid
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
SHIPPED = PACKAGE / "compiled"  # what `make dist` adds to the wheel
MOST_FILES = 2500  # About ten versions of all kernels. When there are more, those used longest ago are removed.
FEWER_FILES = 2000
CHECKSUM_BYTES = 16
NO_LINK, NO_WAITING = getattr(os, "O_NOFOLLOW", 0), getattr(os, "O_NONBLOCK", 0)
BINARY = getattr(os, "O_BINARY", 0)


@functools.cache
def folders() -> list[Path]:
    """Return the folders in which compiled kernels may be, in the order in which they are tried."""
    from numba import config
    from numba.misc.appdirs import user_cache_dir

    places = [PACKAGE / "__pycache__" / "kernels", Path(user_cache_dir("gppcs", appauthor=False))]
    if named := config.CACHE_DIR:  # type: ignore[attr-defined]
        places.insert(0, Path(named, "gppcs").absolute())
    return [folder for place in places if _is_only_ours(folder := place / environment())]


def environment() -> str:
    """Return the name of the folder for the versions of Python and Numba."""
    import numba

    return f"{sys.implementation.cache_tag}-numba-{numba.__version__}"


@functools.cache
def folder_to_write() -> Path | None:
    """Return the folder that compiled kernels are written to, or None if they cannot be kept."""
    for folder in folders():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        _remove_oldest(folder)
        return folder
    return None


def _remove_oldest(folder: Path) -> None:
    """Remove the code that was used longest ago, if there is much."""
    with contextlib.suppress(OSError):
        files = [(entry.stat().st_mtime, entry.path) for entry in os.scandir(folder)]
        if len(files) > MOST_FILES:
            for _, path in sorted(files)[:-FEWER_FILES]:
                os.unlink(path)


def _is_only_ours(folder: Path) -> bool:
    """Tell whether only this user and the administrator can write into a folder or put another in its place."""
    if not hasattr(os, "geteuid"):
        return True
    folder = folder.resolve()
    for place in (folder, *folder.parents):
        try:
            status = place.stat()
        except FileNotFoundError:
            continue
        except OSError:
            return False
        by_others = status.st_mode & stat.S_IWOTH or (status.st_mode & stat.S_IWGRP and status.st_gid != os.getegid())
        if status.st_uid not in (0, os.geteuid()) or (by_others and not status.st_mode & stat.S_ISVTX):
            return False
    return True


def read(path: Path) -> bytes:
    """Return the code in a file; empty if there is none that was written whole, by this user or the administrator."""
    try:
        with open(os.open(path, os.O_RDONLY | NO_LINK | NO_WAITING | BINARY), "rb") as file:
            status = os.fstat(file.fileno())
            writable = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
            if not stat.S_ISREG(status.st_mode):
                return b""
            if hasattr(os, "geteuid") and (status.st_uid not in (0, os.geteuid()) or writable):
                return b""
            content = file.read()
    except OSError:
        return b""
    with contextlib.suppress(OSError):  # the folder may be read-only
        os.utime(path)
    code = content[CHECKSUM_BYTES:]
    return code if content[:CHECKSUM_BYTES] == _checksum(path.name, code) else b""


def write(path: Path, code: bytes) -> None:
    """Write code to a file so that no other process ever reads a part of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{uuid.uuid4().hex[:16]}.part")
    try:
        with open(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_LINK | BINARY, 0o600), "wb") as file:
            file.write(_checksum(path.name, code) + code)
            if hasattr(os, "fchmod"):
                os.fchmod(file.fileno(), 0o644)  # whatever the umask; see `read`
        os.replace(part, path)
    finally:
        with contextlib.suppress(OSError):
            part.unlink()


def _checksum(name: str, code: bytes) -> bytes:
    """Return a checksum: without it, the machine may have stopped before the whole file was on the disk."""
    return hashlib.blake2b(name.encode() + code, digest_size=CHECKSUM_BYTES).digest()
