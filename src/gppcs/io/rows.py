"""Reads rows of numbers in text files, and writes rows as text or as records of bytes."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from csv import QUOTE_NONE
from io import BufferedReader, StringIO, TextIOWrapper
from itertools import islice, pairwise
from typing import Any, BinaryIO

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import EXACT, Column, check_coordinate, coordinate_names
from gppcs.errors import FileFormatError, GppcsError
from gppcs.io.format import Span
from gppcs.io.text_fields import is_number, quoted

BLOCK = 1 << 16  # rows per block: large enough that NumPy's cost per call does not count, small enough for memory

_MOST_DIGITS = 400  # more than any float64 has, and fewer than Python refuses to read
_WHOLE = re.compile(r"\s*[+-]?\d+\s*")


def lines_of(file: BufferedReader) -> Generator[str, None, None]:
    """Yield the rest of a file as lines of text."""
    text = TextIOWrapper(file, encoding="utf-8-sig", errors="replace")
    try:
        # "yield from" would close the file with the generator.
        for line in text:  # noqa: UP028
            yield line
    finally:
        if not file.closed:  # the caller closes the file
            text.detach()


def as_found(line: str) -> str:
    """Return a line in quotes for a message, shortened to 60 characters."""
    text = line.strip()
    return repr(text if len(text) <= 60 else text[:57] + "...")


def as_count(text: str) -> int | None:
    """Return the value of a text of decimal digits."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= 18 else None


def bytes_left(file: BufferedReader) -> int:
    """Return the number of bytes from the position in a file to its end."""
    return os.fstat(file.fileno()).st_size - file.tell()


def ends_early(what: str, index: int, count: int) -> FileFormatError:
    """Return the error for a file that ends early."""
    return FileFormatError(f"the file ends in {what} {index + 1} of {count}; get the whole file again")


@contextmanager
def reported(library: str, expected: str, errors: tuple[type[Exception], ...] = (Exception,)) -> Iterator[None]:
    """Raise the errors that a library raises for damaged files, and panics of Rust, as a FileFormatError."""
    try:
        yield
    except GppcsError:
        raise
    except BaseException as error:
        # A panic is no Exception, and its class cannot be imported.
        if not isinstance(error, errors) and type(error).__name__ != "PanicException":
            raise
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise FileFormatError(f"expected {expected}, but {library} reports: {reason}; get the file again") from error


def check_length(file: BufferedReader, record_size: int, count: int, what: str = "point") -> None:
    """Raise an error if a file, which is at the first of its records, does not have so many."""
    whole = bytes_left(file) // record_size if record_size else count
    if whole < count:
        raise ends_early(what, whole, count)


def number_blocks(
    lines: Iterator[str],
    first_line: int,
    numbers_of: Callable[[str], str],
    *,
    delimiter: str | None = None,
    width: int | None = None,
    count: int | None = None,
    what: str = "point",
) -> Iterator[list[Column]]:
    """Read lines of numbers, block by block, as columns of type int64, uint64 or float64.

    Without a line, one block is empty: of three columns if no width is given.
    """
    done = 0
    while batch := list(islice(lines, BLOCK if count is None else min(BLOCK, count - done))):
        texts = [text for text in map(numbers_of, batch) if text]
        if texts:
            columns = _columns(texts, delimiter)
            if columns is None or len(columns) != (width or len(columns)):
                bad, row, expected = _first_bad_line(batch, numbers_of, delimiter, width)
                if count is not None and not batch[bad].endswith("\n"):
                    raise ends_early(what, done + row, count)
                raise FileFormatError(f"line {first_line + bad}: expected {expected}, found {as_found(batch[bad])}")
            width = len(columns)
            yield columns
        done += len(texts)
        first_line += len(batch)
    if count is not None and done < count:
        raise ends_early(what, done, count)
    if not done:
        yield [np.empty(0, np.int64)] * (width or 3)


def _first_bad_line(
    batch: list[str], numbers_of: Callable[[str], str], delimiter: str | None, width: int | None
) -> tuple[int, int, str]:
    """Return the first malformed line of a batch, its row, and a description of what was expected there."""
    row = 0
    for i, text in enumerate(map(numbers_of, batch)):
        if text:
            words = text.split(delimiter)
            if not all(map(_is_number, words)) or len(words) != (width or len(words)):
                return i, row, f"{width} numbers" if width else "numbers"
            width, row = len(words), row + 1
    raise AssertionError("a batch of lines was refused, but each of them is good")


def _columns(texts: Sequence[str], delimiter: str | None) -> list[Column] | None:
    """Return the columns of lines of numbers, None if a line is malformed."""
    import pandas  # only here, as it is slow to load

    # The parser of later versions reads every number to its last digit anyway.
    exact: Any = {} if pandas.__version__ >= "3.1" else {"float_precision": "round_trip"}
    try:
        table = pandas.read_csv(
            StringIO("\n".join(texts)), sep=delimiter or r"\s+", header=None, quoting=QUOTE_NONE,
            na_values=["nan", "NaN"], keep_default_na=False, low_memory=False, **exact,
        )  # fmt: skip
    except ValueError:  # a line has more numbers than the first one
        return None
    columns = [table[i].to_numpy() for i in table]
    # What lacks at the end of a line is NaN, too.
    lacking = np.flatnonzero(np.isnan(columns[-1])).tolist() if columns[-1].dtype.kind == "f" else []
    if len(table) != len(texts) or any(len(texts[i].split(delimiter)) != len(columns) for i in lacking):
        return None
    if all(values.dtype.kind in "iu" or _is_exact(values) for values in columns):
        return columns
    words = [text.split(delimiter) for text in texts]
    if not all(len(row) == len(columns) and all(map(_is_number, row)) for row in words):
        return None
    return [_typed([row[i] for row in words]) for i in range(len(columns))]


def _is_exact(values: Column) -> bool:
    """Return whether a column is of numbers so small that reading them as float64 rounds no whole number."""
    return values.dtype.kind == "f" and not (np.abs(values) >= EXACT).any()


def _is_number(word: str) -> bool:
    """Return whether a word is a number as files have them: Python's may also have underscores."""
    return is_number(word) and "_" not in word


def _typed(words: Sequence[str]) -> Column:
    """Return numbers as integers if all are, else as float64 if that rounds none of the whole numbers."""
    for dtype in (np.int64, np.uint64):
        with suppress(ValueError, OverflowError):
            return np.array([int(word) for word in words], dtype)
    values = np.array(words, dtype=np.float64)
    for i in np.flatnonzero(np.abs(values) >= EXACT).tolist():
        if _WHOLE.fullmatch(words[i]) and (len(words[i]) > _MOST_DIGITS or int(words[i]) != float(values[i])):
            raise FileFormatError(
                "expected columns of whole numbers that int64, uint64 or float64 holds exactly, found one that none "
                f"does, with {as_found(words[i])}; write this with a decimal point if it may be rounded"
            )
    return values


def cast(values: Column, to: np.dtype[Any], what: str, done: int = 0) -> Column:
    """Return numbers, which `done` others precede, in a type that must represent whole ones; `what` says which."""
    if to.kind in "iu":
        bounds = np.iinfo(to)
        fits = (values == np.rint(values)) & (values >= bounds.min) & (values <= bounds.max)
        if not fits.all():
            row = int(np.argmin(fits))
            raise FileFormatError(f"expected {what} {done + row + 1}, found {as_found(str(values[row]))}")
    with np.errstate(over="ignore"):  # values beyond the range of float32 become infinite
        return values.astype(to)


def at_most(rows: int, clouds: Iterable[PointCloud]) -> Iterator[PointCloud]:
    """Yield clouds, cut into chunks of at most so many rows."""
    for cloud in clouds:
        for start in range(0, max(len(cloud), 1), rows):
            yield cloud if len(cloud) <= rows else cloud[start : start + rows]


def equal_spans(file: BufferedReader, record_size: int, count: int, rows: int) -> list[Span]:
    """Divide the records of a whole file, which is at the first, into spans; the last may be twice as long."""
    if bytes_left(file) < count * record_size:
        return []
    return list(pairwise([*range(0, max(1, count - rows + 1), rows), count]))


def read_records(
    file: BufferedReader,
    record: np.dtype[Any],
    count: int,
    rows: int,
    what: str,
    kept: Collection[str],
    span: Span | None = None,
) -> Iterator[PointCloud]:
    """Read packed records in chunks, with some of their fields, block by block: a block fits the processor's cache."""
    check_length(file, record.itemsize, count, what)
    if span:
        file.seek(span[0] * record.itemsize, os.SEEK_CUR)
        count = span[1] - span[0]
    axes = coordinate_names(record.names or ())
    types = [(name, *type_and_shape(record[name])) for name in record.names or () if name in kept and name not in axes]
    for start in range(0, max(count, 1), rows):
        n = min(rows, count - start)
        points = np.empty((n, 3))
        attributes = {name: np.empty((n, *shape), dtype.newbyteorder("=")) for name, dtype, shape in types}
        block = np.empty(min(n, BLOCK), record)
        for axis in axes if not n else ():
            check_coordinate(axis, block[axis])
        for first in range(0, n, BLOCK):
            part = block[: n - first]
            file.readinto(part.view(np.uint8).data)
            for axis, values in zip(axes, points.T, strict=True):
                check_coordinate(axis, part[axis])
                values[first : first + BLOCK] = part[axis]
            for name, values in attributes.items():
                values[first : first + BLOCK] = part[name]
        kind = np.result_type(*(record[axis] for axis in axes)).newbyteorder("=")
        yield PointCloud(points, attributes, kind)


def type_and_shape(dtype: np.dtype[Any]) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """Return the type and the shape of a field of a structured type."""
    return dtype.subdtype or (dtype, ())


def write_records(file: BinaryIO, columns: Sequence[tuple[Column, np.dtype[Any]]]) -> None:
    """Write columns (N, ...) as packed little-endian records, block by block."""
    count = len(columns[0][0])
    # The names of the fields are numbers: those of the columns may have characters that NumPy refuses in a buffer.
    names = [str(i) for i in range(len(columns))]
    fields = [(name, to.newbyteorder("<"), values.shape[1:]) for name, (values, to) in zip(names, columns, strict=True)]
    block = np.empty(min(count, BLOCK), fields)
    for start in range(0, count, BLOCK):
        part = block[: count - start]
        for name, (values, _) in zip(names, columns, strict=True):
            part[name] = values[start : start + BLOCK]
        file.write(part.data)


def write_rows(file: BinaryIO, columns: Sequence[Column], separator: str = " ", prefix: str = "") -> None:
    """Write columns (N,) as lines of text."""
    for start in range(0, len(columns[0]), BLOCK):
        fields = (texts_of(column[start : start + BLOCK]) for column in columns)
        file.writelines(f"{prefix}{separator.join(row)}\n".encode() for row in zip(*fields, strict=True))


def texts_of(values: Column) -> list[str]:
    """Return each value as the shortest text that reads back as the same value of its type, and of a list its size."""
    if values.dtype.hasobject:
        return [" ".join([str(len(each)), *texts_of(each)]) for each in values]
    if values.dtype.kind == "U":
        return list(map(quoted, values.tolist()))
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    if values.dtype.kind == "f" and values.dtype != np.float64:
        return list(map(str, values))  # str of a NumPy number is the shortest text for its own type
    return list(map(repr, values.tolist()))
