"""Reads PLY files, text and binary of both byte orders, and writes text and little-endian ones."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from io import BufferedReader
from itertools import islice
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, coordinate_names
from gppcs.clouds.header import Header
from gppcs.errors import FileFormatError
from gppcs.io.columns import columns_of, exact_type
from gppcs.io.format import Format, Reader, Span, keeping
from gppcs.io.meshes import NO_FACES, triangles_of
from gppcs.io.rows import (
    as_count,
    at_most,
    bytes_left,
    cast,
    check_length,
    ends_early,
    equal_spans,
    is_row,
    lines_of,
    read_records,
    read_rows,
    shortened,
    write_records,
    write_rows,
)

_NAMES: dict[np.dtype[Any], str] = {
    np.dtype("i1"): "char",
    np.dtype("u1"): "uchar",
    np.dtype("i2"): "short",
    np.dtype("u2"): "ushort",
    np.dtype("i4"): "int",
    np.dtype("u4"): "uint",
    np.dtype("f4"): "float",
    np.dtype("f8"): "double",
}
_TYPES = {name: dtype for dtype, older in _NAMES.items() for name in (older, dtype.name)}
_Order = Literal["<", ">"]
_ORDERS: dict[str, _Order | None] = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}
# The numbers of a property in all records, one after the other, and how many of them each record has.
_Lists = tuple[Column, NDArray[np.int64]]


@dataclass(frozen=True, eq=False)
class PlyHeader(Header):
    """What a PLY file says of the whole cloud."""

    remarks: tuple[str, ...] = ()  # the lines that begin with `comment` or `obj_info`, whole

    def contents(self) -> list[str]:
        """Return the number of comments in words."""
        return [f"comments ({len(self.remarks)})"] if self.remarks else []


@dataclass(frozen=True)
class _Property:
    name: str
    dtype: np.dtype[Any]
    length: np.dtype[Any] | None = None  # for a list, the type of the count before its items

    @property
    def label(self) -> str:
        return f"a {_NAMES[self.dtype]} as {self.name}"


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
        return [column for column in self.properties if column.length is None]

    def record(self, order: _Order) -> np.dtype[Any]:
        """Return the structured type of the scalar properties, packed."""
        return np.dtype([(column.name, column.dtype.newbyteorder(order)) for column in self.scalars])


@dataclass
class _Header:
    encoding: str = ""
    elements: list[_Element] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def order(self) -> _Order | None:
        """The byte order of numbers; None if they are text."""
        return _ORDERS[self.encoding]

    def element(self, name: str) -> _Element:
        """Return an element; an empty one if there is none of the name."""
        return next((element for element in self.elements if element.name == name), _Element(name, 0))


def open_ply(file: BufferedReader) -> Reader:
    """Open a PLY file to read the numbers of its vertices. Their lists and other elements are skipped."""
    header = _read_header(file)
    order, start, vertices = header.order, file.tell(), header.element("vertex")
    if vertices not in header.elements:
        names = ", ".join(repr(element.name) for element in header.elements) or "none"
        raise FileFormatError(f"expected an element named vertex, found {names}")
    axes = coordinate_names(scalar.name for scalar in vertices.scalars)
    kept_header = PlyHeader(tuple(header.remarks)) if header.remarks else None

    def chunks(n: int, attributes: bool, span: Span | None = None) -> Iterator[PointCloud]:
        _seek(file, start, header, vertices)
        names = [column.name for column in vertices.scalars if attributes or column.name in axes]
        if order and not vertices.has_lists:
            clouds = read_records(file, vertices.record(order), vertices.count, n, "vertex", names, span)
        else:
            tables = _tables(file, order, vertices)
            clouds = at_most(n, (PointCloud.from_columns({name: table[name] for name in names}) for table in tables))
        for cloud in clouds:
            yield replace(cloud, header=kept_header)

    def spans(n: int) -> list[Span]:
        if not vertices.count or vertices.has_lists or not order:
            return []
        _seek(file, start, header, vertices)
        is_complete = bytes_left(file) >= vertices.count * vertices.record(order).itemsize
        return equal_spans(vertices.count, n) if is_complete else []

    def triangles() -> NDArray[np.int64]:
        faces = header.element("face")
        lists = [column.name for column in faces.properties if column.length and column.dtype.kind in "iu"]
        name = next((name for name in lists if name in ("vertex_indices", "vertex_index")), None)
        if name is None or not faces.count:
            return NO_FACES
        _seek(file, start, header, faces)
        corners, sizes = _lists(file, order, faces)[name]
        return triangles_of(sizes, corners.astype(np.int64))

    elements = [element for element in header.elements if element.name not in ("vertex", "face") and element.count]
    skipped = [f"list {column.name}" for column in vertices.properties if column.length]
    skipped += [f"element {element.name} ({element.count:,})" for element in elements]
    n_faces = header.element("face").count
    return Reader(
        chunks, vertices.count, n_faces=lambda: n_faces, skipped=lambda: skipped, spans=spans, triangles=triangles
    )


def _read_header(file: BufferedReader) -> _Header:
    header = _Header()
    for number, line in enumerate(iter(file.readline, b""), 1):
        text = line.decode("utf-8", "replace")
        match text.split():
            case ["ply"] if number == 1:
                pass
            case _ if number == 1:
                raise FileFormatError(f"expected 'ply' as the first line of a PLY file, found {shortened(text)}")
            case []:
                pass
            case ["end_header"] if header.encoding:
                return header
            case ["comment" | "obj_info", *_]:
                header.remarks.append(line.decode("utf-8", "surrogateescape").rstrip("\r\n"))
            case ["format", encoding, "1.0"] if encoding in _ORDERS:
                header.encoding = encoding
            case ["element", name, digits] if (count := as_count(digits)) is not None:
                header.elements.append(_Element(name, count))
            case ["property", *kinds, name] if header.elements and (new := _property(name, kinds)):
                columns = header.elements[-1].properties
                if name in (column.name for column in columns):
                    raise FileFormatError(f"line {number}: expected different names, found {name!r} twice")
                columns.append(new)
            case _:
                raise FileFormatError(f"line {number}: expected a PLY header, found {shortened(text)}")
    raise FileFormatError("expected a line 'end_header', found the end of the file; get the whole file again")


def _property(name: str, kinds: list[str]) -> _Property | None:
    """Return a property of a type, or a list of a type of its length and one of its items, if there are such types."""
    match [_TYPES.get(kind, kind) for kind in kinds]:
        case [np.dtype() as kind]:
            return _Property(name, kind)
        case ["list", np.dtype() as length, np.dtype() as kind] if length.kind in "iu":
            return _Property(name, kind, length)
    return None


def _seek(file: BufferedReader, start: int, header: _Header, element: _Element) -> None:
    """Move to the beginning of an element, given where the first one begins."""
    file.seek(start)
    for skipped in header.elements[: header.elements.index(element)]:
        if not header.order:
            for i in range(skipped.count):
                if not file.readline():
                    raise ends_early(skipped.name, i, skipped.count)
        elif skipped.has_lists:
            _lists(file, header.order, skipped)
        else:
            size = skipped.record(header.order).itemsize
            check_length(file, size, skipped.count, skipped.name)
            file.seek(skipped.count * size, os.SEEK_CUR)


def _tables(file: BufferedReader, order: _Order | None, element: _Element) -> Iterator[dict[str, Column]]:
    """Yield the numbers of an element of a text file, or of one with lists, as blocks of columns."""
    if element.has_lists:
        yield {name: values for name, (values, _) in _lists(file, order, element).items()}
        return
    first = 0
    for block in read_rows(lines_of(file), len(element.scalars), element.count, element.name):
        yield {
            scalar.name: cast(values, scalar.dtype, f"{scalar.label} of {element.name}", first)
            for scalar, values in zip(element.scalars, block, strict=True)
        }
        first += len(block[0])


def _lists(file: BufferedReader, order: _Order | None, element: _Element) -> dict[str, _Lists]:
    """Read an element with lists."""
    if order is None:
        return _text_lists(file, element)
    start = file.tell()
    columns, size = _binary_lists(file.read(), order, element)
    file.seek(start + size)
    return columns


def _binary_lists(data: bytes, order: _Order, element: _Element) -> tuple[dict[str, _Lists], int]:
    """Return the numbers of an element with lists, and its size in bytes."""
    counts = {column.name: struct.Struct(order + column.length.char) for column in element.properties if column.length}
    parts: dict[str, list[bytes]] = {column.name: [] for column in element.properties}
    position = 0
    for i in range(element.count):
        for column in element.properties:
            length = 1
            if count := counts.get(column.name):
                length = count.unpack_from(data, position)[0] if position + count.size <= len(data) else 0
                position += count.size
                if not 0 <= length < 2**63 or length != int(length):
                    raise FileFormatError(f"expected a list in {element.name} {i + 1}, found one of length {length:g}")
            begin = position
            position += int(length) * column.dtype.itemsize
            parts[column.name].append(data[begin:position])
        if position > len(data):
            raise ends_early(element.name, i, element.count)
    columns = {}
    for column in element.properties:
        content, size = parts[column.name], column.dtype.itemsize
        values = np.frombuffer(b"".join(content), column.dtype.newbyteorder(order)).astype(column.dtype)
        columns[column.name] = values, np.array([len(part) // size for part in content], np.int64)
    return columns, position


def _text_lists(file: BufferedReader, element: _Element) -> dict[str, _Lists]:
    """Read an element with lists of a text file, as if it were one of double numbers."""
    double = np.dtype(np.float64)
    columns = [replace(column, dtype=double, length=column.length and double) for column in element.properties]
    try:
        numbers = np.array(" ".join(islice(filter(is_row, lines_of(file)), element.count)).split(), "<f8")
    except ValueError as error:
        raise FileFormatError(f"expected numbers in {element.name}, but {error}") from error
    lists, size = _binary_lists(numbers.tobytes(), "<", replace(element, properties=columns))
    if size < numbers.nbytes:
        raise FileFormatError(f"expected {size // 8:,} numbers in {element.name}, found {len(numbers):,}")
    return {
        column.name: (cast(lists[column.name][0], column.dtype, f"{column.label}, value"), lists[column.name][1])
        for column in element.properties
    }


def write_ply(
    file: BinaryIO,
    cloud: PointCloud,
    ascii: bool = False,  # noqa: A002
    faces: NDArray[np.int64] | None = None,
) -> None:
    """Write a PLY file with the attributes as properties; 64-bit integers take the first type that is exact."""
    columns = columns_of(cloud)
    types = {name: exact_type(values, _NAMES) or np.dtype("f8") for name, values in columns.items()}
    lines = [
        "ply",
        f"format {'ascii' if ascii else 'binary_little_endian'} 1.0",
        *(cloud.header.remarks if isinstance(cloud.header, PlyHeader) else ()),
        f"element vertex {len(cloud)}",
        *(f"property {_NAMES[dtype]} {name}" for name, dtype in types.items()),
        *([] if faces is None else [f"element face {len(faces)}", "property list uchar int vertex_indices"]),
        "end_header\n",
    ]
    file.write("\n".join(lines).encode("utf-8", "surrogateescape"))
    if ascii:
        write_rows(file, [values.astype(types[name]) for name, values in columns.items()])
    else:
        write_records(file, [(values, types[name]) for name, values in columns.items()])
    if faces is not None and ascii:
        write_rows(file, list(faces.T), prefix="3 ")
    elif faces is not None:
        write_records(file, [(np.full(len(faces), 3), np.dtype("u1")), (faces, np.dtype("i4"))])


def _holds(name: str, values: Column) -> bool:
    return exact_type(values, _NAMES) is not None and 0 not in values.shape[1:]


FORMAT = Format(
    "PLY",
    (".ply",),
    open_ply,
    write_ply,
    lambda start, size: re.match(rb"ply[ \t]*\r?\n", start) is not None,
    lambda cloud: keeping(cloud, _holds, PlyHeader, plain_names=True),
    frozenset({"ascii", "faces"}),
)
