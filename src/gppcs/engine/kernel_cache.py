"""Keep the compiled code of kernels in files whose names tell all that the code depends on.

The folders are that which NUMBA_CACHE_DIR names, `__pycache__` in the package, and the user's cache folder: compiled
code is read from all, and written to the first that can be written. Before them, code is looked for that came with the
package: it runs on every usual processor (`make dist`). Unpickling runs code, so a file counts only if no other user
can have written it. Processes that need the same kernel at once compile it once: a lock for each lies in one file.
"""

import contextlib
import functools
import hashlib
import os
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # on Windows, where processes may compile the same twice
    fcntl = None  # type: ignore[assignment]

PACKAGE = Path(__file__).parents[1]
SHIPPED = PACKAGE / "compiled"  # what `make dist` adds to the wheel
CHECKSUM_BYTES = 16
PATIENCE = 60.0  # Seconds after which a process that compiles a kernel counts as stopped.


@functools.cache
def folders() -> list[Path]:
    """Return the folders in which compiled kernels may be, in the order in which they are tried."""
    from numba import config

    parents = [PACKAGE / "__pycache__" / "kernels", _users_folder()]
    if named := config.CACHE_DIR:  # type: ignore[attr-defined]
        parents.insert(0, Path(named, "gppcs").absolute())
    return [parent / environment() for parent in parents]


def _users_folder() -> Path:
    """Return the folder for caches of this user."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or os.path.expanduser("~/AppData/Local"), "gppcs", "Cache")
    if sys.platform == "darwin":
        return Path(os.path.expanduser("~/Library/Caches/gppcs"))
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "gppcs")


@functools.cache
def environment() -> str:
    """Return the name of the folder for the versions of Python, of Numba, and of what compiles and keeps kernels."""
    import numba

    modules = (Path(__file__).with_name(f"{name}.py").read_bytes() for name in ("kernels", "numba_internals"))
    digest = hashlib.sha256(b"".join(modules)).hexdigest()[:8]
    return f"{sys.implementation.cache_tag}-numba-{numba.__version__}-{digest}"


@functools.cache
def folder_to_write() -> Path | None:
    """Return the folder that compiled kernels are written to, or None if they cannot be kept."""
    for folder in folders():
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            _remove_oldest(folder)
            return folder
    return None


def _remove_oldest(folder: Path) -> None:
    """Remove the code that was used longest ago, if there are more than about ten versions of all kernels."""
    with contextlib.suppress(OSError):
        files = sorted((entry.stat().st_mtime, entry.path) for entry in os.scandir(folder))
        if len(files) > 5000:
            for _, path in files[:-4000]:
                os.unlink(path)


def read(path: Path) -> bytes:
    """Return the code in a file; empty if there is none that was written whole, by this user or the administrator."""
    flags = (getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
    try:
        with open(os.open(path, sum(flags, os.O_RDONLY)), "rb") as file:
            content = file.read() if _is_trusted(os.fstat(file.fileno())) else b""
    except OSError:
        return b""
    with contextlib.suppress(OSError):  # the folder may be read-only
        os.utime(path)
    code = content[CHECKSUM_BYTES:]
    return code if content[:CHECKSUM_BYTES] == _checksum(path.name, code) else b""


def _is_trusted(status: os.stat_result) -> bool:
    """Return whether an open file is a plain one that only this user and the administrator can have written."""
    if not stat.S_ISREG(status.st_mode):
        return False
    writable = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return not hasattr(os, "geteuid") or (status.st_uid in (0, os.geteuid()) and not writable)


def write(path: Path, code: bytes) -> None:
    """Write code to a file so that no other process ever reads a part of it."""
    handle, part = tempfile.mkstemp(".nbc.part", dir=path.parent)
    try:
        with open(handle, "wb") as file:
            file.write(_checksum(path.name, code) + code)
        os.chmod(part, 0o644)  # whatever the umask; see `read`
        os.replace(part, path)
    except BaseException:
        os.unlink(part)
        raise


@contextlib.contextmanager
def lock(name: str, patience: float = PATIENCE) -> Iterator[bool]:
    """Wait until no other process holds the lock of that name, and hold it; false if that takes too long."""
    byte = int.from_bytes(hashlib.blake2b(name.encode(), digest_size=4).digest()) >> 2
    end = time.monotonic() + patience
    while not (is_held := _set_lock(byte, True)) and time.monotonic() < end:
        time.sleep(0.02)
    try:
        yield is_held
    finally:
        if is_held:
            _set_lock(byte, False)


def _set_lock(byte: int, is_held: bool) -> bool:
    """Lock or unlock a byte of the file of all locks; return whether no other process has locked it."""
    try:
        if (file := _locks()) is not None:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB if is_held else fcntl.LOCK_UN, 1, byte)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:  # this kind of file has no locks
        pass
    return True


@functools.cache
def _locks() -> int | None:
    """Open the file of all locks, if there can be one. To close it anywhere in this process would end its locks."""
    folder = folder_to_write()
    with contextlib.suppress(OSError):
        return os.open(folder / "locks", os.O_RDWR | os.O_CREAT, 0o644) if folder and fcntl else None
    return None


def _checksum(name: str, code: bytes) -> bytes:
    """Return a checksum: without it, the machine may have stopped before the whole file was on the disk."""
    return hashlib.blake2b(name.encode() + code, digest_size=CHECKSUM_BYTES).digest()
