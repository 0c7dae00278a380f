"""Reads PTX files, in which Leica's programs export scans as text."""

import math
from collections.abc import Iterator
from functools import partial
from io import BufferedReader
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column
from gppcs.errors import FileFormatError
from gppcs.io.format import Format, read_at_once
from gppcs.io.rows import as_count, cast, damaged, ends_early, is_number, lines_of, read_table, shortened

WIDTHS = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)  # of the lines before points: sizes, position and axes of the scanner, pose


def _read(file: BufferedReader) -> tuple[PointCloud, list[str]]:
    """Return the points of all scans, each moved by its pose, and in words what is left out: rows without a return."""
    scans = list(_scans(file))
    if not scans:
        raise damaged("the size of a scan in a PTX file", "nothing")
    if len({tuple(columns) for columns in scans}) > 1:
        raise FileFormatError("expected colours in all scans or in none, found them in some; read the scans one by one")
    has_return = np.concatenate([columns.pop("has_return") for columns in scans])
    n_missing = np.count_nonzero(~has_return)
    joined = {name: np.concatenate([columns.pop(name) for columns in scans])[has_return] for name in list(scans[0])}
    if not joined["scan"].any():
        del joined["scan"]
    return PointCloud.from_columns(joined), [f"rows without a return ({n_missing:,})"] if n_missing else []


def _scans(file: BufferedReader) -> Iterator[dict[str, Column]]:
    """Yield the columns of each scan."""
    lines = lines_of(file)
    for scan, line in enumerate(filter(str.strip, lines)):
        header = [text.split() for text in chain([line], islice(lines, len(WIDTHS) - 1))]
        for number, (width, fields) in enumerate(zip(WIDTHS, header, strict=False), 1):
            if len(fields) != width or not all(map(is_number, fields)):
                actual = shortened(" ".join(fields))
                raise FileFormatError(f"scan {scan + 1}, line {number}: expected {width} numbers, found {actual}")
        if len(header) < len(WIDTHS):
            raise ends_early(f"scan {scan + 1}, line", len(header), len(WIDTHS))
        sizes, pose = [as_count(fields[0]) for fields in header[:2]], np.array(header[6:], np.float64)
        if None in sizes or not np.isfinite(pose).all():
            whole = f"whole numbers as the size of scan {scan + 1} and finite ones as its pose"
            raise damaged(whole, f"{header[0][0]}, {header[1][0]} and {pose.tolist()}")
        count = math.prod(size or 0 for size in sizes)
        yield _columns(read_table(lines, None if count else 4, count), pose, scan)


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
        columns[name] = cast(values, np.dtype(np.uint8), f"whole numbers from 0 to 255 as {name} of point")
    return {**columns, "scan": np.full(len(points), scan, np.int32), "has_return": has_return}


def _is_ptx(start: bytes, size: int) -> bool:
    """Return whether a file begins with the sizes and the pose of a scan."""
    lines = [line.split() for line in start.split(b"\n")[:10]]
    return tuple(map(len, lines)) == WIDTHS and all(line[0].isdigit() for line in lines[:2])


FORMAT = Format("PTX", (".ptx",), partial(read_at_once, read=_read), recognises=_is_ptx)
