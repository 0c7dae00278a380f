"""Reads PTX files, in which Leica's programs export scans as text."""

from __future__ import annotations

from collections.abc import Iterator
from io import BufferedReader

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column
from gppcs.errors import FileFormatError
from gppcs.io.format import Format, Reader
from gppcs.io.rows import as_count, lines_of, read_rows, shortened

# How many numbers are in the lines before the points of a scan: columns, rows, the scanner's position and three axes,
# and the pose, a matrix by which the row vectors of the points are multiplied.
_WIDTHS = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)


def open_ptx(file: BufferedReader) -> Reader:
    """Open a PTX file, whose scans are one cloud, each moved by its pose. Rows without a return are left out."""
    n_missing = 0

    def chunks(n: int, attributes: bool) -> Iterator[PointCloud]:
        nonlocal n_missing
        file.seek(0)
        parts = [_columns(table, pose, scan) for scan, (pose, blocks) in enumerate(_scans(file)) for table in blocks]
        if len({tuple(columns) for columns in parts}) > 1:
            raise FileFormatError(
                "expected colours in all scans or in none, found them in some; read the scans one by one"
            )
        has_return = np.concatenate([columns.pop("has_return") for columns in parts])
        n_missing = int(np.count_nonzero(~has_return))
        joined = {name: np.concatenate([columns.pop(name) for columns in parts])[has_return] for name in list(parts[0])}
        if not joined["scan"].any():
            del joined["scan"]
        yield PointCloud.from_columns({name: joined[name] for name in joined if attributes or name in "xyz"})

    return Reader(chunks, at_once=True, skipped=lambda: [f"rows without a return ({n_missing:,})"] if n_missing else [])


def _scans(file: BufferedReader) -> Iterator[tuple[NDArray[np.float64], Iterator[list[Column]]]]:
    """Yield the pose of each scan, (4, 4), and its points block by block, to be read before the next scan."""
    lines = lines_of(file)
    number = 0
    for line in lines:
        if line.strip():
            number += 1
            values = [_numbers(line if i == 0 else next(lines, ""), _WIDTHS[i], number) for i in range(len(_WIDTHS))]
            count = int(values[0][0]) * int(values[1][0])
            yield np.array(values[-4:]), read_rows(lines, count=count) if count else iter([[np.empty(0)] * 4])
    if not number:
        raise FileFormatError("expected the size of a scan in a PTX file, found nothing; get the whole file again")


def _numbers(line: str, width: int, scan: int) -> list[float]:
    """Return the numbers in a line before the points of a scan."""
    try:
        values = [float(text) for text in line.split()]
    except ValueError:
        values = []
    if len(values) != width or not np.isfinite(values).all() or (width == 1 and as_count(line.strip()) is None):
        expected = f"{width} finite numbers" if width > 1 else "a whole number"
        raise FileFormatError(f"expected {expected} before the points of scan {scan}, found {shortened(line)}")
    return values


def _columns(table: list[Column], pose: NDArray[np.float64], scan: int) -> dict[str, Column]:
    """Return the points of a scan by name, and which have a return."""
    if len(table) not in (4, 7):
        raise FileFormatError(f"expected 4 or 7 numbers for each point, found {len(table)}")
    points = np.stack(table[:3], axis=1, dtype=np.float64, casting="unsafe")
    has_return = np.asarray(points.any(axis=1))
    if not np.array_equal(pose, np.eye(4)):
        points = points @ pose[:3, :3] + pose[3, :3]
    columns: dict[str, Column] = dict(zip("xyz", points.T, strict=True))
    columns["intensity"] = table[3].astype(np.float64)
    for name, values in zip(("red", "green", "blue"), table[4:], strict=False):
        wrong = ~((values >= 0) & (values <= 255) & (values == np.rint(values)))
        if wrong.any():
            raise FileFormatError(f"expected whole numbers from 0 to 255 as {name}, found {values[np.argmax(wrong)]:g}")
        columns[name] = values.astype(np.uint8)
    return {**columns, "scan": np.full(len(points), scan, np.int32), "has_return": has_return}


def _is_ptx(start: bytes, size: int) -> bool:
    """Return whether a file begins with the sizes and the pose of a scan."""
    lines = [line.split() for line in start.split(b"\n")[: len(_WIDTHS)]]
    return tuple(map(len, lines)) == _WIDTHS and all(line[0].isdigit() for line in lines[:2])


FORMAT = Format("PTX", (".ptx",), open_ptx, recognises=_is_ptx)
