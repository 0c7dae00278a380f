"""Reads PLY files, text and binary of both byte orders, and writes binary ones."""

from __future__ import annotations

import os
import re
import struct
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BufferedReader
from itertools import islice
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, OutputError
from gppcs.io.columns import (
    Column,
    attribute_columns,
    cloud_of_columns,
    coordinate_names,
    coordinate_type,
    exact_as_double,
)
from gppcs.io.format import Format
from gppcs.io.rows import BLOCK, as_count, ends_early, lines_of, number_blocks, shown

_TYPES: dict[str, np.dtype[Any]] = {
    **{name: np.dtype("i1") for name in ("char", "int8")},
    **{name: np.dtype("u1") for name in ("uchar", "uint8")},
    **{name: np.dtype("i2") for name in ("short", "int16")},
    **{name: np.dtype("u2") for name in ("ushort", "uint16")},
    **{name: np.dtype("i4") for name in ("int", "int32")},
    **{name: np.dtype("u4") for name in ("uint", "uint32")},
    **{name: np.dtype("f4") for name in ("float", "float32")},
    **{name: np.dtype("f8") for name in ("double", "float64")},
}
_NAMES = {dtype: name for name, dtype in reversed(_TYPES.items())}  # of two names of a type, the older one
_Order = Literal["<", ">"]
_ORDERS: dict[str, _Order] = {"binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class _Property:
    name: str
    dtype: np.dtype[Any]
    length: np.dtype[Any] | None = None  # for a list, the type of the count before its items


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def has_lists(self) -> bool:
        return len(self.scalars) < len(self.properties)

    @property
    def scalars(self) -> list[_Property]:
        return [each for each in self.properties if each.length is None]

    def record(self, order: _Order) -> np.dtype[Any]:
        """Return the structured type of the scalar properties, packed."""
        return np.dtype([(each.name, each.dtype.newbyteorder(order)) for each in self.scalars])


@dataclass
class _Header:
    encoding: str = ""
    elements: list[_Element] = field(default_factory=list)
    lines: int = 0
    remarks: Counter[str] = field(default_factory=Counter)  # numbers of comments and of lines of obj_info


def read_ply(file: BufferedReader) -> PointCloud:
    """Read the vertices of a PLY file with their scalar properties. Lists and other elements are skipped.

    Parameters
    ----------
    file : binary file
        Open for reading, at its start.

    Returns
    -------
    PointCloud
        An attribute for each scalar property but x, y and z, in file order and of the property's type.

    Raises
    ------
    FileFormatError
        If the header is malformed, x, y or z is missing, a number is malformed, or the file ends early.
    """
    header = _read_header(file)
    before: list[_Element] = []
    for element in header.elements:
        if element.name == "vertex":
            break
        before.append(element)
    else:
        found = ", ".join(repr(each.name) for each in header.elements) or "none"
        raise FileFormatError(f"expected an element named vertex, found {found}")
    coordinate_names(each.name for each in element.scalars)
    if header.encoding == "ascii":
        return _read_text(file, header.lines, before, element)
    order = _ORDERS[header.encoding]
    for each in before:
        _skip(file, each, order)
    if element.has_lists:
        return _read_with_lists(file, element, order)
    return _read_records(file, element, order)


def unread_ply(file: BufferedReader) -> list[str]:
    """Return in words what `read_ply` leaves out of a file.

    Parameters
    ----------
    file : binary file
        Open for reading, at its start. It is one that `read_ply` can read.

    Returns
    -------
    list of str
        Comments, obj_info, the list properties of the vertices and the other elements, as far as there are any.
    """
    header = _read_header(file)
    words = {"comment": ("comment", "comments"), "obj_info": ("line of obj_info", "lines of obj_info")}
    found = [f"{count} {words[kind][count > 1]}" for kind, count in header.remarks.items()]
    for element in header.elements:
        if element.name == "vertex":
            found += [f"list property {each.name}" for each in element.properties if each.length is not None]
        elif element.count:
            found.append(f"element {element.name} ({element.count:,})")
    return found


def _read_header(file: BufferedReader) -> _Header:
    header = _Header()
    for line in iter(file.readline, b""):
        header.lines += 1
        text = line.decode("utf-8", "replace").rstrip("\r\n")
        if header.lines == 1 and text.rstrip() != "ply":
            raise FileFormatError(f"expected 'ply' as the first line of a PLY file, found {shown(text)}")
        if text.rstrip() == "end_header":
            if not header.encoding:
                raise FileFormatError("expected a line 'format ...' in the header, found none")
            return header
        if header.lines > 1:
            _take_header_line(header, text)
    raise FileFormatError("expected a line 'end_header', found the end of the file; get the whole file again")


def _take_header_line(header: _Header, line: str) -> None:
    match line.split():
        case []:
            pass
        case ["comment" | "obj_info" as kind, *_]:
            header.remarks[kind] += 1
        case ["format", encoding, "1.0"] if encoding == "ascii" or encoding in _ORDERS:
            header.encoding = encoding
        case ["element", name, text] if (count := as_count(text)) is not None:
            header.elements.append(_Element(name, count))
        case ["property", kind, name] if kind in _TYPES and header.elements:
            _add_property(header, _Property(name, _TYPES[kind]))
        case ["property", "list", length, kind, name] if (
            kind in _TYPES and length in _TYPES and _TYPES[length].kind in "iu" and header.elements
        ):
            _add_property(header, _Property(name, _TYPES[kind], _TYPES[length]))
        case _:
            raise FileFormatError(f"line {header.lines}: expected a PLY header, found {shown(line)}")


def _add_property(header: _Header, new: _Property) -> None:
    element = header.elements[-1]
    if any(each.name == new.name for each in element.properties):
        raise FileFormatError(
            f"line {header.lines}: expected different names, found {new.name!r} twice in {element.name}"
        )
    element.properties.append(new)


def _read_records(file: BufferedReader, element: _Element, order: _Order) -> PointCloud:
    """Read vertices of fixed size, block by block, so that each block stays in the processor's cache."""
    record, count = element.record(order), element.count
    whole = _bytes_left(file) // record.itemsize
    if whole < count:
        raise ends_early("vertex", whole, count)
    axes = coordinate_names(record.names or ())
    points = np.empty((count, 3))
    attributes = {each.name: np.empty(count, each.dtype) for each in element.properties if each.name not in axes}
    targets = [*zip(axes, points.T, strict=True), *attributes.items()]
    block = np.empty(min(count, BLOCK), record)
    for start in range(0, count, BLOCK):
        part = block[: count - start]
        file.readinto(part.view(np.uint8).data)
        for name, values in targets:
            values[start : start + BLOCK] = part[name]
    kept = np.result_type(*(record[axis] for axis in axes)).newbyteorder("=")
    return PointCloud(points, attributes, kept)


def _skip(file: BufferedReader, element: _Element, order: _Order) -> None:
    """Move the position in the file to the end of an element."""
    if element.has_lists:
        start = file.tell()
        file.seek(start + _walk(file.read(), element, order)[-1])
        return
    size = element.record(order).itemsize
    whole = _bytes_left(file) // size if size else element.count
    if whole < element.count:
        raise ends_early(element.name, whole, element.count)
    file.seek(element.count * size, os.SEEK_CUR)


def _bytes_left(file: BufferedReader) -> int:
    return os.fstat(file.fileno()).st_size - file.tell()


def _walk(data: bytes, element: _Element, order: _Order) -> NDArray[np.int64]:
    """Return the offsets, in bytes, of each record and of the end of each of its lists, and last the element's end."""
    lists = []  # of each list: bytes of scalars before it, its count, size of its items
    scalars = 0
    for each in element.properties:
        if each.length is not None:
            lists.append((scalars, struct.Struct(order + each.length.char), each.dtype.itemsize))
            scalars = 0
        else:
            scalars += each.dtype.itemsize
    position, starts = 0, []
    for i in range(element.count):
        starts.append(position)
        for before, count, item in lists:
            position += before
            length = count.unpack_from(data, position)[0] if position + count.size <= len(data) else 0
            if length < 0:
                raise FileFormatError(f"expected a list in {element.name} {i + 1}, found one of length {length}")
            position += count.size + length * item
            starts.append(position)
        position += scalars
        if position > len(data):
            raise ends_early(element.name, i, element.count)
    return np.array([*starts, position])


def _read_with_lists(file: BufferedReader, element: _Element, order: _Order) -> PointCloud:
    data = file.read()
    lists = len(element.properties) - len(element.scalars)
    starts = _walk(data, element, order)[:-1].reshape(element.count, lists + 1)
    raw = np.frombuffer(data, np.uint8)
    columns: dict[str, Column] = {}
    stretch = offset = 0
    for each in element.properties:
        if each.length is not None:
            stretch, offset = stretch + 1, 0
            continue
        size = each.dtype.itemsize
        where = starts[:, stretch, np.newaxis] + np.arange(offset, offset + size)
        values = raw[where].view(each.dtype.newbyteorder(order))[:, 0]
        columns[each.name] = values.astype(each.dtype)
        offset += size
    return cloud_of_columns(columns)


def _read_text(file: BufferedReader, first_line: int, before: list[_Element], element: _Element) -> PointCloud:
    lines = lines_of(file)
    for each in before:
        for i in range(each.count):
            first_line += 1
            if not next(lines, ""):
                raise ends_early(each.name, i, each.count)
    scalars = element.scalars
    numbers_of = _text_without_lists(element) if element.has_lists else str.strip
    blocks = number_blocks(lines, first_line + 1, numbers_of, width=len(scalars), count=element.count, what="vertex")
    values = np.concatenate([np.empty((0, len(scalars))), *(values for _, values in blocks)])
    return cloud_of_columns({each.name: _cast(values[:, i], each) for i, each in enumerate(scalars)})


def _text_without_lists(element: _Element) -> Callable[[str], str]:
    """Return a function that returns the scalars of a line of text."""

    def scalars(line: str) -> str:
        words = iter(line.split())
        kept = []
        for each in element.properties:
            if each.length is not None:
                length = as_count(next(words, ""))
                if length is None:
                    return line and "malformed"
                deque(islice(words, length), maxlen=0)
            else:
                kept.append(next(words, ""))
        return " ".join([*kept, *words]).strip()

    return scalars


def _cast(values: Column, to: _Property) -> Column:
    if to.dtype.kind in "iu":
        bounds = np.iinfo(to.dtype)
        fits = (values >= bounds.min) & (values <= bounds.max) & (values == np.rint(values))
        if not fits.all():
            wrong = int(np.argmin(fits))
            raise FileFormatError(
                f"expected a {_NAMES[to.dtype]} as {to.name} of vertex {wrong + 1}, found {values[wrong]:g}"
            )
    with np.errstate(over="ignore"):  # values beyond the range of float32 become infinite
        return values.astype(to.dtype)


def write_ply(file: BinaryIO, cloud: PointCloud) -> None:
    """Write a binary little-endian PLY file with the attributes as scalar properties.

    Booleans are written as uchar and half-precision numbers as float. PLY has no 64-bit integers: they are written as
    int, uint or double, the first that represents all values exactly.

    Parameters
    ----------
    file : binary file
        Open for writing.
    cloud : PointCloud
        The points and their attributes.

    Raises
    ------
    OutputError
        If no PLY type represents the values of an attribute exactly, or the coordinates do not fit the cloud's
        `coordinate_dtype`.
    """
    columns: dict[str, Column] = dict(zip("xyz", cloud.points.T, strict=True))
    types = dict.fromkeys(columns, _type_of_coordinates(cloud))
    for name, values in attribute_columns(cloud).items():
        columns[name], types[name] = values, _type_of(values, name)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(cloud)}",
        *(f"property {_NAMES[dtype]} {name}" for name, dtype in types.items()),
        "end_header\n",
    ]
    file.write("\n".join(header).encode())
    block = np.empty(min(len(cloud), BLOCK), [(name, dtype.newbyteorder("<")) for name, dtype in types.items()])
    for start in range(0, len(cloud), BLOCK):
        part = block[: len(cloud) - start]
        for name, values in columns.items():
            part[name] = values[start : start + BLOCK]
        file.write(part.data)


def _type_of_coordinates(cloud: PointCloud) -> np.dtype[Any]:
    kept = coordinate_type(cloud).newbyteorder("=")
    return kept if kept in _NAMES else _type_of(cloud.points.astype(kept), "x y z")


def _type_of(values: Column, name: str) -> np.dtype[Any]:
    """Return the PLY type that represents all values exactly."""
    dtype = values.dtype.newbyteorder("=")
    if dtype in _NAMES:
        return dtype
    if dtype.kind == "b":
        return np.dtype("u1")
    if dtype == np.float16:
        return np.dtype("f4")
    if dtype.kind in "iu":
        low, high = (int(values.min()), int(values.max())) if values.size else (0, 0)
        for narrow in (np.dtype("i4"), np.dtype("u4")):
            if np.iinfo(narrow).min <= low and high <= np.iinfo(narrow).max:
                return narrow
    if not exact_as_double(values):
        raise OutputError(
            f"expected numbers that a PLY file can store in {name!r}, found {dtype} beyond the precision of double; "
            "write .npz instead"
        )
    return np.dtype("f8")


FORMAT = Format(
    "PLY",
    (".ply",),
    read_ply,
    write_ply,
    lambda head, size: re.match(rb"ply[ \t]*\r?\n", head) is not None,
    unread_ply,
)
