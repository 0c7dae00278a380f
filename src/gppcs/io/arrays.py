"""Reads and writes NumPy's files, NPY and NPZ, and reads the bare records of KITTI and nuScenes.

Pickled objects, which could run code, are refused.
"""

import zipfile
from functools import partial
from io import BufferedReader
from threading import Lock
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, coordinate_names
from gppcs.errors import FileFormatError
from gppcs.io.columns import check_name, columns_of, coordinate_type, default_names
from gppcs.io.format import Format, Reader, begins, keeping, read_at_once
from gppcs.io.rows import bytes_left, check_unpacked, column_chunks, equal_spans, records_reader, reported

header_lock = Lock()  # Python 3.11 may fail if two threads parse the headers of NumPy's files at once

_reported = partial(reported, "numpy", "a whole array of numbers")


def open_npy(file: BufferedReader) -> Reader:
    """Open an NPY file: an array of at least three columns, or a structured array with fields x, y and z."""
    with _reported(), header_lock:
        columns = _columns(_mapped(file))
    n_points = len(columns[coordinate_names(columns)[0]])
    return Reader(partial(column_chunks, columns), n_points, spans=partial(equal_spans, n_points))


def _mapped(file: BufferedReader) -> Column:
    """Return the array of an NPY file, of which only what is used comes into memory."""
    headers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(file)
    shape, by_columns, dtype = headers[version](file) if version in headers else ((), False, np.dtype(object))
    if dtype.hasobject or 0 in (dtype.itemsize, *shape):
        file.seek(0)
        array: Column = npy.read_array(file, allow_pickle=False)
        return array
    return np.memmap(file, dtype, "r", file.tell(), shape, "F" if by_columns else "C")


def open_npz(file: BufferedReader) -> Reader:
    """Open an NPZ file: the array `points`, as NPY files have it, and all other arrays as attributes."""
    size = bytes_left(file)
    with _reported(), zipfile.ZipFile(file) as archive:
        unpacked = sum(member.file_size for member in archive.infolist())
    check_unpacked(unpacked, size)
    return read_at_once(file, _read_npz, unpacked)


def _read_npz(file: BufferedReader) -> tuple[PointCloud, list[str]]:
    """Return the points of an NPZ file."""
    with _reported(), header_lock, np.load(file, allow_pickle=False) as archive:
        arrays = {name: np.asarray(archive[name]) for name in archive.files}
    if "points" not in arrays:
        raise FileFormatError(f"expected an array 'points', found {', '.join(map(repr, arrays)) or 'none'}; rename one")
    columns = _columns(arrays.pop("points"))
    for name in arrays:
        if name in columns:
            raise FileFormatError(f"expected arrays of different names, found {name!r} twice; rename one")
    return PointCloud.from_columns({**columns, **arrays}), []


def open_records(file: BufferedReader, names: tuple[str, ...]) -> Reader:
    """Open a file of one float32 number for each name and point, without a header."""
    record = np.dtype([(name, "<f4") for name in names])
    n_points, rest = divmod(bytes_left(file), record.itemsize)
    if rest:
        raise FileFormatError(
            f"expected points of {record.itemsize} bytes, found {rest} bytes behind the last; get the whole file "
            "again, or name another format"
        )
    return records_reader(file, record, n_points, _plausible)


def _plausible(cloud: PointCloud) -> PointCloud:
    """Return a cloud whose coordinates may be metres around a sensor: nothing else tells bare records from others."""
    sizes = np.abs(cloud.points[cloud.points != 0.0])
    if len(sizes) and not (sizes.max() < 1e6 and np.median(sizes) > 1e-6):
        raise FileFormatError(
            f"expected coordinates of metres around a sensor, found {np.median(sizes):g} as the median of their sizes, "
            f"and {sizes.max():g} as the largest; the file is in another format: leave out `format`, or name that"
        )
    return cloud


def _columns(array: Column) -> dict[str, Column]:
    """Return the columns of an array by name."""
    if array.dtype.names is not None:
        if array.ndim != 1:
            raise FileFormatError(f"expected a structured array of shape (N,), found {array.shape}")
        return {name: array[name] for name in array.dtype.names}
    if array.ndim != 2 or array.shape[1] < 3:
        raise FileFormatError(f"expected an array of shape (N, 3) or more columns, found {array.shape}")
    return dict(zip(default_names(array.shape[1]), array.T, strict=True))


def write_npy(file: BinaryIO, cloud: PointCloud) -> None:
    """Write an NPY file: an (N, 3) array or, for a cloud with attributes, a structured array."""
    columns = columns_of(cloud, flat=False)
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
        for name, values in [("points", points), *cloud.attributes.items()]:
            if values is not points:
                check_name(name, ("points",))
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                npy.write_array(member, values, allow_pickle=False)


_stored = partial(keeping, holds=lambda name, values: not values.dtype.hasobject)
FORMATS = (
    Format("NPY", (".npy",), open_npy, write_npy, begins(rb"\x93NUMPY"), _stored),
    Format("NPZ", (".npz",), open_npz, write_npz, begins(rb"PK\x03\x04"), _stored),
    Format("KITTI", (".kitti",), partial(open_records, names=("x", "y", "z", "intensity"))),
    Format("nuScenes", (".nuscenes",), partial(open_records, names=("x", "y", "z", "intensity", "ring"))),
)
