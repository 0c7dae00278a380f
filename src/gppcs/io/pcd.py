"""Reads PCD files, text, binary and compressed, and writes text and binary ones."""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from io import BufferedReader
from typing import Any, BinaryIO

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, coordinate_names
from gppcs.errors import FileFormatError, OutputError
from gppcs.io import rows
from gppcs.io.columns import check_name, columns_of, exact_type, with_byte_colours
from gppcs.io.format import Format, Reader, begins, keeping

_TYPES = [np.dtype(name) for name in ("f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8")]
_KEYWORDS = frozenset(["VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA"])
_PADDING = "_"
EXPORT = "export the cloud again"
_BYTES = {"red": 2, "green": 1, "blue": 0, "alpha": 3}  # where a packed colour holds them, on little-endian machines


def open_pcd(file: BufferedReader) -> Reader:
    """Open a PCD file."""
    record, n_points, encoding = _read_header(file)
    coordinate_names(record.names or ())
    if encoding == "binary":
        return rows.records_reader(file, record, n_points, _with_channels)
    read = _text_columns if encoding == "ascii" else _unpacked_columns
    reader = rows.blocks_reader(file, partial(read, record=record, n_points=n_points), n_points, _with_channels)
    return reader if encoding == "ascii" else replace(reader, at_once=True, memory=n_points * record.itemsize)


def _read_header(file: BufferedReader) -> tuple[np.dtype[Any], int, str]:
    """Return the type of a point, in which names of padding begin with a space, their number and the encoding."""
    entries: dict[str, list[str]] = {}
    while "DATA" not in entries:
        line = file.readline(1 << 20)
        keyword, *values = line.decode("utf-8-sig", "replace").split() or [""]
        if keyword in _KEYWORDS:
            entries[keyword] = values
        elif not line or (keyword and not keyword.startswith("#")):
            actual = rows.shortened(line.decode("utf-8", "replace")) if line else "the end of the file"
            raise rows.damaged("lines of keywords up to DATA in a PCD file", actual)
    encoding = " ".join(entries["DATA"])
    if encoding not in ("ascii", "binary", "binary_compressed"):
        raise rows.damaged("DATA to be ascii, binary or binary_compressed", rows.shortened(encoding), EXPORT)
    texts = [" ".join(entries.get(keyword, [])) for keyword in ("WIDTH", "HEIGHT")]
    if None in map(rows.as_count, texts):
        raise rows.damaged("whole numbers as WIDTH and HEIGHT", " and ".join(map(rows.shortened, texts)), EXPORT)
    return _record(entries), math.prod(map(int, texts)), encoding


def _record(entries: dict[str, list[str]]) -> np.dtype[Any]:
    counts = entries.get("COUNT", ["1"] * len(entries.get("FIELDS", [])))
    fields: list[Any] = []
    with rows.reported("numpy", "a TYPE, SIZE and COUNT for each of different FIELDS"):
        for name, letter, size, count in zip(entries["FIELDS"], entries["TYPE"], entries["SIZE"], counts, strict=True):
            if letter not in ("F", "I", "U") or not rows.as_count(count):
                raise FileFormatError(f"expected TYPE F, I or U, and COUNT from 1 on, found {letter!r} and {count!r}")
            shape = () if count == "1" else (int(count),)
            fields.append((f" {len(fields)}" if name == _PADDING else name, f"<{letter.lower()}{size}", shape))
        return np.dtype(fields)


def _text_columns(file: BufferedReader, record: np.dtype[Any], n_points: int) -> Iterator[dict[str, Column]]:
    """Yield the columns of a text file, block by block."""
    single, are_single = [axis for axis in coordinate_names(record.names or ()) if record[axis] == np.float32], True
    wide = np.dtype([(name, np.float64 if name in single else record[name]) for name in record.names or ()])
    for columns in rows.read_fields(file, wide, n_points):
        are_single = are_single and not any(_loses_digits(columns[axis]) for axis in single)
        if are_single:
            columns |= {axis: rows.cast(columns[axis], np.dtype(np.float32), axis) for axis in single}
        yield columns


def _loses_digits(values: Column) -> bool:
    """Return whether float32, which a header names, moves coordinates of text by more than its own digits tell."""
    values = values[np.isfinite(values)]
    with np.errstate(over="ignore"):
        shift = np.abs(values.astype(np.float32) - values).max(initial=0.0)
        return bool(len(values) and shift > 1e-5 * np.ptp(values) > 0.0)


def _unpacked_columns(file: BufferedReader, record: np.dtype[Any], n_points: int) -> Iterator[dict[str, Column]]:
    """Yield the columns of a file that holds them one by one, compressed."""
    n_packed, n_bytes = np.frombuffer(file.read(8).ljust(8, b"\0"), "<u4").tolist()
    expected, left = n_points * record.itemsize, rows.bytes_left(file)
    if n_bytes != expected or n_packed > left:
        whole = f"{expected} bytes of points in at most {left} compressed ones"
        raise rows.damaged(whole, f"{n_bytes} in {n_packed} announced")
    data, start, columns = _decompressed(file.read(n_packed), n_bytes), 0, {}
    for name in record.names or ():
        columns[name] = np.frombuffer(data, record[name], n_points, start)
        start += n_points * record[name].itemsize
    yield columns


def _decompressed(data: bytes, size: int) -> bytearray:
    """Return `size` bytes of data that LZF has compressed."""
    out = bytearray()
    at = 0
    with suppress(IndexError):  # of data that end early
        while at < len(data):
            control = data[at]
            at += 1
            if control < 32:  # that many bytes and one more follow as they are
                out += data[at : at + control + 1]
                at += control + 1
                continue
            length = (control >> 5) + 2
            if length == 9:
                length += data[at]
                at += 1
            first = len(out) - ((control & 31) << 8 | data[at]) - 1
            at += 1
            if first < 0:
                break
            part = out[first : first + length]
            out += (part * (length // len(part) + 1))[:length]  # a copy can go on with bytes that it has just made
    if at != len(data) or len(out) != size:
        raise rows.damaged(f"{size} bytes of points in LZF compression", "damaged data")
    return out


def _may_be_colour(name: str, dtype: np.dtype[Any], ndim: int) -> bool:
    """Return whether programs take an attribute for colours whose channels are the bytes of one number."""
    return name in ("rgb", "rgba") and dtype.itemsize == 4 and ndim == 1


def _with_channels(cloud: PointCloud) -> PointCloud:
    """Return a cloud without padding, with red, green and blue, and alpha of `rgba`, in place of what packs them."""
    cloud = replace(cloud, attributes={name: cloud.attributes[name] for name in cloud.attributes if name[:1] != " "})
    packed = [name for name, values in cloud.attributes.items() if _may_be_colour(name, values.dtype, values.ndim)]
    if len(packed) != 1 or not _BYTES.keys().isdisjoint(cloud.attributes):
        return cloud
    attributes: dict[str, Column] = {}
    for name, values in cloud.attributes.items():
        if name in packed:
            parts = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).view(np.uint8).reshape(-1, 4)
            channels = [channel for channel in _BYTES if channel in ("red", "green", "blue") or name == "rgba"]
            attributes |= {channel: np.ascontiguousarray(parts[:, _BYTES[channel]]) for channel in channels}
        else:
            attributes[name] = values
    return replace(cloud, attributes=attributes)


def _with_packed_colours(cloud: PointCloud, ascii: bool) -> PointCloud:  # noqa: A002
    """Return a cloud with `rgb` or `rgba` in place of channels of 8 bits; `rgb` is a float, as others expect it."""
    channels = {
        name: values
        for name, values in cloud.attributes.items()
        if name in _BYTES and values.dtype == np.uint8 and values.ndim == 1
    }
    if not channels.keys() >= {"red", "green", "blue"}:
        return cloud
    parts = np.zeros((len(cloud), 4), np.uint8)
    for channel, values in channels.items():
        parts[:, _BYTES[channel]] = values
    name = "rgba" if "alpha" in channels else "rgb"
    check_name(name, cloud.attributes)
    colours = parts.view("<u4" if name == "rgba" or ascii else "<f4")[:, 0]
    attributes = {name: colours} | {key: values for key, values in cloud.attributes.items() if key not in channels}
    return replace(cloud, attributes=attributes)


def write_pcd(file: BinaryIO, cloud: PointCloud, ascii: bool = False) -> None:  # noqa: A002
    """Write a PCD file with the attributes as fields, colours packed."""
    columns = columns_of(_with_packed_colours(cloud, ascii), flat=False, types=_TYPES)
    if _PADDING in columns:
        raise OutputError("expected a name other than '_', which PCD files give to padding; rename the attribute")
    lines = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(columns)}",
        f"SIZE {' '.join(str(values.dtype.itemsize) for values in columns.values())}",
        f"TYPE {' '.join(values.dtype.kind.upper() for values in columns.values())}",
        f"COUNT {' '.join(str(math.prod(values.shape[1:])) for values in columns.values())}",
        f"WIDTH {len(cloud)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(cloud)}",
        f"DATA {'ascii' if ascii else 'binary'}\n",
    ]
    file.write("\n".join(lines).encode())
    if ascii:
        flat = [values.reshape(len(cloud), math.prod(values.shape[1:])) for values in columns.values()]
        rows.write_rows(file, [column for values in flat for column in values.T])
    else:
        rows.write_records(file, list(columns.values()))


def _holds(name: str, values: Column) -> bool:
    """Return whether a PCD file holds an attribute."""
    dtype = exact_type(values, _TYPES)
    return dtype is not None and not _may_be_colour(name, dtype, values.ndim)


FORMAT = Format(
    "PCD",
    (".pcd",),
    open_pcd,
    write_pcd,
    begins(rb"(?:\xef\xbb\xbf)?(?:# \.PCD|(?:#[^\n]*\n|\s)*VERSION\s+0?\.\d\s+FIELDS\s)"),
    lambda cloud: keeping(with_byte_colours(cloud), _holds, plain_names=True),
    frozenset({"ascii"}),
)
