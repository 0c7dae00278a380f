"""Reads and writes tables as text: XYZ, TXT, ASC, CSV and PTS.

- The first row sets the delimiter: semicolon, comma, or whitespace. If tabs stand between all fields, text may contain
  spaces. Text in double quotes may contain the delimiter.
- A single whole number before the first row is the number of points.
- A column is text if one of its first fields is neither a number nor missing, or if its very first one is in quotes
  while the coordinates are not. Missing numbers, empty or NA, are NaN.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from io import BufferedReader
from itertools import islice
from typing import BinaryIO

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import COLOUR, coordinate_names
from gppcs.errors import FileFormatError
from gppcs.io import rows
from gppcs.io.columns import columns_of, default_names, with_byte_colours, with_digits
from gppcs.io.format import Format, Reader, keeping

MAX_COLUMNS = 4096  # pandas takes a millisecond for each

_NAMES = "names of columns, each once, with x, y, z"
# By these, a comment names columns.
_COLUMNS = {"lon", "lat", "longitude", "latitude", "easting", "northing", "height", "time", "intensity", "red"}
_COLMAP = "if the rows are points of COLMAP, name the format: `format='points3d.txt'`"
_PTS_ATTRIBUTES = {4: ["intensity"], 6: ["red", "green", "blue"], 7: ["intensity", "red", "green", "blue"]}


@dataclass
class _Preview:
    """What the lines up to the first row say."""

    names: list[str] | None  # of the columns, from a header line or as the caller says
    comment: Sequence[str] = ()  # names in a comment line
    count: int | None = None
    line: int = 0  # number of the first row's line, from 1 on; 0 without any row
    delimiter: str | None = None
    fields: Sequence[str] = ()  # of the first row, with their quotes


def open_table(
    file: BufferedReader, columns: list[str] | None = None, names_of_width: Callable[[int], list[str]] = default_names
) -> Reader:
    """Open a table; `columns` are names in place of any in the file."""
    preview = _preview(rows.lines_of(file), columns)
    names = _names(preview, columns, names_of_width)
    axes = coordinate_names(names)
    quoted = {i for i, field in enumerate(preview.fields) if field.startswith('"')}
    coordinates = {names.index(axis) for axis in axes}
    may_be_colmap = not (columns or preview.names or preview.comment) and _may_be_colmap(preview.fields)
    try:
        texts = rows.text_columns(_rows(file, preview), len(names), preview.delimiter) - coordinates
    except FileFormatError as error:
        raise FileFormatError(f"{error}; {_COLMAP}") if may_be_colmap else error from error
    texts |= set() if quoted & coordinates else quoted

    def chunks(n: int) -> Iterator[PointCloud]:
        # Without text, further whitespace beside tabs does no harm.
        delimiter = None if preview.delimiter == "\t" and not texts else preview.delimiter
        lines = _rows(file, preview)
        for block in rows.read_rows(lines, len(names), preview.count, delimiter=delimiter, texts=texts):
            cloud = PointCloud.from_columns(dict(zip(names, block, strict=True)))
            yield from rows.at_most(n, [with_byte_colours(cloud, "i")])
        if any(map(rows.is_row, lines)):
            raise FileFormatError(f"expected {preview.count} points, as the file says, found more")

    skipped = [f"tracks of images, {_COLMAP}"] if may_be_colmap else []
    are_bytes = all(field.isdecimal() and (rows.as_count(field) or 0) <= 255 for field in preview.fields[3:6])
    if names[3:6] == default_names(6)[3:] and are_bytes:
        columns_option = ",".join(["x", "y", "z", *COLOUR, *names[6:]])
        skipped.append(f"columns 4 to 6 as colours, which they may be: `columns='{columns_option}'` names them")
    return Reader(chunks, skipped=skipped)


def _may_be_colmap(fields: Sequence[str]) -> bool:
    """Return whether a row may be a point with a number, colours of 8 bits and a track of pairs of numbers."""
    colours = [rows.as_count(field) or 0 for field in fields[4:7]]
    are_whole = all(map(str.isdecimal, (*fields[:1], *fields[4:7], *fields[8:])))
    return len(fields) >= 10 and len(fields) % 2 == 0 and are_whole and max(colours) <= 255


def _preview(lines: Iterator[str], columns: list[str] | None) -> _Preview:
    """Read the lines up to the first row of numbers."""
    preview = _Preview(columns)
    has_header, other_names = False, (0, "", 0)  # a comment that names columns, but not x, y and z
    for number, line in enumerate(lines, 1):
        text = line.lstrip("#/ \t")
        fields = [field.strip("\"'") for field in rows.fields_of(text, _delimiter(text))]
        lower = {field.lower() for field in fields}
        are_names = {"x", "y", "z"} <= lower and len(set(fields)) == len(fields)
        if not rows.is_row(line):
            preview.comment = fields if are_names else preview.comment
            other_names = (number, line, len(fields)) if lower & _COLUMNS else other_names
        elif len(fields) == 1 and preview.count is None and rows.as_count(fields[0]) is not None:
            preview.count = rows.as_count(fields[0])
        elif all(map(rows.is_number, fields)) or _has_coordinates(fields, preview.names or preview.comment):
            preview.line, preview.delimiter = number, _delimiter(line)
            preview.fields = rows.fields_of(line, preview.delimiter)
            if not (preview.names or preview.comment) and other_names[2] == len(preview.fields):
                raise _unexpected(_NAMES, *other_names[:2])
            break
        elif has_header or not (are_names or columns):
            beside = "as x, y and z" if has_header else f"or {_NAMES}"
            raise _unexpected(f"numbers such as 1.5, {beside}", number, line)
        else:
            has_header = True
            preview.names = columns or [field or f"column_{i}" for i, field in enumerate(fields, 1)]
    return preview


def _unexpected(expected: str, number: int, line: str) -> FileFormatError:
    return FileFormatError(f"line {number}: expected {expected}, found {rows.shortened(line)}")


def _delimiter(line: str) -> str | None:
    """Return what separates the fields of a line; None is whitespace."""
    bare = re.sub(r'"(?:[^"]|"")*+"', '""', line).strip(" \r\n")
    for mark, minimum in ((";", 2), (",", 1), (";", 1)):
        if bare.count(mark) >= minimum:
            return mark
    parts = [part.split() for part in bare.split("\t")]
    # Between tabs stands one field, rather than none or several numbers.
    return (
        "\t" if len(parts) > 2 and all(len(part) == 1 or not all(map(rows.is_number, part)) for part in parts) else None
    )


def _has_coordinates(fields: list[str], names: Sequence[str]) -> bool:
    """Return whether a line is a row, although not all of its fields are numbers."""
    if len(names) != len(fields):
        return len(fields) >= 3 and all(map(rows.is_number, fields[:3]))
    axes = [fields[names.index(axis)] for axis in coordinate_names(names)]
    return all(rows.is_number(field) or field in rows.MISSING for field in axes) and any(map(rows.is_number, fields))


def _names(preview: _Preview, columns: list[str] | None, names_of_width: Callable[[int], list[str]]) -> list[str]:
    """Return the names of the columns; raise an error if they do not fit the first row."""
    width = len(preview.fields) or len(preview.names or preview.comment) or 3
    if width < 3:
        raise FileFormatError(
            f"line {preview.line}: expected at least three numbers, found {rows.shortened(' '.join(preview.fields))}"
        )
    if width > MAX_COLUMNS:
        raise FileFormatError(
            f"line {preview.line}: expected at most {MAX_COLUMNS:,} columns, found {width:,}; write a table with one "
            "point in each line, or a file of another format"
        )
    names = preview.names
    if names is None:
        names = list(preview.comment) if len(preview.comment) == width else names_of_width(width)
    if len(names) != width:
        raise FileFormatError(
            f"line {preview.line} has {width} columns, but {len(names)} have names ({', '.join(names)}); give one "
            "name for each column"
        )
    colours = {"r": "red", "g": "green", "b": "blue"}
    lower = [name.lower() for name in names]
    if columns or not all(lower.count(letter) == 1 and colour not in names for letter, colour in colours.items()):
        return names
    return [colours.get(name.lower(), name) for name in names]


def _rows(file: BufferedReader, preview: _Preview) -> Iterator[str]:
    """Yield the lines from the first row on."""
    file.seek(0)
    return islice(rows.lines_of(file), preview.line - 1, None) if preview.line else iter(())


def write_table(file: BinaryIO, cloud: PointCloud, separator: str = " ", counted: bool = False) -> None:
    """Write a table after the number of points or the names of the columns, which are a comment in one of blanks."""
    columns = columns_of(cloud)
    if counted:
        file.write(f"{len(cloud)}\n".encode())
    elif cloud.attributes or separator != " ":
        file.write(f"{'# ' if separator == ' ' else ''}{separator.join(columns)}\n".encode())
    rows.write_rows(file, list(columns.values()), separator)


def _numbers_and_text(cloud: PointCloud) -> PointCloud:
    """Return a cloud as XYZ and CSV files store it."""
    cloud = _with_decimals(cloud)
    return keeping(
        cloud, lambda name, values: values.dtype.kind in "biufU" and 0 not in values.shape[1:], plain_names=True
    )


def _with_decimals(cloud: PointCloud) -> PointCloud:
    """Return a cloud whose coordinates have the digits of their file: 0.41 in place of 41 times 0.01."""
    decimals = cloud.header.decimals if cloud.header else None
    if decimals is None or not all(0 <= n <= 15 for n in decimals):
        return with_digits(cloud)
    rounded = np.column_stack([np.round(values, n) for values, n in zip(cloud.points.T, decimals, strict=True)])
    shift = np.abs(rounded - cloud.points)
    return replace(cloud, points=np.where(shift <= 2 * np.spacing(np.abs(cloud.points)), rounded, cloud.points))


def _usual_in_pts(cloud: PointCloud) -> PointCloud:
    """Return a cloud with those attributes that PTS files may have."""
    cloud = with_byte_colours(_with_decimals(cloud))
    numbers = {name for name, values in cloud.attributes.items() if values.dtype.kind in "biuf" and values.ndim == 1}
    kept = next((names for names in reversed(_PTS_ATTRIBUTES.values()) if numbers >= set(names)), [])
    return replace(cloud, attributes={name: cloud.attributes[name] for name in kept}, header=None)


_TABLE = frozenset({"columns"})
_write_csv = partial(write_table, separator=",")
_write_pts = partial(write_table, counted=True)
_open_pts = partial(
    open_table, names_of_width=lambda width: [*"xyz", *_PTS_ATTRIBUTES.get(width, default_names(width)[3:])]
)
FORMATS = (
    Format("XYZ", (".xyz", ".txt", ".asc"), open_table, write_table, stored=_numbers_and_text, options=_TABLE),
    Format("CSV", (".csv",), open_table, _write_csv, stored=_numbers_and_text, options=_TABLE),
    Format("PTS", (".pts",), _open_pts, _write_pts, stored=_usual_in_pts, options=_TABLE),
)
