"""Reads and writes NumPy's files, NPY and NPZ. Pickled objects, which could run code, are refused."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Iterator
from functools import partial
from io import BufferedReader
from tokenize import TokenError
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.lib import format as npy

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, cloud_of_columns, coordinate_names
from gppcs.errors import FileFormatError
from gppcs.io.columns import check_name, columns_of, coordinate_type, default_names
from gppcs.io.format import Format, Reader, Span, from_start, keeping
from gppcs.io.rows import equal_spans, read_records, reported

_POINTS = "points"
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}

# Errors that NumPy and zipfile raise for damaged files.
_DAMAGED_ARRAY = (ValueError, TypeError, SyntaxError, OverflowError, TokenError, KeyError)
_DAMAGED_ZIP = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, OSError, UnicodeDecodeError)


def read_npy(file: BufferedReader, rows: int, attributes: bool, span: Span | None = None) -> Iterator[PointCloud]:
    """Read an NPY file: an array of at least three columns, or a structured array with fields x, y and z."""
    layout = _layout_by_rows(file)
    if layout is None:
        columns = _columns(_array(file))
        yield cloud_of_columns({n: columns[n] for n in (columns if attributes else coordinate_names(columns))})
        return
    (count, *width), dtype = layout
    if dtype.names is None or width:
        names = _columns(np.broadcast_to(np.empty((), dtype), layout[0]))
        dtype = np.dtype([(name, dtype) for name in names])
    yield from read_records(file, dtype, count, rows, "point", dtype.names or () if attributes else (), span)


def _layout_by_rows(file: BufferedReader) -> tuple[tuple[int, ...], np.dtype[Any]] | None:
    """Return shape and type of an array, the file at its data; None, at its start, if it is not stored row by row."""
    try:
        version = npy.read_magic(file)
        header = _HEADERS[version](file)
    except _DAMAGED_ARRAY:
        header = ((), False, np.dtype(object))
    shape, by_columns, dtype = header
    if not shape or (by_columns and len(shape) > 1) or dtype.hasobject or 0 in (dtype.itemsize, *shape):
        file.seek(0)
        return None
    return shape, dtype


def read_npz(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read an NPZ file: the array `points`, as `read_npy` reads it, and all other arrays as attributes."""
    try:
        with zipfile.ZipFile(file) as archive:
            arrays = {}
            for entry in archive.infolist():
                name = entry.filename.removesuffix(".npy")
                if not name or name in arrays:
                    raise FileFormatError(f"expected a name of its own for each array, found {name!r}; rename one")
                with archive.open(entry) as member:
                    arrays[name] = _array(member)
    except _DAMAGED_ZIP as error:
        raise FileFormatError("expected a whole NPZ file, found a damaged one; get it again") from error
    if _POINTS not in arrays:
        found = ", ".join(map(repr, arrays)) or "none"
        raise FileFormatError(f"expected an array {_POINTS!r}, found {found}; rename one")
    columns = _columns(arrays.pop(_POINTS))
    for name, values in arrays.items():
        if name in columns:
            raise FileFormatError(f"expected arrays of different names, found {name!r} twice; rename one")
        if values.ndim == 0:
            raise FileFormatError(f"expected one value for each point in {name!r}, found a single value; remove it")
    yield cloud_of_columns({**columns, **arrays})


def count_npz(file: BufferedReader) -> int:
    """Return how many points an NPZ file has, as the header of its array `points` says; 0 if that is damaged."""
    try:
        with zipfile.ZipFile(file) as archive, archive.open(f"{_POINTS}.npy") as member:
            return _shape(member)[0]
    except (*_DAMAGED_ZIP, *_DAMAGED_ARRAY):
        return 0


def spans_of_npy(file: BufferedReader, rows: int) -> list[Span]:
    """Divide the points of an NPY file into parts that can be read by themselves, if it is stored row by row."""
    layout = _layout_by_rows(file)
    if layout is None:
        return []
    (count, *width), dtype = layout
    return equal_spans(file, dtype.itemsize * math.prod(width), count, rows)


def count_npy(file: BufferedReader) -> int:
    """Return how many points an NPY file has, as its header says; 0 if that is damaged."""
    try:
        return _shape(file)[0]
    except _DAMAGED_ARRAY:
        return 0


def _shape(file: IO[bytes]) -> tuple[int, ...]:
    shape: tuple[int, ...] = _HEADERS[npy.read_magic(file)](file)[0]
    return shape or (0,)


def _array(file: IO[bytes]) -> Column:
    with reported("numpy", "a whole array of numbers", _DAMAGED_ARRAY):
        array: Column = npy.read_array(file, allow_pickle=False)
    return array


def _columns(array: Column) -> dict[str, Column]:
    if array.dtype.names is not None:
        if array.ndim != 1:
            raise FileFormatError(f"expected a structured array of shape (N,), found {array.shape}")
        return {name: array[name] for name in array.dtype.names}
    if array.ndim != 2 or array.shape[1] < 3:
        raise FileFormatError(f"expected an array of shape (N, 3) or more columns, found {array.shape}")
    return dict(zip(default_names(array.shape[1]), array.T, strict=True))


def write_npy(file: BinaryIO, cloud: PointCloud) -> None:
    """Write an NPY file: an (N, 3) array or, for a cloud with attributes, a structured array."""
    columns = columns_of(cloud, flat=False, named=str)
    if not cloud.attributes:
        npy.write_array(file, np.stack(list(columns.values()), axis=1), allow_pickle=False)
        return
    table = np.empty(len(cloud), [(name, values.dtype, values.shape[1:]) for name, values in columns.items()])
    for name, values in columns.items():
        table[name] = values
    npy.write_array(file, table, allow_pickle=False)


def write_npz(file: BinaryIO, cloud: PointCloud) -> None:
    """Write an NPZ file: the array `points` and one array for each attribute, not compressed."""
    points = cloud.points.astype(coordinate_type(cloud), copy=False)
    with zipfile.ZipFile(file, "w") as archive:
        for name, values in [(_POINTS, points), *cloud.attributes.items()]:
            if values is not points:
                check_name(name, (_POINTS,))
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                npy.write_array(member, values, allow_pickle=False)


def open_npy(file: BufferedReader) -> Reader:
    """Open an NPY file."""
    spans = partial(from_start, spans_of_npy, file)
    return Reader(partial(from_start, read_npy, file), count_npy(file), spans=spans)


def open_npz(file: BufferedReader) -> Reader:
    """Open an NPZ file."""
    return Reader(partial(from_start, read_npz, file), count_npz(file), at_once=True)


def _without_objects(cloud: PointCloud) -> PointCloud:
    """Return a cloud without attributes of Python objects."""
    return keeping(cloud, lambda name, values: not values.dtype.hasobject)


FORMATS = (
    Format(
        "NPY",
        (".npy",),
        open_npy,
        write_npy,
        lambda start, size: start.startswith(b"\x93NUMPY"),
        _without_objects,
    ),
    Format(
        "NPZ",
        (".npz",),
        open_npz,
        write_npz,
        lambda start, size: start.startswith(b"PK\x03\x04"),
        _without_objects,
    ),
)
