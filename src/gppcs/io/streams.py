"""Opens what is not a plain file: compressed files, standard input and standard output."""

from __future__ import annotations

import gzip
import os
import shutil
import sys
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, BinaryIO

from gppcs.errors import FileFormatError, OutputError
from gppcs.io.whole_file import check_writable, is_standard, whole_file

COMPRESSIONS = (".gz", ".zst")  # Suffixes of compressed files.
_GZIP, _ZSTANDARD = b"\x1f\x8b", b"\x28\xb5\x2f\xfd"  # The first bytes of such files.
_ZSTANDARD_CHUNK = 4096  # Bytes. They can decompress to 128 MB at most.


def inner_name(path: Path) -> Path:
    """Return the name of a file without the suffix of a compression."""
    return path.with_suffix("") if path.suffix.lower() in COMPRESSIONS else path


def suffix_in_words(suffix: str) -> str:
    """Return a suffix, or the lack of one, as messages show it."""
    return repr(suffix) if suffix else "a name without a suffix"


@contextmanager
def plain_input(path: Path) -> Iterator[tuple[Any, Path]]:
    """Open a file, or standard input for `-`, as a plain file: what is not one is first unpacked to a temporary one."""
    with _standard_input() if is_standard(path) else open(path, "rb") as file:
        head = file.read(4)
        file.seek(0)
        if not _is_compressed(head):
            yield file, path
            return
        with tempfile.TemporaryFile() as plain:
            _copy_plain(file, head, plain)
            plain.seek(0)
            yield plain, inner_name(path)


def _standard_input() -> IO[bytes]:
    """Return a temporary file with all of standard input, and close that."""
    if sys.stdin is None or sys.stdin.buffer.closed:
        raise FileFormatError("expected standard input, found that it is closed or was read before; name it once")
    copy = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
    with sys.stdin.buffer as stream:
        shutil.copyfileobj(stream, copy)
    copy.seek(0)
    return copy


def is_plain(path: Path) -> bool:
    """Return whether `plain_input` opens a file as it is, without a copy."""
    if is_standard(path):
        return False
    with open(path, "rb") as file:
        return not _is_compressed(file.peek(4)[:4])


def _is_compressed(head: bytes) -> bool:
    return head.startswith((_GZIP, _ZSTANDARD))


def _copy_plain(file: IO[bytes], head: bytes, plain: IO[bytes]) -> None:
    """Decompress a file that begins with `head` into another one."""
    if head.startswith(_GZIP):
        try:
            shutil.copyfileobj(gzip.GzipFile(fileobj=file), plain)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise FileFormatError(f"expected whole gzip data, but {error}; get the file again") from error
    else:
        _copy_zstandard(file, plain)


def _copy_zstandard(file: IO[bytes], plain: IO[bytes]) -> None:
    import zstandard

    frame = None
    data = file.read(_ZSTANDARD_CHUNK)
    while data:
        frame = frame or zstandard.ZstdDecompressor().decompressobj()
        try:
            plain.write(frame.decompress(data))
        except zstandard.ZstdError as error:
            raise FileFormatError(f"expected whole Zstandard data, but {error}; get the file again") from error
        data, frame = (frame.unused_data, None) if frame.eof else (b"", frame)
        data = data or file.read(_ZSTANDARD_CHUNK)
    if frame:
        raise FileFormatError("expected whole Zstandard data, but it ends early; get the file again")


@contextmanager
def whole_output(path: str | os.PathLike[str], force: bool = False) -> Iterator[BinaryIO]:
    """Open a file for writing that appears under its name only when it is complete."""
    suffix = Path(path).suffix.lower()
    if not is_standard(path) and suffix not in COMPRESSIONS:
        with whole_file(path, force) as file:
            yield file
        return
    check_writable(path, force)
    with tempfile.TemporaryFile() as plain:
        yield plain
        plain.seek(0)
        if is_standard(path):
            if sys.stdout is None:
                raise OutputError("expected standard output, found that it is closed; name a file")
            shutil.copyfileobj(plain, sys.stdout.buffer)
            sys.stdout.buffer.flush()
            return
        with whole_file(path, force) as file, _compressor(file, suffix) as compressed:
            shutil.copyfileobj(plain, compressed)


def _compressor(file: BinaryIO, suffix: str) -> Any:
    if suffix == ".gz":
        return gzip.GzipFile(filename="", mode="wb", fileobj=file, mtime=0)  # the same content gives the same bytes
    import zstandard

    return zstandard.ZstdCompressor().stream_writer(file, closefd=False)
