"""Lines of numbers in text files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from io import BufferedReader, TextIOWrapper
from itertools import islice
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import FileFormatError
from gppcs.io.columns import EXACT, Column

BLOCK = 1 << 16  # rows at a time: what numpy does per call is then small, and so is the memory

Block = tuple[list[str], NDArray[np.float64]]

_WHOLE = re.compile(r"\s*[+-]?\d+\s*")


def lines_of(file: BufferedReader) -> Iterator[str]:
    """Yield the rest of a file as lines of text, whatever their ends; bytes that are not UTF-8 are lost."""
    text = TextIOWrapper(file, encoding="utf-8-sig", errors="replace")
    try:
        yield from text
    finally:
        if not file.closed:  # the file is the caller's to close
            text.detach()


def shown(line: str) -> str:
    """Quote a line for a message, cut where it is long."""
    text = line.strip()
    return repr(text if len(text) <= 60 else text[:57] + "...")


def as_count(text: str) -> int | None:
    """Return the whole number that a text is, or None if it is none or has more than 18 digits."""
    return int(text) if text.isdecimal() and len(text) <= 18 else None


def ends_early(what: str, index: int, count: int) -> FileFormatError:
    """Say that a file ends within item `index` (from 0) of `count` promised ones."""
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

    Parameters
    ----------
    lines : iterator of str
        Lines with their ends. With `count`, no line after the last row is taken.
    first_line : int
        The number that the first of them has in the file, from 1, for messages.
    numbers_of : function of a line
        Returns the part of it that holds numbers, or an empty string if the line is to be passed by.
    delimiter : str, optional
        Separator of numbers; whitespace if not given.
    width : int, optional
        How many numbers a row has; as many as the first one if not given.
    count : int, optional
        How many rows there must be.
    what : str
        What a row is, for messages.

    Yields
    ------
    texts : list of n str
        The numbers of each row, as they stand in the file.
    values : (n, width) array, float64

    Raises
    ------
    FileFormatError
        If a line is not such a row, or lines are missing.
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
                raise FileFormatError(f"line {first_line + bad}: expected {expected}, found {shown(batch[bad])}")
            yield texts, values
        done += len(texts)
        first_line += len(batch)
    if count is not None and done < count:
        raise ends_early(what, done, count)


def _first_bad_line(
    batch: list[str], numbers_of: Callable[[str], str], delimiter: str | None, width: int
) -> tuple[int, int, str]:
    """Return which line of the batch is the first that is no row, its row, and what was expected there."""
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
    raise AssertionError("numpy refused lines that it takes one by one")


def typed_columns(texts: Sequence[str], values: Column, delimiter: str | None) -> list[Column]:
    """Split a block of `number_blocks` into columns, int64 where the file has whole numbers, else float64.

    A column counts as whole numbers if its first one is written without a point and all of them are whole.
    """
    first = texts[0].split(delimiter)
    return [
        _typed(values[:, i], texts, i, delimiter) if _WHOLE.fullmatch(first[i]) else values[:, i]
        for i in range(len(first))
    ]


def _typed(values: Column, texts: Sequence[str], index: int, delimiter: str | None) -> Column:
    if not np.array_equal(values, np.rint(values)):
        return values
    if np.abs(values).max() < EXACT:
        return values.astype(np.int64)
    try:  # float64 may have rounded: take the digits themselves
        return np.array([int(text.split(delimiter)[index]) for text in texts], dtype=np.int64)
    except (ValueError, OverflowError):
        return values


def write_rows(file: BinaryIO, columns: Sequence[Column], separator: str = " ", prefix: str = "") -> None:
    """Write columns as lines of text, each number as the shortest text that gives it back in its own type."""
    for start in range(0, len(columns[0]), BLOCK):
        fields = (_texts(column[start : start + BLOCK]) for column in columns)
        file.writelines(f"{prefix}{separator.join(row)}\n".encode() for row in zip(*fields, strict=True))


def _texts(values: Column) -> list[str]:
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    if values.dtype.kind == "f" and values.dtype != np.float64:
        return list(map(str, values))  # the shortest in that type, which Python's floats do not know
    return list(map(repr, values.tolist()))
