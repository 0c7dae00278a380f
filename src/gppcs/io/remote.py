"""Opens files of servers by fsspec: of COPC files, only the ranges are fetched that are read; others are copied."""

import errno
import os
import shutil
import tempfile
import warnings
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from io import RawIOBase
from operator import itemgetter
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
    """Open a file of a server; its `name` is a number, as that of a temporary file."""
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
                file.seek(1)
                file.read(1)
            except ValueError:
                warnings.warn(f"{address}: the server sends no parts of files: all of it is read", stacklevel=2)
            else:
                ranges = _Ranges(file, address)
                stack.pop_all()
                return ranges
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
            expected = f"expected space for a copy in {tempfile.gettempdir()}"
            raise OSError(f"{address}: {expected}, but {error.strerror}; free some") from error
        reason = " ".join(f"{type(error).__name__} {error}".split())[:200]
        raise OSError(f"{address}: fsspec reports: {reason}; look at address, connection and credentials") from error


class _Ranges(RawIOBase):
    """A file of a server, in which one can seek. What was fetched is kept in a temporary file."""

    def __init__(self, file: Any, address: str) -> None:
        self._file, self._address, self._position = file, address, 0
        self._copy = tempfile.TemporaryFile()  # noqa: SIM115
        self.name = self._copy.fileno()
        self._parts: list[tuple[int, int, int]] = []  # where each begins and ends, ascending, and begins in the copy
        self._end = self._run = 0  # of the part that was fetched last, and how often what follows it was

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        self._position = offset + (0, self._position, self._file.size)[whence]
        return self._position

    def readinto(self, buffer: Any) -> int:
        first, last = self._position, min(self._position + len(buffer), self._file.size)
        with _answering(self._address):
            while self._position < last:
                begin, end, place = self._part_at(self._position, last)
                self._copy.seek(place + self._position - begin)
                part = self._copy.read(min(end, last) - self._position)
                start, self._position = self._position - first, self._position + len(part)
                buffer[start : start + len(part)] = part
        return self._position - first

    def _part_at(self, first: int, last: int) -> tuple[int, int, int]:
        """Return the part with the byte at a place. If there is none, fetch the bytes up to another, and some more."""
        after = bisect_right(self._parts, first, key=itemgetter(0))
        if after and first < self._parts[after - 1][1]:
            return self._parts[after - 1]
        self._run = self._run + 1 if first == self._end else 0
        self._file.seek(first)
        block = self._file.read(max(last - first, _FETCHED << min(self._run // 2, 9)))
        if len(block) < last - first:
            raise FileFormatError(f"expected {last - first:,} bytes, found {len(block):,}; get the file again")
        fetched = first, first + len(block), self._copy.seek(0, os.SEEK_END)
        self._copy.write(block)
        self._end = stop = fetched[1]
        met = slice(after, bisect_left(self._parts, stop, key=itemgetter(0)))  # of which all is fetched but the end
        ends = [(stop, end, place + stop - begin) for begin, end, place in self._parts[met] if end > stop]
        self._parts[met] = [fetched, *ends]
        return fetched

    def peek(self, size: int) -> bytes:
        """Return the next bytes, and stay before them."""
        position, content = self._position, self.read(size) or b""
        self._position = position
        return content

    def close(self) -> None:
        self._file.close()
        self._copy.close()
        super().close()
