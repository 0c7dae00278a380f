"""Opens files of servers by fsspec: of COPC files, only the ranges are fetched that are read; others are copied."""

import errno
import shutil
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from io import RawIOBase
from pathlib import Path
from typing import Any

from gppcs.engine.extras import require
from gppcs.errors import ADDRESS, FileFormatError, GppcsError, MissingExtraError, with_addresses
from gppcs.io.copc import is_copc

NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_FETCHED = 1 << 13  # bytes that are fetched at least, and more of a file that is read on and on
_TIMEOUTS = {"total": None, "sock_connect": 30.0, "sock_read": 60.0}  # seconds


def address_of(path: Path) -> str | None:
    """Return the address of a server's file that a path holds, which has lost a slash; None of a local file."""
    name = path.as_posix()
    if not ADDRESS.match(name) or path.exists():
        return None
    return with_addresses(name)


def open_remote(address: str) -> Any:
    """Open a file of a server; its `name` is a number if it is a copy."""
    core = require("fsspec.core", "files of servers need fsspec", "fsspec aiohttp", extra="remote")
    options: dict[str, Any] = {}
    with _answering(address), ExitStack() as stack:
        if is_web := address.startswith("http"):
            aiohttp = require("aiohttp", "files of web servers need aiohttp", extra="remote")
            options["client_kwargs"] = {"timeout": aiohttp.ClientTimeout(**_TIMEOUTS)}
        system, path = core.url_to_fs(address, **options)
        file = stack.enter_context(system.open(path, "rb", cache_type="none"))
        if is_copc(file.read(1024), 0):
            try:
                file.seek(1024)
                file.read(1)
            except ValueError:
                warnings.warn(f"{address}: the server sends no parts of files: all of it is read", stacklevel=2)
            else:
                stack.pop_all()
                return _Ranges(file, address)
        copy = stack.enter_context(tempfile.TemporaryFile())
        with system.open(path, "rb", **({"block_size": 0} if is_web else {})) as stream:
            shutil.copyfileobj(stream, copy, 1 << 20)
        size = getattr(file, "size", None)
        if size not in (None, copy.tell()):
            raise FileFormatError(f"expected {size:,} bytes, found {copy.tell():,}; get the file again")
        copy.seek(0)
        stack.pop_all()
        file.close()
        return copy


@contextmanager
def _answering(address: str) -> Iterator[None]:
    """Raise whatever the libraries for the many kinds of servers raise as an OSError."""
    try:
        yield
    except GppcsError:
        raise
    except ImportError as error:
        raise MissingExtraError(f"{address} needs another package: {error}") from error
    except Exception as error:
        if isinstance(error, OSError) and error.errno in NO_SPACE:
            folder = tempfile.gettempdir()
            raise OSError(
                f"{address}: expected space for a copy in {folder}, but {error.strerror}; free some"
            ) from error
        reason = " ".join(f"{type(error).__name__} {error}".split())[:200]
        raise OSError(f"{address}: fsspec reports: {reason}; look at address, connection and credentials") from error


class _Ranges(RawIOBase):
    """A file of a server, in which one can seek."""

    def __init__(self, file: Any, name: str) -> None:
        self._file, self.name, self._position = file, name, 0
        self._start, self._block, self._run = 0, b"", 0  # what was fetched last, and how often what follows it was

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        self._position = offset + (0, self._position, self._file.size)[whence]
        return self._position

    def readinto(self, buffer: Any) -> int:
        first, last = self._position, min(self._position + len(buffer), self._file.size)
        if first < last and not self._start <= first <= last <= self._start + len(self._block):
            follows = self._start <= first <= self._start + len(self._block)
            self._run = self._run + 1 if follows else 0
            with _answering(self.name):
                self._file.seek(first)
                self._start, self._block = first, self._file.read(max(last - first, _FETCHED << min(self._run // 2, 9)))
        part = self._block[first - self._start : last - self._start] if first < last else b""
        buffer[: len(part)] = part
        self._position += len(part)
        return len(part)

    def peek(self, size: int) -> bytes:
        """Return the next bytes, and stay before them."""
        position, content = self._position, self.read(size) or b""
        self._position = position
        return content

    def close(self) -> None:
        self._file.close()
        super().close()
