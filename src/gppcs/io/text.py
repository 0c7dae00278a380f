"""Reads and writes tables of numbers as text: XYZ, TXT, ASC, CSV and PTS.

- The first row of numbers sets the delimiter: comma, semicolon or whitespace.
- Names of columns come from a header line, or from a comment line (`#` or `//`) that contains x, y and z and has one
  name for each column.
- Without names, the first three columns are the coordinates, and the others become `column_4`, `column_5` and so on. In
  PTS files with 4, 6 or 7 columns they become `intensity`, `red green blue`, or all four.
- A single whole number before the first row is the number of points.
- Columns of whole numbers become int64, or uint64 if they need it; others become float64.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from io import BufferedReader
from itertools import chain
from typing import BinaryIO

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError
from gppcs.io.columns import (
    Column,
    attribute_columns,
    cloud_of_columns,
    coordinate_names,
    coordinate_type,
    default_names,
    only_numbers,
)
from gppcs.io.format import Format, without_attributes
from gppcs.io.rows import as_count, joined, lines_of, number_blocks, shown, typed_columns, write_rows

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


def read_xyz(file: BufferedReader) -> PointCloud:
    """Read a table. Columns without names are x, y, z, column_4 and so on.

    Parameters
    ----------
    file : binary file
        Open for reading, at its start.

    Returns
    -------
    PointCloud

    Raises
    ------
    FileFormatError
        If a row is malformed, names do not fit the columns, or the number of points is not the one announced.
    """
    return _read(file, default_names)


def read_pts(file: BufferedReader) -> PointCloud:
    """Read a table. Columns without names are those usual in PTS files: x, y, z, intensity, red, green, blue.

    Parameters
    ----------
    file : binary file
        Open for reading, at its start.

    Returns
    -------
    PointCloud

    Raises
    ------
    FileFormatError
        If a row is malformed, names do not fit the columns, or the number of points is not the one announced.
    """
    return _read(file, lambda width: [*default_names(3), *_PTS_EXTRAS.get(width, default_names(width)[3:])])


def _read(file: BufferedReader, names_of_width: Callable[[int], list[str]]) -> PointCloud:
    lines = lines_of(file)
    layout = _layout(lines)
    names = layout.names or names_of_width(layout.width)
    if not layout.first_row:
        if layout.count:
            raise FileFormatError(f"expected {layout.count} points, found none; get the whole file again")
        return cloud_of_columns({name: np.empty(0) for name in names})
    rows = chain([layout.first_row], lines)
    blocks = number_blocks(
        rows,
        layout.first_line,
        _numbers,
        delimiter=layout.delimiter,
        width=layout.width,
        count=layout.count,
    )
    columns = [typed_columns(texts, values, layout.delimiter) for texts, values in blocks]
    if any(map(_numbers, rows)):
        raise FileFormatError(f"expected {layout.count} points, as the file says, found more")
    return cloud_of_columns(
        {name: joined(parts) for name, parts in zip(names, zip(*columns, strict=True), strict=True)}
    )


def _numbers(line: str) -> str:
    return "" if line.isspace() or line.lstrip().startswith(("#", "//")) else line


def _layout(lines: Iterator[str]) -> _Layout:
    """Read the lines up to the first row of numbers."""
    layout = _Layout()
    commented: list[str] = []
    for number, line in enumerate(lines, 1):
        fields = _fields(line.lstrip("#/ \t"))
        if not _numbers(line):
            commented = fields if {"x", "y", "z"} <= {name.lower() for name in fields} else commented
        elif not all(map(_is_number, fields)):
            layout.names, layout.names_line = _header(fields, number, line), number
        elif len(fields) == 1 and layout.count is None and as_count(fields[0]) is not None:
            layout.count = as_count(fields[0])
        else:
            layout.first_row, layout.first_line = line, number
            layout.delimiter, layout.width = _delimiter(line), len(fields)
            break
    if layout.names is None and commented and len(commented) == (layout.width or len(commented)):
        layout.names = commented
    _check_width(layout)
    return layout


def _check_width(layout: _Layout) -> None:
    if not layout.first_row:
        layout.width = 3
        return
    if layout.width < 3:
        raise FileFormatError(
            f"line {layout.first_line}: expected at least three numbers, found {shown(layout.first_row)}"
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
    except FileFormatError as error:
        raise FileFormatError(
            f"line {number}: expected numbers, or names of columns with x, y, z, found {shown(line)}"
        ) from error
    repeated = next((name for name in names if names.count(name) > 1), None)
    if repeated is not None:
        raise FileFormatError(f"line {number}: expected different names, found {repeated!r} twice")
    return names


def _delimiter(line: str) -> str | None:
    return next((mark for mark in (",", ";") if mark in line), None)


def _fields(line: str) -> list[str]:
    return [field.strip().strip("\"'") for field in line.strip().split(_delimiter(line))]


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def write_xyz(file: BinaryIO, cloud: PointCloud) -> None:
    """Write numbers separated by spaces, after a comment with the names if the cloud has attributes.

    Parameters
    ----------
    file : binary file
        Open for writing.
    cloud : PointCloud
        The points and their attributes.

    Raises
    ------
    OutputError
        If the cloud does not fit into columns of numbers with different names.
    """
    columns = _columns(cloud)
    if cloud.attributes:
        file.write(f"# {' '.join(columns)}\n".encode())
    write_rows(file, list(columns.values()))


def write_csv(file: BinaryIO, cloud: PointCloud) -> None:
    """Write a line with the names, then numbers separated by commas.

    Parameters
    ----------
    file : binary file
        Open for writing.
    cloud : PointCloud
        The points and their attributes.

    Raises
    ------
    OutputError
        If the cloud does not fit into columns of numbers with different names.
    """
    columns = _columns(cloud)
    file.write(f"{','.join(columns)}\n".encode())
    write_rows(file, list(columns.values()), ",")


def write_pts(file: BinaryIO, cloud: PointCloud) -> None:
    """Write the number of points, then one row for each point.

    Parameters
    ----------
    file : binary file
        Open for writing.
    cloud : PointCloud
        Its attributes must be none, intensity, or red, green, blue, or all four: PTS files have no names.

    Raises
    ------
    OutputError
        If the coordinates do not fit the cloud's `coordinate_dtype`.
    """
    columns = _columns(cloud)
    file.write(f"{len(cloud)}\n".encode())
    write_rows(file, list(columns.values()))


def _columns(cloud: PointCloud) -> dict[str, Column]:
    points = cloud.points.astype(coordinate_type(cloud), copy=False)
    return {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2], **attribute_columns(cloud)}


def _usual_in_pts(cloud: PointCloud) -> tuple[PointCloud, list[str]]:
    """Return a cloud with those attributes that PTS files may have, and in words what that leaves out."""
    numbers, others = only_numbers(cloud)
    columns = {name for name, values in numbers.attributes.items() if values.ndim == 1}
    kept = next((names for names in sorted(_PTS_EXTRAS.values(), key=len, reverse=True) if columns >= set(names)), [])
    fitted, attributes = without_attributes(numbers, set(numbers.attributes) - set(kept))
    return replace(fitted, attributes={name: fitted.attributes[name] for name in kept}), [*attributes, *others]


FORMATS = (
    Format("XYZ", (".xyz", ".txt", ".asc"), read_xyz, write_xyz, fitted=only_numbers),
    Format("CSV", (".csv",), read_xyz, write_csv, fitted=only_numbers),
    Format("PTS", (".pts",), read_pts, write_pts, fitted=_usual_in_pts),
)
