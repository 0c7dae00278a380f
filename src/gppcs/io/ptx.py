"""Reads PTX files, in which Leica's programs export scans as text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from io import BufferedReader

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, cloud_of_columns
from gppcs.clouds.header import Header
from gppcs.errors import FileFormatError
from gppcs.io.format import Format, Reader, from_start
from gppcs.io.rows import as_count, lines_of, read_rows, shortened

_WIDTHS = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)  # numbers in the lines before the points of a scan
_NAMES = {4: ("intensity",), 7: ("intensity", "red", "green", "blue")}  # by the number of numbers of a point


@dataclass(frozen=True)
class PtxScan:
    """What a PTX file says of one scan. The points of the cloud are the row vectors of the file times its pose."""

    columns: int  # of its grid
    rows: int
    scanner: tuple[float, ...]  # its position, then its three axes
    pose: tuple[float, ...]  # a 4 by 4 matrix, row by row

    def moved(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 3) of the scan in the coordinates that its pose leads to."""
        matrix = np.array(self.pose).reshape(4, 4)
        if np.array_equal(matrix, np.eye(4)):
            return points
        moved: NDArray[np.float64] = points @ matrix[:3, :3] + matrix[3, :3]
        return moved


@dataclass(frozen=True, eq=False)
class PtxHeader(Header):
    """What a PTX file says of its scans."""

    scans: tuple[PtxScan, ...] = ()  # the attribute `scan` of a point is an index into them

    def contents(self) -> list[str]:
        """Return in words how many scans have a place and a pose."""
        count = len(self.scans)
        return [f"the poses of {count} scans" if count > 1 else "the pose of 1 scan"] if count else []


def read_ptx(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read all scans of a PTX file as one cloud, each moved by its pose. Rows without a return, 0 0 0, are left out."""
    scans: list[PtxScan] = []
    parts: list[dict[str, Column]] = []
    for scan, blocks in _scans(file):
        for table in blocks:
            returns = table[table[:, :3].any(axis=1)]
            columns: dict[str, Column] = dict(zip("xyz", scan.moved(returns[:, :3]).T, strict=True))
            for name, values in zip(_NAMES[table.shape[1]], returns[:, 3:].T, strict=True):
                columns[name] = values if name == "intensity" else _colours(values, name)
            columns["scan"] = np.full(len(returns), len(scans), np.int32)
            parts.append(columns)
        scans.append(scan)
    if len({tuple(columns) for columns in parts}) > 1:
        raise FileFormatError("expected colours in all scans or in none, found them in some; read the scans one by one")
    names = [name for name in (parts[0] if parts else "xyz") if name != "scan" or len(scans) > 1]
    joined = {name: np.concatenate([columns.pop(name) for columns in parts] or [np.empty(0)]) for name in names}
    yield replace(cloud_of_columns(joined), header=PtxHeader(tuple(scans)))


def unread_ptx(file: BufferedReader) -> list[str]:
    """Return in words what `read_ptx` leaves out: rows without a return, and the order in rows and columns."""
    missing, sizes = 0, []
    for scan, blocks in _scans(file):
        missing += sum(int((~table[:, :3].any(axis=1)).sum()) for table in blocks)
        sizes.append(f"{scan.columns:,} columns and {scan.rows:,} rows")
    rows = [f"rows without a return ({missing:,})"] if missing else []
    return [*rows, *(f"the grid of {size}" for size in dict.fromkeys(sizes))]


def _scans(file: BufferedReader) -> Iterator[tuple[PtxScan, Iterator[NDArray[np.float64]]]]:
    """Yield what precedes the points of each scan, and the points block by block, to be read before the next scan."""
    lines = lines_of(file)
    number = 0  # of lines read
    for first in lines:
        number += 1
        if first.strip():
            scan = _header(first, lines, number)
            number += len(_WIDTHS) - 1
            yield scan, _points(lines, number + 1, scan.columns * scan.rows)
            number += scan.columns * scan.rows
    if not number:
        raise FileFormatError("expected the size of a scan in a PTX file, found nothing; get the whole file again")


def _header(first: str, lines: Iterator[str], number: int) -> PtxScan:
    """Read what precedes the points of a scan, given its first line and the number of that."""
    values: list[float] = []
    for i, width in enumerate(_WIDTHS):
        line = first if i == 0 else next(lines, "")
        try:
            row = [float(word) for word in line.split()]
        except ValueError:
            row = []
        if len(row) != width or not np.isfinite(row).all() or (width == 1 and as_count(line.strip()) is None):
            what = f"{width} finite numbers" if width > 1 else "a whole number"
            raise FileFormatError(
                f"line {number + i}: expected {what} before the points of a scan, found {shortened(line)}"
            )
        values += row
    return PtxScan(int(values[0]), int(values[1]), tuple(values[2:14]), tuple(values[14:]))


def _points(lines: Iterator[str], first_line: int, count: int) -> Iterator[NDArray[np.float64]]:
    """Yield the numbers of `count` points, block by block."""
    for columns in read_rows(lines, count=count) if count else ():
        if len(columns) not in _NAMES:
            raise FileFormatError(f"line {first_line}: expected 4 or 7 numbers for each point, found {len(columns)}")
        yield np.stack(columns, axis=1, dtype=np.float64, casting="unsafe")


def _colours(values: NDArray[np.float64], name: str) -> Column:
    wrong = ~((values >= 0) & (values <= 255) & (values == np.rint(values)))
    if wrong.any():
        raise FileFormatError(f"expected whole numbers from 0 to 255 as {name}, found {values[np.argmax(wrong)]:g}")
    return values.astype(np.uint8)


def _is_ptx(head: bytes, size: int) -> bool:
    """Return whether a file begins with the sizes and the pose of a scan."""
    lines = head.split(b"\n")[: len(_WIDTHS)]
    if not all(line.strip().isdigit() for line in lines[:2]):
        return False
    return len(lines) == len(_WIDTHS) and all(
        len(line.split()) == width for line, width in zip(lines, _WIDTHS, strict=True)
    )


def open_ptx(file: BufferedReader) -> Reader:
    """Open a PTX file."""
    return Reader(partial(from_start, read_ptx, file), at_once=True, skipped=partial(from_start, unread_ptx, file))


FORMAT = Format("PTX", (".ptx",), open_ptx, recognises=_is_ptx)
