"""Reads rows of numbers in text files, and writes rows as text or as records of bytes."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from io import BufferedReader, TextIOWrapper
from itertools import islice, pairwise
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import EXACT, Column, check_coordinate, coordinate_names
from gppcs.errors import FileFormatError
from gppcs.io.format import Span
from gppcs.io.text_fields import quoted

BLOCK = 1 << 16  # rows per block: large enough that NumPy's cost per call does not count, small enough for memory

Block = tuple[list[str], NDArray[np.float64]]

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


def number_blocks(
    lines: Iterator[str],
    first_line: int,
    numbers_of: Callable[[str], str],
    *,
    delimiter: str | None = None,
    width: int | None = None,
    count: int | None = None,
    what: str = "point",
) -> Iterator[Block]:
    """Read lines of numbers, block by block.

    Shapes: returns values (n, width).
    """
    done = 0
    while batch := list(islice(lines, BLOCK if count is None else min(BLOCK, count - done))):
        texts = [text for text in map(numbers_of, batch) if text]
        if texts:
            try:
                values = np.loadtxt(texts, delimiter=delimiter, comments=None, ndmin=2)
            except ValueError:
                values = np.empty((0, 0))
            width = width or values.shape[1]
            if len(values) != len(texts) or values.shape[1] != width:
                bad, row, expected = _first_bad_line(batch, numbers_of, delimiter, width)
                if count is not None and not batch[bad].endswith("\n"):
                    raise ends_early(what, done + row, count)
                raise FileFormatError(f"line {first_line + bad}: expected {expected}, found {as_found(batch[bad])}")
            yield texts, values
        done += len(texts)
        first_line += len(batch)
    if count is not None and done < count:
        raise ends_early(what, done, count)


def _first_bad_line(
    batch: list[str], numbers_of: Callable[[str], str], delimiter: str | None, width: int
) -> tuple[int, int, str]:
    """Return the first malformed line of a batch, its row, and a description of what was expected there."""
    row = 0
    for i, text in enumerate(map(numbers_of, batch)):
        if text:
            try:
                found = np.loadtxt([text], delimiter=delimiter, comments=None, ndmin=2).shape[1]
            except ValueError:
                found = 0
            width = width or found
            if not found or found != width:
                return i, row, f"{width} numbers" if width else "numbers"
            row += 1
    raise AssertionError("NumPy refused a batch of lines but accepted each of them")


def typed_columns(texts: Sequence[str], values: Column, delimiter: str | None) -> list[Column]:
    """Split a block of `number_blocks` into columns of whole numbers and of floating-point numbers.

    Shapes: values (n, width); returns (n,).
    """
    first = texts[0].split(delimiter)
    return [
        _typed(values[:, i], texts, i, delimiter, _WHOLE.fullmatch(first[i]) is not None) for i in range(len(first))
    ]


def _typed(values: Column, texts: Sequence[str], index: int, delimiter: str | None, begins_whole: bool) -> Column:
    large = np.abs(values) >= EXACT
    if large.any():  # float64 may have rounded these, so read the digits again
        return _exact(values, [text.split(delimiter)[index] for text in texts], np.flatnonzero(large))
    return values.astype(np.int64) if begins_whole and np.array_equal(values, np.rint(values)) else values


def _exact(values: Column, words: Sequence[str], large: NDArray[np.intp]) -> Column:
    """Return a column as integers if all words are, else as float64 if that rounds none of the large integers."""
    for dtype in (np.int64, np.uint64):
        with suppress(ValueError, OverflowError):
            return np.array([int(word) for word in words], dtype)
    for i in large:
        if _WHOLE.fullmatch(words[i]) and (len(words[i]) > _MOST_DIGITS or int(words[i]) != float(values[i])):
            raise _rounded(words[i].strip())
    return values


def _rounded(word: str) -> FileFormatError:
    return FileFormatError(
        "expected columns of whole numbers that int64, uint64 or float64 holds exactly, found one that none does, with "
        f"{as_found(word)}; write this with a decimal point if it may be rounded"
    )


def at_most(rows: int, clouds: Iterable[PointCloud]) -> Iterator[PointCloud]:
    """Yield clouds, cut into chunks of at most so many rows."""
    for cloud in clouds:
        for start in range(0, max(len(cloud), 1), rows):
            yield cloud if len(cloud) <= rows else cloud[start : start + rows]


def equal_spans(file: BufferedReader, record_size: int, count: int, rows: int) -> list[Span]:
    """Divide the records of a file, which is at the first, into spans of so many; the last may be twice as long.

    A file that ends before its last record is not divided.
    """
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
    whole = bytes_left(file) // max(1, record.itemsize)
    if whole < count:
        raise ends_early(what, whole, count)
    if span:
        file.seek(span[0] * record.itemsize, os.SEEK_CUR)
        count = span[1] - span[0]
    axes = coordinate_names(record.names or ())
    types = [(name, *_type_and_shape(record[name])) for name in record.names or () if name in kept and name not in axes]
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


def _type_and_shape(dtype: np.dtype[Any]) -> tuple[np.dtype[Any], tuple[int, ...]]:
    return dtype.subdtype or (dtype, ())


def write_records(file: BinaryIO, columns: Sequence[tuple[Column, np.dtype[Any]]]) -> None:
    """Write columns as packed little-endian records, one for each point, block by block.

    Shapes: columns (N, ...).
    """
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
    """Write columns as lines of text.

    Shapes: columns (N,).
    """
    for start in range(0, len(columns[0]), BLOCK):
        fields = (texts_of(column[start : start + BLOCK]) for column in columns)
        file.writelines(f"{prefix}{separator.join(row)}\n".encode() for row in zip(*fields, strict=True))


def texts_of(values: Column) -> list[str]:
    """Return each value as the shortest text that reads back as the same value of the same type.

    Shapes: values (N,).
    """
    if values.dtype.kind == "U":
        return list(map(quoted, values.tolist()))
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    if values.dtype.kind == "f" and values.dtype != np.float64:
        return list(map(str, values))  # str of a NumPy number is the shortest text for its own type
    return list(map(repr, values.tolist()))
