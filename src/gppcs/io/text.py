"""Reads and writes tables as text: XYZ, TXT, ASC, CSV and PTS.

- The first row sets the delimiter: semicolon, comma, or whitespace. If tabs stand between all fields, text may contain
  spaces.
- Names of columns come from a header line, or from a comment line (`#` or `//`) that contains x, y and z and has one
  name for each column. R, G and B become `red`, `green` and `blue`.
- Without names, the first three columns are the coordinates, and the others become `column_4`, `column_5` and so on. In
  PTS files with 4, 6 or 7 columns they become `intensity`, `red green blue`, or all four.
- A single whole number before the first row is the number of points.
- A column is text if any of its fields is neither a number nor missing, or is in quotes while the coordinates are not.
  All rows count, so that chunks agree. Missing numbers, empty or NA, are NaN.
- Colours of whole numbers up to 255 become uint8. Other columns of whole numbers become int64, or uint64 if they need
  it, and all others float64.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from io import BufferedReader
from itertools import islice
from typing import BinaryIO

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, cloud_of_columns, coordinate_names
from gppcs.errors import FileFormatError, InputError
from gppcs.io.columns import columns_of, default_names
from gppcs.io.format import Format, Reader, from_start, keeping
from gppcs.io.rows import as_count, as_found, at_most, lines_of, number_blocks, write_rows
from gppcs.io.text_fields import MISSING, TextApart, delimiter_of, fields_of, is_number, is_row, text_columns

_OF_NUMBERS = b"0123456789+-.eE,;\t \r\n"  # and what stands between them
_LOOK = 1 << 22  # bytes at once
_PTS_EXTRAS = {4: ["intensity"], 6: ["red", "green", "blue"], 7: ["intensity", "red", "green", "blue"]}


@dataclass
class _Layout:
    """What the lines before the first row say, and the layout of that row."""

    names: list[str] | None = None
    names_line: int = 0
    count: int | None = None
    first_row: str = ""
    first_line: int = 0
    delimiter: str | None = None
    width: int = 0


def read_table(
    names_of_width: Callable[[int], list[str]],
    file: BufferedReader,
    rows: int,
    attributes: bool,
    columns: list[str] | None = None,
) -> Iterator[PointCloud]:
    """Read a table in chunks; `columns` are names in place of any in the file."""
    for table in map(_with_byte_colours, _tables(file, names_of_width, columns)):
        kept = list(table) if attributes else coordinate_names(table)
        yield from at_most(rows, [cloud_of_columns({name: table[name] for name in kept})])


def _names_in_pts(width: int) -> list[str]:
    return [*default_names(3), *_PTS_EXTRAS.get(width, default_names(width)[3:])]


def _tables(
    file: BufferedReader, names_of_width: Callable[[int], list[str]], given: list[str] | None = None
) -> Iterator[dict[str, Column]]:
    """Yield the columns of each block of rows by name; of a file without rows, empty ones."""
    lines = lines_of(file)
    layout = _layout(lines, given)
    names = layout.names or names_of_width(layout.width)
    if not layout.first_row:
        if layout.count:
            raise FileFormatError(f"expected {layout.count} points, found none; get the whole file again")
        yield {name: np.empty(0) for name in names}
        return
    lines.close()
    plain = not _has_words(file, layout)
    apart = None if plain else _text_apart(file, layout, names)
    file.seek(0)
    lines = lines_of(file)
    rows = islice(lines, layout.first_line - 1, None)
    if apart is None and layout.delimiter == "\t":
        layout.delimiter = None  # then further whitespace does no harm
    blocks = number_blocks(
        apart.numbers(rows, layout.first_line) if apart else rows,
        layout.first_line,
        str.strip if plain else _numbers,
        delimiter=layout.delimiter,
        width=layout.width - len(apart.taken() if apart else ()),
        count=layout.count,
    )
    for columns in blocks:
        texts = apart.taken() if apart else {}
        numbers = iter(columns)
        yield {name: texts[i] if i in texts else next(numbers) for i, name in enumerate(names)}
    if any(map(is_row, rows)):
        raise FileFormatError(f"expected {layout.count} points, as the file says, found more")


def _text_apart(file: BufferedReader, layout: _Layout, names: list[str]) -> TextApart | None:
    """Return what takes text and missing numbers out of the rows, or None if numpy can read the rows as they are."""
    file.seek(0)
    lines = lines_of(file)
    rows = (fields_of(line, layout.delimiter) for line in islice(lines, layout.first_line - 1, None) if is_row(line))
    texts = text_columns(rows, layout.width, _axes(names))
    lines.close()
    return None if texts is None else TextApart(texts, layout.width, layout.delimiter)


def _has_words(file: BufferedReader, layout: _Layout) -> bool:
    """Return whether rows may hold anything but numbers: a quick look at the bytes of a file."""
    file.seek(0)
    for _ in range(layout.first_line - 1):
        if b"\r" in file.readline().rstrip(b"\r\n"):  # lines end as in old files of Macintosh: look at all of them
            return True
    mark = (layout.delimiter or "").encode()
    empty = re.compile(rb"(?:^|%b)[ ]*(?:%b|\r?$)" % (mark, mark), re.MULTILINE) if mark else None
    for lines in iter(lambda: file.readlines(_LOOK), []):
        block = b"".join(lines)
        if block.translate(None, _OF_NUMBERS):
            return True
        if empty and any(found[0].strip(b" \r") for found in empty.finditer(block)):  # a field, not a line
            return True
    return False


def _with_byte_colours(columns: dict[str, Column]) -> dict[str, Column]:
    """Return columns with colours as uint8, the type in which other programs expect them, if they fit."""
    colours = [name for name in ("red", "green", "blue", "alpha") if name in columns]
    if len(colours) < 3 or "alpha" in colours[:3]:
        return columns
    fit = all(
        columns[name].dtype.kind == "i" and columns[name].min() >= 0 and columns[name].max() <= 255 for name in colours
    )
    return {name: values.astype(np.uint8) if fit and name in colours else values for name, values in columns.items()}


def _numbers(line: str) -> str:
    return line if is_row(line) else ""


def _layout(lines: Iterator[str], given: list[str] | None) -> _Layout:
    """Read the lines up to the first row of numbers."""
    layout = _Layout(names=given)
    commented: list[str] = []
    for number, line in enumerate(lines, 1):
        fields = _fields(line.lstrip("#/ \t"))
        if not is_row(line):
            commented = fields if _are_names(fields) else commented
        elif len(fields) == 1 and layout.count is None and as_count(fields[0]) is not None:
            layout.count = as_count(fields[0])
        elif all(map(is_number, fields)) or _has_coordinates(fields, layout.names or commented):
            layout.first_row, layout.first_line = line, number
            layout.delimiter, layout.width = delimiter_of(line), len(fields)
            break
        elif given is None:
            layout.names, layout.names_line = _header(fields, number, line), number
        elif layout.names_line:
            raise FileFormatError(f"line {number}: expected numbers as x, y and z, found {as_found(line)}")
        else:  # names that the given ones replace
            layout.names_line = number
    if layout.names is None and commented and len(commented) == (layout.width or len(commented)):
        layout.names = commented
    _check_width(layout, given)
    if layout.names is not None and given is None:
        layout.names = _with_colours_in_full(layout.names)
    return layout


def _are_names(fields: list[str]) -> bool:
    """Return whether a comment may be a header."""
    return {"x", "y", "z"} <= {name.lower() for name in fields} and len(set(fields)) == len(fields)


def _has_coordinates(fields: list[str], names: list[str]) -> bool:
    """Return whether a line is a row, although not all of its fields are numbers."""
    if len(names) == len(fields):
        return all(is_number(fields[i]) or fields[i] in MISSING for i in _axes(names)) and any(map(is_number, fields))
    return len(fields) >= 3 and all(map(is_number, fields[:3]))


def _axes(names: list[str]) -> list[int]:
    return [names.index(axis) for axis in coordinate_names(names)]


def _with_colours_in_full(names: list[str]) -> list[str]:
    """Return names with red, green and blue for R, G and B."""
    colours = {"r": "red", "g": "green", "b": "blue"}
    lower = [name.lower() for name in names]
    if not all(lower.count(letter) == 1 and colour not in names for letter, colour in colours.items()):
        return names
    return [colours.get(name.lower(), name) for name in names]


def _check_width(layout: _Layout, given: list[str] | None) -> None:
    if not layout.first_row:
        layout.width = 3
        return
    if layout.width < 3:
        raise FileFormatError(
            f"line {layout.first_line}: expected at least three numbers, found {as_found(layout.first_row)}"
        )
    if given is not None and len(given) != layout.width:
        raise FileFormatError(
            f"line {layout.first_line} has {layout.width} columns, but {len(given)} names are given "
            f"({', '.join(given)}); give one name for each column"
        )
    if layout.names is not None and len(layout.names) != layout.width:
        raise FileFormatError(
            f"line {layout.names_line} names {len(layout.names)} columns, "
            f"but line {layout.first_line} has {layout.width} numbers; write one name for each column"
        )


def _header(fields: list[str], number: int, line: str) -> list[str]:
    names = [name or f"column_{i}" for i, name in enumerate(fields, 1)]
    try:
        coordinate_names(names)
    except InputError as error:
        raise FileFormatError(
            f"line {number}: expected numbers, or names of columns with x, y, z, found {as_found(line)}"
        ) from error
    repeated = next((name for name in names if names.count(name) > 1), None)
    if repeated is not None:
        raise InputError(f"line {number}: expected different names, found {repeated!r} twice")
    return names


def _fields(line: str) -> list[str]:
    return [field.strip("\"'") for field in fields_of(line, delimiter_of(line))]


def _write(head: Callable[[PointCloud, Iterable[str]], str], separator: str, file: BinaryIO, cloud: PointCloud) -> None:
    """Write what `head` returns for the names of the columns, then numbers and quoted text."""
    columns = columns_of(cloud)
    file.write(head(cloud, columns).encode())
    write_rows(file, list(columns.values()), separator)


def _numbers_and_text(cloud: PointCloud) -> PointCloud:
    """Return a cloud as XYZ and CSV files store it."""
    return keeping(
        cloud, lambda name, values: values.dtype.kind in "biufU" and 0 not in values.shape[1:], plain_names=True
    )


def _usual_in_pts(cloud: PointCloud) -> PointCloud:
    """Return a cloud with those attributes that PTS files may have."""
    numbers = {name for name, values in cloud.attributes.items() if values.dtype.kind in "biuf" and values.ndim == 1}
    kept = next((names for names in sorted(_PTS_EXTRAS.values(), key=len, reverse=True) if numbers >= set(names)), [])
    return replace(cloud, attributes={name: cloud.attributes[name] for name in kept}, header=None)


def _format(
    name: str,
    suffixes: tuple[str, ...],
    head: Callable[[PointCloud, Iterable[str]], str],
    separator: str = " ",
    names_of_width: Callable[[int], list[str]] = default_names,
    stored: Callable[[PointCloud], PointCloud] = _numbers_and_text,
) -> Format:
    def opened(file: BufferedReader, columns: list[str] | None = None) -> Reader:
        return Reader(partial(from_start, partial(read_table, names_of_width), file, columns=columns))

    return Format(
        name, suffixes, opened, partial(_write, head, separator), stored=stored, options=frozenset({"columns"})
    )


FORMATS = (
    _format(
        "XYZ",
        (".xyz", ".txt", ".asc"),
        lambda cloud, names: f"# {' '.join(names)}\n" if cloud.attributes else "",
    ),
    _format("CSV", (".csv",), lambda cloud, names: f"{','.join(names)}\n", ","),
    _format("PTS", (".pts",), lambda cloud, names: f"{len(cloud)}\n", " ", _names_in_pts, _usual_in_pts),
)
