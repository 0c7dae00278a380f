"""Reads and writes NumPy's files, NPY and NPZ. Pickled objects, which could run code, are refused."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Iterator
from io import BufferedReader
from tokenize import TokenError
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.lib import format as npy

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, cloud_of_columns, coordinate_names
from gppcs.errors import FileFormatError
from gppcs.io.columns import check_name, coordinate_type, default_names
from gppcs.io.format import Format, without_attributes
from gppcs.io.rows import bytes_left, ends_early

_POINTS = "points"
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}

# Errors that NumPy and zipfile raise for damaged files.
_DAMAGED_ARRAY = (ValueError, TypeError, SyntaxError, OverflowError, TokenError, KeyError)
_DAMAGED_ZIP = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, OSError, UnicodeDecodeError)


def read_npy(file: BufferedReader) -> PointCloud:
    """Read an NPY file: an array of at least three columns, or a structured array with fields x, y and z."""
    return cloud_of_columns(_columns(_array(file)))


def read_npy_chunks(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read an NPY file as `read_npy` does, in chunks. An array that is stored column by column comes as one."""
    layout = _layout_by_rows(file)
    if layout is None:
        yield _cloud(_array(file), attributes)
        return
    shape, dtype = layout
    whole = bytes_left(file) // max(1, math.prod(shape[1:]) * dtype.itemsize)
    if whole < shape[0]:
        raise ends_early("point", whole, shape[0])
    for start in range(0, max(shape[0], 1), rows):
        part = np.empty((min(rows, shape[0] - start), *shape[1:]), dtype)
        file.readinto(part.reshape(-1).view(np.uint8).data)
        yield _cloud(part, attributes)


def _layout_by_rows(file: BufferedReader) -> tuple[tuple[int, ...], np.dtype[Any]] | None:
    """Return shape and type of an array and leave the file at its data; None if that is not stored row by row.

    In that case, the file is left at its start, also if it is damaged.
    """
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


def _cloud(array: Column, attributes: bool) -> PointCloud:
    columns = _columns(array)
    kept = list(columns) if attributes else coordinate_names(columns)
    return cloud_of_columns({name: columns[name] for name in kept})


def read_npz(file: BufferedReader) -> PointCloud:
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
    return cloud_of_columns({**columns, **arrays})


def count_npz(file: BufferedReader) -> int:
    """Return how many points an NPZ file has, as the header of its array `points` says; 0 if that is damaged."""
    try:
        with zipfile.ZipFile(file) as archive, archive.open(f"{_POINTS}.npy") as member:
            return _shape(member)[0]
    except (*_DAMAGED_ZIP, *_DAMAGED_ARRAY):
        return 0


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
    try:
        array: Column = npy.read_array(file, allow_pickle=False)
    except _DAMAGED_ARRAY as error:
        reason = str(error).partition("\n")[0]
        raise FileFormatError(f"expected a whole array of numbers, but numpy reports: {reason}") from error
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
    kept = coordinate_type(cloud)
    if not cloud.attributes:
        npy.write_array(file, cloud.points.astype(kept, copy=False), allow_pickle=False)
        return
    for name in cloud.attributes:
        check_name(name, ())
    fields = [(name, values.dtype, values.shape[1:]) for name, values in cloud.attributes.items()]
    table = np.empty(len(cloud), [("x", kept), ("y", kept), ("z", kept), *fields])
    for i, axis in enumerate("xyz"):
        table[axis] = cloud.points[:, i]
    for name, values in cloud.attributes.items():
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


def _without_objects(cloud: PointCloud) -> tuple[PointCloud, list[str]]:
    """Return a cloud without attributes of Python objects, and in words what that leaves out."""
    objects = [name for name, values in cloud.attributes.items() if values.dtype.hasobject]
    return without_attributes(cloud, objects)


def _is_npy(head: bytes, size: int) -> bool:
    return head.startswith(b"\x93NUMPY")


def _is_npz(head: bytes, size: int) -> bool:
    return head.startswith(b"PK\x03\x04")


FORMATS = (
    Format(
        "NPY", (".npy",), read_npy, write_npy, _is_npy, fitted=_without_objects, chunks=read_npy_chunks, count=count_npy
    ),
    Format("NPZ", (".npz",), read_npz, write_npz, _is_npz, fitted=_without_objects, count=count_npz),
)
