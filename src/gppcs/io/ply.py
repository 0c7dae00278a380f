"""Reads PLY files, text and binary of both byte orders, and writes text and little-endian ones."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from io import BufferedReader
from itertools import islice
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, cloud_of_columns, coordinate_names
from gppcs.clouds.header import Header
from gppcs.errors import FileFormatError
from gppcs.io.columns import check_name, column_name, columns_of, exact_type
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


@dataclass(frozen=True, eq=False)
class PlyHeader(Header):
    """What a PLY file says of the whole cloud."""

    remarks: tuple[str, ...] = ()  # the lines that begin with `comment` or `obj_info`, whole
    lists: Mapping[str, np.dtype[Any]] = field(default_factory=dict)  # types of the lengths of attributes with lists

    def contents(self) -> list[str]:
        """Return the numbers of comments and of lines of obj_info in words."""
        nouns = {"comment": ("comment", "comments"), "obj_info": ("line of obj_info", "lines of obj_info")}
        counts = {kind: sum(line.split()[0] == kind for line in self.remarks) for kind in nouns}
        return [f"{count} {nouns[kind][count > 1]}" for kind, count in counts.items() if count]


@dataclass(frozen=True)
class _Property:
    name: str
    dtype: np.dtype[Any]
    length: np.dtype[Any] | None = None  # for a list, the type of the count before its items

    @property
    def label(self) -> str:
        return f"a {_NAMES[self.dtype]} as {self.name}"

    @property
    def line(self) -> str:
        """The line of the header that declares the property."""
        kind = _NAMES[self.dtype]
        return f"property {kind if self.length is None else f'list {_NAMES[self.length]} {kind}'} {self.name}"


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
    lines: int = 0
    remarks: list[str] = field(default_factory=list)

    @property
    def order(self) -> _Order | None:
        """The byte order of numbers; None if they are text."""
        return _ORDERS[self.encoding]

    def element(self, name: str) -> _Element:
        """Return an element; an empty one if there is none of the name."""
        return next((element for element in self.elements if element.name == name), _Element(name, 0))

    def kept(self) -> PlyHeader | None:
        """Return what a cloud keeps of the header, or None if that is nothing."""
        columns = self.element("vertex").properties
        lists = {column.name: column.length for column in columns if column.length is not None}
        return PlyHeader(tuple(self.remarks), lists) if self.remarks or lists else None


def open_ply(file: BufferedReader) -> Reader:
    """Open a PLY file to read its vertices. Those with lists are read at once; other elements are skipped."""
    header = _read_header(file)
    start, vertices = file.tell(), header.element("vertex")
    if vertices not in header.elements:
        names = ", ".join(repr(element.name) for element in header.elements) or "none"
        raise FileFormatError(f"expected an element named vertex, found {names}")
    axes = coordinate_names(scalar.name for scalar in vertices.scalars)

    def chunks(n: int, attributes: bool, span: Span | None = None) -> Iterator[PointCloud]:
        file.seek(start)
        _skip_to(file, header, vertices)
        clouds: Iterator[PointCloud]
        if header.order and not vertices.has_lists:
            kept = [column.name for column in vertices.properties if attributes]
            clouds = read_records(file, vertices.record(header.order), vertices.count, n, "vertex", kept, span)
        else:
            names = [column.name for column in vertices.properties if attributes or column.name in axes]
            tables = _tables(file, header.order, vertices)
            clouds = (cloud_of_columns({name: table[name] for name in names}) for table in tables)
            clouds = clouds if vertices.has_lists else at_most(n, clouds)
        for cloud in clouds:
            yield replace(cloud, header=header.kept())

    def spans(n: int) -> list[Span]:
        if not vertices.count or vertices.has_lists or not header.order:
            return []
        file.seek(start)
        _skip_to(file, header, vertices)
        is_complete = bytes_left(file) >= vertices.count * vertices.record(header.order).itemsize
        return equal_spans(vertices.count, n) if is_complete else []

    def triangles() -> NDArray[np.int64]:
        faces = header.element("face")
        lists = [column.name for column in faces.properties if column.length and column.dtype.kind in "iu"]
        name = next((name for name in lists if name in ("vertex_indices", "vertex_index")), None)
        if name is None or not faces.count:
            return NO_FACES
        file.seek(start)
        _skip_to(file, header, faces)
        [table] = _tables(file, header.order, faces)
        polygons = table[name]
        return triangles_of(np.array([*map(len, polygons)]), np.concatenate([*polygons]).astype(np.int64))

    elements = [element for element in header.elements if element.name not in ("vertex", "face") and element.count]
    return Reader(
        chunks,
        vertices.count,
        n_faces=lambda: sum(element.count for element in header.elements if element.name == "face"),
        skipped=lambda: [f"element {element.name} ({element.count:,})" for element in elements],
        spans=spans,
        triangles=triangles,
    )


def _read_header(file: BufferedReader) -> _Header:
    header = _Header()
    for line in iter(file.readline, b""):
        header.lines += 1
        text = line.decode("utf-8", "replace").rstrip("\r\n")
        if header.lines == 1 and text.rstrip() != "ply":
            raise FileFormatError(f"expected 'ply' as the first line of a PLY file, found {shortened(text)}")
        if text.rstrip() == "end_header":
            if not header.encoding:
                raise FileFormatError("expected a line 'format ...' in the header, found none")
            return header
        if text.split()[:1] in (["comment"], ["obj_info"]):
            header.remarks.append(line.decode("utf-8", "surrogateescape").rstrip("\r\n"))
        elif header.lines > 1:
            _take_header_line(header, text)
    raise FileFormatError("expected a line 'end_header', found the end of the file; get the whole file again")


def _take_header_line(header: _Header, line: str) -> None:
    match line.split():
        case []:
            pass
        case ["format", encoding, "1.0"] if encoding in _ORDERS:
            header.encoding = encoding
        case ["element", name, text] if (count := as_count(text)) is not None:
            header.elements.append(_Element(name, count))
        case ["property", *kinds, name] if header.elements and (new := _property(name, kinds)):
            element = header.elements[-1]
            if any(column.name == name for column in element.properties):
                raise FileFormatError(
                    f"line {header.lines}: expected different names, found {name!r} twice in {element.name}"
                )
            element.properties.append(new)
        case _:
            raise FileFormatError(f"line {header.lines}: expected a PLY header, found {shortened(line)}")


def _property(name: str, kinds: list[str]) -> _Property | None:
    """Return a property of a type, or a list of a type of its length and one of its items, if there are such types."""
    match [_TYPES.get(kind, kind) for kind in kinds]:
        case [np.dtype() as kind]:
            return _Property(name, kind)
        case ["list", np.dtype() as length, np.dtype() as kind] if length.kind in "iu":
            return _Property(name, kind, length)
    return None


def _skip_to(file: BufferedReader, header: _Header, element: _Element) -> None:
    """Move the position in the file to the beginning of an element."""
    for skipped in header.elements[: header.elements.index(element)]:
        if not header.order:
            for i in range(skipped.count):
                if not file.readline():
                    raise ends_early(skipped.name, i, skipped.count)
        elif skipped.has_lists:
            start = file.tell()
            file.seek(start + _with_lists(file.read(), skipped, header.order)[1])
        else:
            size = skipped.record(header.order).itemsize
            check_length(file, size, skipped.count, skipped.name)
            file.seek(skipped.count * size, os.SEEK_CUR)


def _tables(file: BufferedReader, order: _Order | None, element: _Element) -> Iterator[dict[str, Column]]:
    """Yield an element as blocks of columns, one with lists as one block."""
    return iter([_with_lists(file.read(), element, order)[0]]) if order else _text_tables(file, element)


def _with_lists(data: bytes, element: _Element, order: _Order) -> tuple[dict[str, Column], int]:
    """Return the columns of an element with lists, and its size in bytes."""
    counts = {column.name: struct.Struct(order + column.length.char) for column in element.properties if column.length}
    parts: dict[str, list[bytes]] = {column.name: [] for column in element.properties}
    position = 0
    for i in range(element.count):
        for column in element.properties:
            length = 1
            if count := counts.get(column.name):
                length = count.unpack_from(data, position)[0] if position + count.size <= len(data) else 0
                position += count.size
            if length < 0:
                raise FileFormatError(f"expected a list in {element.name} {i + 1}, found one of length {length}")
            end = position + length * column.dtype.itemsize
            parts[column.name].append(data[position:end])
            position = end
        if position > len(data):
            raise ends_early(element.name, i, element.count)
    columns = {}
    for column in element.properties:
        values = np.frombuffer(b"".join(parts[column.name]), column.dtype.newbyteorder(order)).astype(column.dtype)
        lengths = np.array([len(part) // column.dtype.itemsize for part in parts[column.name]], np.int64)
        columns[column.name] = values if column.length is None else _lists(values, lengths)
    return columns, position


def _lists(items: Column, lengths: NDArray[np.int64]) -> Column:
    """Return the items of all lists as one row for each list, or as an array of arrays if the lengths differ."""
    if len(lengths) == 0 or (lengths == lengths[0]).all():
        return items.reshape(len(lengths), lengths[0] if len(lengths) else 0)
    lists = np.empty(len(lengths), dtype=object)
    lists[:] = np.split(items, np.cumsum(lengths)[:-1])
    return lists


def _text_tables(file: BufferedReader, element: _Element) -> Iterator[dict[str, Column]]:
    """Yield an element of a text file as blocks of columns, one with lists as one block."""
    if element.has_lists:
        yield _text_with_lists(file, element)
        return
    first = 0
    for block in read_rows(lines_of(file), len(element.scalars), element.count, element.name):
        yield {
            scalar.name: cast(values, scalar.dtype, f"{scalar.label} of {element.name}", first)
            for scalar, values in zip(element.scalars, block, strict=True)
        }
        first += len(block[0])


def _text_with_lists(file: BufferedReader, element: _Element) -> dict[str, Column]:
    """Read an element with lists of a text file."""
    items: dict[str, list[list[str]]] = {column.name: [] for column in element.properties}
    n_read = 0
    for n_read, line in enumerate(islice(filter(is_row, lines_of(file)), element.count), 1):
        fields = iter(line.split())
        for column in element.properties:
            length = as_count(next(fields, "")) if column.length is not None else 1
            item = [*islice(fields, length)]
            if length is None or len(item) < length:
                raise FileFormatError(f"{element.name} {n_read}: expected more numbers, found {shortened(line)}")
            items[column.name].append(item)
        if next(fields, None) is not None:
            raise FileFormatError(f"{element.name} {n_read}: expected fewer numbers, found {shortened(line)}")
    if n_read < element.count:
        raise ends_early(element.name, n_read, element.count)
    return {column.name: _parsed(column, items[column.name]) for column in element.properties}


def _parsed(column: _Property, texts: list[list[str]]) -> Column:
    """Return the values of a property, given the texts of its numbers for each record."""
    try:
        numbers = np.array([float(text) for record in texts for text in record])
    except ValueError as error:
        raise FileFormatError(f"expected {column.label}, but {error}") from error
    values = cast(numbers, column.dtype, f"{column.label}, value")
    return values if column.length is None else _lists(values, np.array([len(record) for record in texts], np.int64))


def write_ply(
    file: BinaryIO,
    cloud: PointCloud,
    ascii: bool = False,  # noqa: A002
    faces: NDArray[np.int64] | None = None,
) -> None:
    """Write a PLY file with the attributes as properties; 64-bit integers take the first type that is exact."""
    header = cloud.header if isinstance(cloud.header, PlyHeader) else PlyHeader()
    fields = _fields(cloud, header)
    lines = [
        "ply",
        f"format {'ascii' if ascii else 'binary_little_endian'} 1.0",
        *header.remarks,
        f"element vertex {len(cloud)}",
        *(column.line for column, _ in fields),
        *([] if faces is None else [f"element face {len(faces)}", "property list uchar int vertex_indices"]),
        "end_header\n",
    ]
    file.write("\n".join(lines).encode("utf-8", "surrogateescape"))
    if ascii:
        write_rows(file, [values if column.length else values.astype(column.dtype) for column, values in fields])
    elif any(column.length is not None for column, _ in fields):
        packed = [_packed(column, values) for column, values in fields]
        file.writelines(b"".join(row) for row in zip(*packed, strict=True))
    else:
        write_records(file, [(values, column.dtype) for column, values in fields])
    if faces is not None and ascii:
        write_rows(file, list(faces.T), prefix="3 ")
    elif faces is not None:
        write_records(file, [(np.full(len(faces), 3), np.dtype("u1")), (faces, np.dtype("i4"))])


def _packed(column: _Property, values: Iterable[Any]) -> Iterator[bytes]:
    """Yield the bytes of each vertex."""
    for value in values:
        items = np.asarray(value, column.dtype.newbyteorder("<")).tobytes()
        length = b"" if column.length is None else np.asarray(len(value), column.length.newbyteorder("<")).tobytes()
        yield length + items


def _fields(cloud: PointCloud, header: PlyHeader) -> list[tuple[_Property, Column]]:
    """Return what is written of each vertex, numbers first, then lists."""
    lists = [name for name, values in cloud.attributes.items() if _is_lists(values) or name in header.lists]
    scalars = {name: values for name, values in cloud.attributes.items() if name not in lists}
    columns = columns_of(replace(cloud, attributes=scalars))
    points = np.stack([columns[axis] for axis in "xyz"])  # of one type
    fields = [
        (_Property(name, _type_of(points if name in "xyz" else values)), values) for name, values in columns.items()
    ]
    for attribute in lists:
        name, values = column_name(attribute), cloud.attributes[attribute]
        check_name(name, [column.name for column, _ in fields])
        items = np.concatenate([np.ravel(value) for value in values]) if len(values) else values.reshape(-1)
        longest = max(map(len, values), default=0)
        length = header.lists.get(attribute, np.min_scalar_type(longest))
        dtype = np.dtype("u1") if items.dtype.hasobject else _type_of(items)
        typed = np.empty(len(values), object)
        for i, value in enumerate(values):
            typed[i] = value.astype(dtype)
        fields.append((_Property(name, dtype, length), typed))
    return fields


def _type_of(values: Column) -> np.dtype[Any]:
    """Return the PLY type that represents all values exactly, or else the widest."""
    return exact_type(values, _NAMES) or np.dtype("f8")


def _is_lists(values: Column) -> bool:
    """Return whether an attribute holds an array of numbers of any length for each point."""
    return (
        values.dtype.hasobject
        and values.ndim == 1
        and all(isinstance(v, np.ndarray) and v.ndim == 1 and v.dtype.kind in "biuf" for v in values)
    )


def _stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud as `write_ply` stores it."""
    lists = cloud.header.lists if isinstance(cloud.header, PlyHeader) else {}
    return keeping(
        cloud,
        lambda name, values: (
            (exact_type(values, _NAMES) or _is_lists(values)) and (0 not in values.shape[1:] or name in lists)
        ),
        PlyHeader,
        plain_names=True,
    )


FORMAT = Format(
    "PLY",
    (".ply",),
    open_ply,
    write_ply,
    lambda start, size: re.match(rb"ply[ \t]*\r?\n", start) is not None,
    _stored,
    frozenset({"ascii", "faces"}),
)
