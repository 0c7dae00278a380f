"""Opens files to read and to write: plain and compressed ones, standard input and output."""

import gzip
import hashlib
import os
import platform
import re
import secrets
import shutil
import sys
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from gppcs.errors import FileFormatError, OutputError
from gppcs.io.remote import NO_SPACE, address_of, open_remote
from gppcs.io.rows import check_unpacked
from gppcs.io.vpc import files_of


def is_standard(path: str | os.PathLike[str]) -> bool:
    """Return whether a path stands for standard input or output."""
    return os.fspath(path) == "-"


def without_query(path: Path) -> Path:
    """Return the path of a file without the query of an address, such as a key."""
    return Path(path.as_posix().partition("?")[0]) if address_of(path) else path


def inner_name(path: Path) -> Path:
    """Return the name of a file without the suffix of its compression, and without the query of an address."""
    path = without_query(path)
    return path.with_suffix("") if path.suffix.lower() == ".gz" else path


def plain_input(path: Path, stream: Any = None) -> Any:
    """Open a file by its path, address or an open stream; what one cannot seek in is copied to a temporary file.

    The path `-` is standard input.
    """
    if stream is not None:
        start = stream.tell() if getattr(stream, "seekable", bool)() else None
        file = _copied(stream)
        if start is not None:
            stream.seek(start)  # to be read again
        elif not file.peek(1):
            file.close()
            raise FileFormatError("expected bytes, found none: it is empty or was read before; open it anew")
    elif address := address_of(path):
        file = open_remote(address)
    elif path.exists() and not path.is_file():
        raise FileFormatError("expected a file, found a folder or device; name a file")
    elif not is_standard(path):
        file = path.open("rb")
    elif sys.stdin is None or sys.stdin.buffer.closed:
        raise FileFormatError("expected standard input, found that it is closed or was read before; name it once")
    else:
        with sys.stdin.buffer as standard:
            file = _copied(standard)
    if file.peek(2).startswith(b"\x1f\x8b"):
        with file:
            try:
                file = _copied(gzip.GzipFile(fileobj=file), file)
            except (EOFError, zlib.error, gzip.BadGzipFile) as error:
                raise FileFormatError(f"expected whole gzip data, but {error}; get the file again") from error
    start = file.peek(1024)[:1024]
    if re.fullmatch(rb"[\t\x20-\x7e]*\r[\t\r\x20-\x7e]*", start) and b"format binary" not in start:
        with file:  # text whose lines end as in old Mac OS
            return _copied(BytesIO(file.read().replace(b"\r", b"\n")))
    return file


def _copied(stream: Any, packed: Any = None) -> Any:
    """Return a temporary file with the content of a stream, which may unpack a file."""
    with ExitStack() as stack:
        copy = stack.enter_context(tempfile.TemporaryFile())
        while block := stream.read(1 << 20):
            if not isinstance(block, bytes):
                raise FileFormatError(f"expected a file of bytes, found one of {type(block).__name__}; open it as 'rb'")
            copy.write(block)
            if packed:
                check_unpacked(copy.tell(), packed.tell(), spare=1 << 24)  # text takes minutes a gigabyte
        copy.seek(0)
        stack.pop_all()
    return copy


def check_writable(path: str | os.PathLike[str], force: bool = False, makes_folders: bool = False) -> None:
    """Check that a file, or standard output, can be written. Call it before long work."""
    if is_standard(path):
        if sys.stdout is None or getattr(sys.stdout, "name", "") == os.devnull:  # as the command has it
            raise OutputError("expected standard output, found that it is closed; name a file")
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
        actual = "a file" if folder.exists() else "none"
        raise OutputError(f"{target}: expected a folder {folder}, found {actual}; make it or choose another")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{target}: expected a writable folder {folder}, found no permission; choose another")


def check_distinct(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Check that no output of a command is one of its inputs or another output. Call it before any work."""
    sources = {os.path.realpath(file) for path in inputs for file in (path, *files_of(path)) if not is_standard(path)}
    targets = set[str]()
    for output in outputs:
        target = os.path.realpath(output)
        if target in sources:
            raise OutputError(f"{output}: expected a file that is no input, found an input; choose another name")
        if target in targets and not is_standard(output):
            raise OutputError(f"{output}: expected a file for each result, found one for two; choose another name")
        targets.add(target)


@contextmanager
def whole_output(path: str | os.PathLike[str], force: bool = False) -> Iterator[BinaryIO]:
    """Open a file, or standard output for `-`, to write. A file appears under its name only when it is complete.

    The content goes to a temporary file in the same folder. If the block ends without an exception, that file is
    renamed to the target; otherwise it is removed. A file that replaces another keeps the other's permissions.
    """
    check_writable(path, force)
    if is_standard(path):
        with tempfile.TemporaryFile() as plain:
            yield plain
            plain.seek(0)
            shutil.copyfileobj(plain, sys.stdout.buffer)
            sys.stdout.buffer.flush()
        return
    target = Path(os.path.realpath(path))  # so that a symbolic link stays one
    start = f".gppcs-{hashlib.blake2b(f'{platform.node()}/{target.name}'.encode(), digest_size=8).hexdigest()}"
    _remove_left_over(target.parent.glob(f"{start}-*.part"))
    temporary = target.with_name(f"{start}-{os.getpid()}-{secrets.token_hex(4)}.part")
    try:
        with open(temporary, "x+b") as file:  # permissions follow the umask, unlike those of tempfile
            with suppress(OSError):  # there is no file to replace, or its file system stores no permissions
                shutil.copymode(target, temporary)
            if Path(path).suffix.lower() == ".gz":
                with tempfile.TemporaryFile() as plain:
                    yield plain
                    plain.seek(0)
                    with gzip.GzipFile("", "wb", fileobj=file, mtime=0) as packed:  # the same content, the same bytes
                        shutil.copyfileobj(plain, packed)
            else:
                yield file
        if target.exists() and not force:  # it has appeared meanwhile
            raise _exists(target)
        os.replace(temporary, target)
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        expected = f"{path}: expected space for the whole file, but {error.strerror}"
        folders = f"{target.parent} and in {tempfile.gettempdir()}, where parts may lie meanwhile"
        raise OutputError(f"{expected}; free some in {folders}, or write to another disk") from error
    finally:
        temporary.unlink(missing_ok=True)


def _remove_left_over(paths: Iterable[Path]) -> None:
    """Remove temporary files of processes that have ended."""
    for path in paths:
        import psutil

        with suppress(OSError):  # without /proc
            if not psutil.pid_exists(int(path.name.split("-")[2])):
                path.unlink()


def _exists(target: Path) -> OutputError:
    return OutputError(f"{target}: the file exists; choose another name, or overwrite it with `force=True`")
