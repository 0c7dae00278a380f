"""Reads PLY files, text and binary of both byte orders, and writes text and little-endian ones."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Callable, Iterator, Mapping
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
from gppcs.io.format import Format, Span, keeping, without_attributes
from gppcs.io.meshes import triangles_of
from gppcs.io.rows import (
    BLOCK,
    as_count,
    as_found,
    at_most,
    cast,
    check_length,
    ends_early,
    equal_spans,
    lines_of,
    number_blocks,
    read_records,
    texts_of,
    write_records,
    write_rows,
)

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


@dataclass(frozen=True, eq=False)
class PlyHeader(Header):
    """What a PLY file says of the whole cloud."""

    remarks: tuple[str, ...] = ()  # the lines that begin with `comment` or `obj_info`, whole
    lists: Mapping[str, np.dtype[Any]] = field(default_factory=dict)  # types of the lengths of attributes with lists

    def contents(self) -> list[str]:
        """Return the numbers of comments and of lines of obj_info in words."""
        words = {"comment": ("comment", "comments"), "obj_info": ("line of obj_info", "lines of obj_info")}
        counts = {kind: sum(line.split()[0] == kind for line in self.remarks) for kind in words}
        return [f"{count} {words[kind][count > 1]}" for kind, count in counts.items() if count]


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
        return [each for each in self.properties if each.length is None]

    def record(self, order: _Order) -> np.dtype[Any]:
        """Return the structured type of the scalar properties, packed."""
        return np.dtype([(each.name, each.dtype.newbyteorder(order)) for each in self.scalars])


@dataclass
class _Header:
    encoding: str = ""
    elements: list[_Element] = field(default_factory=list)
    lines: int = 0
    remarks: list[str] = field(default_factory=list)

    def kept(self, vertices: _Element) -> PlyHeader | None:
        """Return what a cloud keeps of the header, or None if that is nothing."""
        lists = {each.name: each.length for each in vertices.properties if each.length is not None}
        return PlyHeader(tuple(self.remarks), lists) if self.remarks or lists else None


def read_ply(file: BufferedReader, rows: int, attributes: bool, span: Span | None = None) -> Iterator[PointCloud]:
    """Read the vertices of a PLY file in chunks, those with lists as one. Other elements are skipped."""
    header = _read_header(file)
    names = [each.name for each in header.elements]
    if "vertex" not in names:
        raise FileFormatError(f"expected an element named vertex, found {', '.join(map(repr, names)) or 'none'}")
    vertices = header.elements[names.index("vertex")]
    axes = coordinate_names(each.name for each in vertices.scalars)
    clouds: Iterator[PointCloud]
    _skip_to(file, header, vertices)
    if header.encoding == "ascii":
        tables = _text_tables(file, header, vertices)
        kept = [each.name for each in vertices.properties if attributes or each.name in axes]
        parts = (cloud_of_columns({name: table[name] for name in kept}) for table in tables)
        clouds = parts if vertices.has_lists else at_most(rows, parts)
    elif vertices.has_lists:
        clouds = iter([cloud_of_columns(_with_lists(file, vertices, _ORDERS[header.encoding]))])
    else:
        kept = [each.name for each in vertices.properties if attributes]
        record = vertices.record(_ORDERS[header.encoding])
        clouds = read_records(file, record, vertices.count, rows, "vertex", kept, span)
    for cloud in clouds:
        yield replace(cloud, header=header.kept(vertices))


def unread_ply(file: BufferedReader) -> list[str]:
    """Return in words which elements `read_ply` leaves out of a file."""
    others = (each for each in _read_header(file).elements if each.name not in ("vertex", "face"))
    return [f"element {each.name} ({each.count:,})" for each in others if each.count]


def spans_of_ply(file: BufferedReader, rows: int) -> list[Span]:
    """Divide the vertices of a binary file without lists into parts that can be read by themselves."""
    header = _read_header(file)
    vertices = next((each for each in header.elements if each.name == "vertex"), None)
    if vertices is None or vertices.has_lists or header.encoding == "ascii":
        return []
    _skip_to(file, header, vertices)
    return equal_spans(file, vertices.record("<").itemsize, vertices.count, rows)


def count_ply(file: BufferedReader) -> int:
    """Return how many points a PLY file has, as its header says."""
    return next((element.count for element in _read_header(file).elements if element.name == "vertex"), 0)


def count_ply_faces(file: BufferedReader) -> int:
    """Return the number of faces in a PLY file."""
    return sum(element.count for element in _read_header(file).elements if element.name == "face")


def ply_triangles(file: BufferedReader) -> NDArray[np.int64]:
    """Read the faces of a PLY file as triangles."""
    header = _read_header(file)
    faces = next((each for each in header.elements if each.name == "face"), None)
    named = [each.name for each in faces.properties if each.length and each.dtype.kind in "iu"] if faces else []
    name = next((name for name in named if name in ("vertex_indices", "vertex_index")), None)
    if faces is None or name is None or not faces.count:
        return np.empty((0, 3), np.int64)
    _skip_to(file, header, faces)
    if header.encoding == "ascii":
        [table] = _text_tables(file, header, faces)
    else:
        table = _with_lists(file, faces, _ORDERS[header.encoding])
    lists = table[name]
    return triangles_of(np.array([*map(len, lists)]), np.concatenate([*lists]).astype(np.int64))


def _read_header(file: BufferedReader) -> _Header:
    header = _Header()
    for line in iter(file.readline, b""):
        header.lines += 1
        text = line.decode("utf-8", "replace").rstrip("\r\n")
        if header.lines == 1 and text.rstrip() != "ply":
            raise FileFormatError(f"expected 'ply' as the first line of a PLY file, found {as_found(text)}")
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
            raise FileFormatError(f"line {header.lines}: expected a PLY header, found {as_found(line)}")


def _add_property(header: _Header, new: _Property) -> None:
    element = header.elements[-1]
    if any(each.name == new.name for each in element.properties):
        raise FileFormatError(
            f"line {header.lines}: expected different names, found {new.name!r} twice in {element.name}"
        )
    element.properties.append(new)


def _skip_to(file: BufferedReader, header: _Header, element: _Element) -> None:
    """Move the position in the file to the beginning of an element."""
    for each in header.elements[: header.elements.index(element)]:
        if header.encoding != "ascii":
            _skip(file, each, _ORDERS[header.encoding])
            continue
        for i in range(each.count):
            header.lines += 1
            if not file.readline():
                raise ends_early(each.name, i, each.count)


def _skip(file: BufferedReader, element: _Element, order: _Order) -> None:
    """Move the position in the file to the end of an element."""
    if element.has_lists:
        start = file.tell()
        file.seek(start + _walk(file.read(), element, order)[-1])
        return
    size = element.record(order).itemsize
    check_length(file, size, element.count, element.name)
    file.seek(element.count * size, os.SEEK_CUR)


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


def _with_lists(file: BufferedReader, element: _Element, order: _Order) -> dict[str, Column]:
    """Read an element with lists."""
    data = file.read()
    lists = len(element.properties) - len(element.scalars)
    starts = _walk(data, element, order)[:-1].reshape(element.count, lists + 1)
    raw = np.frombuffer(data, np.uint8)

    def values(first: NDArray[np.int64], dtype: np.dtype[Any]) -> Column:
        """Return the values of a type that begin at some bytes."""
        found = raw[first[..., np.newaxis] + np.arange(dtype.itemsize)].view(dtype.newbyteorder(order))
        return found[..., 0].astype(dtype)

    columns: dict[str, Column] = {}
    stretch = offset = 0
    for each in element.properties:
        first = starts[:, stretch] + offset
        if each.length is None:
            columns[each.name] = values(first, each.dtype)
            offset += each.dtype.itemsize
        else:
            lengths = values(first, each.length).astype(np.int64)
            places = _consecutive(first + each.length.itemsize, lengths, each.dtype.itemsize)
            columns[each.name] = _lists(values(places, each.dtype), lengths)
            stretch, offset = stretch + 1, 0
    return columns


def _consecutive(first: NDArray[np.int64], lengths: NDArray[np.int64], step: int) -> NDArray[np.int64]:
    """Return where the items of all lists begin, list by list, given where the first of each list begins."""
    ends = np.cumsum(lengths)
    return np.repeat(first - step * (ends - lengths), lengths) + step * np.arange(lengths.sum())


def _lists(items: Column, lengths: NDArray[np.int64]) -> Column:
    """Return the items of all lists as one row for each list, or as an array of arrays if the lengths differ."""
    if len(lengths) == 0 or (lengths == lengths[0]).all():
        return items.reshape(len(lengths), lengths[0] if len(lengths) else 0)
    lists = np.empty(len(lengths), dtype=object)
    lists[:] = np.split(items, np.cumsum(lengths)[:-1])
    return lists


def _text_tables(file: BufferedReader, header: _Header, element: _Element) -> Iterator[dict[str, Column]]:
    """Yield an element of a text file as blocks of columns, one with lists as one block."""
    scalars = element.scalars
    words: dict[str, list[list[str]]] = {each.name: [] for each in element.properties if each.length is not None}
    width = len(scalars) or 1
    numbers_of = _text_without_lists(element, words) if words else str.strip
    blocks = number_blocks(
        lines_of(file), header.lines + 1, numbers_of, width=width, count=element.count, what=element.name
    )
    if words or not element.count:  # the lengths of all lists tell how they are held
        found = [[np.empty(0, np.int64)] * width, *blocks]
        blocks = iter([[np.concatenate(columns) for columns in zip(*found, strict=True)]])
    first = 0
    for table in blocks:
        numbers = iter(table)
        yield {
            each.name: cast(next(numbers), each.dtype, f"{each.label} of vertex", first)
            if each.length is None
            else _text_lists(words[each.name], each)
            for each in element.properties
        }
        first += len(table[0])


def _text_without_lists(element: _Element, lists: Mapping[str, list[list[str]]]) -> Callable[[str], str]:
    """Return a function that returns the scalars of a line of text, and appends the words of each list to `lists`."""

    def scalars(line: str) -> str:
        words = iter(line.split())
        kept = [] if element.scalars else ["0"]  # so that each line has a number
        for each in element.properties:
            if each.length is not None:
                length = as_count(next(words, ""))
                if length is None:
                    return line and "malformed"
                lists[each.name].append(list(islice(words, length)))
                if len(lists[each.name][-1]) < length:
                    return line and "malformed"
            else:
                kept.append(next(words, ""))
        return " ".join([*kept, *words]).strip()

    return scalars


def _text_lists(lists: list[list[str]], to: _Property) -> Column:
    try:
        items = np.array([float(word) for words in lists for word in words])
    except ValueError as error:
        raise FileFormatError(f"expected numbers in the list {to.name}, but {error}") from error
    return _lists(
        cast(items, to.dtype, f"{to.label} of all lists, item"),
        np.array([len(words) for words in lists], dtype=np.int64),
    )


@dataclass(frozen=True)
class _Field:
    """What is written of each vertex under one name: a number, or a list if `length` is the type of its length."""

    name: str
    values: Column
    dtype: np.dtype[Any]
    length: np.dtype[Any] | None = None

    def line(self) -> str:
        """Return the line of the header that declares the property."""
        kind = _NAMES[self.dtype]
        return f"property {kind if self.length is None else f'list {_NAMES[self.length]} {kind}'} {self.name}"

    def rows(self, start: int) -> Iterator[bytes]:
        """Yield the bytes of each vertex of a block."""
        for value in self.values[start : start + BLOCK]:
            items = np.asarray(value, self.dtype.newbyteorder("<")).tobytes()
            if self.length is not None:
                yield np.asarray(len(value), self.length.newbyteorder("<")).tobytes() + items
            else:
                yield items

    def texts(self, start: int) -> Iterator[str]:
        """Yield the text of each vertex of a block."""
        block = self.values[start : start + BLOCK]
        if self.length is None:
            yield from texts_of(block.astype(self.dtype))
        else:
            yield from (" ".join([str(len(each)), *texts_of(np.asarray(each, self.dtype))]) for each in block)


def write_ply(
    file: BinaryIO,
    cloud: PointCloud,
    ascii: bool = False,  # noqa: A002
    faces: NDArray[np.int64] | None = None,
) -> None:
    """Write a PLY file with the attributes as properties.

    Booleans are written as uchar and half-precision numbers as float. PLY has no 64-bit integers: they are written as
    int, uint or double, the first that represents all values exactly.
    """
    header = cloud.header if isinstance(cloud.header, PlyHeader) else PlyHeader()
    fields = _fields(cloud, header)
    lines = [
        "ply",
        f"format {'ascii' if ascii else 'binary_little_endian'} 1.0",
        *header.remarks,
        f"element vertex {len(cloud)}",
        *(each.line() for each in fields),
        *([] if faces is None else [f"element face {len(faces)}", "property list uchar int vertex_indices"]),
        "end_header\n",
    ]
    file.write("\n".join(lines).encode("utf-8", "surrogateescape"))
    if ascii:
        for start in range(0, len(cloud), BLOCK):
            file.writelines(
                f"{' '.join(row)}\n".encode() for row in zip(*(each.texts(start) for each in fields), strict=True)
            )
    elif any(each.length is not None for each in fields):
        for start in range(0, len(cloud), BLOCK):
            file.writelines(b"".join(row) for row in zip(*(each.rows(start) for each in fields), strict=True))
    else:
        write_records(file, [(each.values, each.dtype) for each in fields])
    if faces is not None and ascii:
        write_rows(file, list(faces.T), prefix="3 ")
    elif faces is not None:
        write_records(file, [(np.full(len(faces), 3), np.dtype("u1")), (faces, np.dtype("i4"))])


def _fields(cloud: PointCloud, header: PlyHeader) -> list[_Field]:
    lists = [name for name, values in cloud.attributes.items() if _is_lists(values) or name in header.lists]
    columns = columns_of(without_attributes(cloud, lists)[0])
    points = np.stack([columns[axis] for axis in "xyz"])  # of one type
    fields = [_Field(name, values, _type_of(points if name in "xyz" else values)) for name, values in columns.items()]
    for attribute in lists:
        name, values = column_name(attribute), cloud.attributes[attribute]
        check_name(name, [each.name for each in fields])
        items = np.concatenate([np.ravel(value) for value in values]) if len(values) else values.reshape(-1)
        longest = max(map(len, values), default=0)
        length = header.lists.get(attribute, np.min_scalar_type(longest))
        fields.append(_Field(name, values, np.dtype("u1") if items.dtype.hasobject else _type_of(items), length))
    return fields


def _type_of(values: Column) -> np.dtype[Any]:
    """Return the PLY type that represents all values exactly, or else the widest."""
    return exact_type(values, _NAMES) or np.dtype("f8")


def _is_lists(values: Column) -> bool:
    """Return whether an attribute holds an array of numbers of any length for each point."""
    arrays = (isinstance(each, np.ndarray) and each.ndim == 1 and each.dtype.kind in "biuf" for each in values)
    return values.dtype.hasobject and values.ndim == 1 and all(arrays)


def _fitted(cloud: PointCloud) -> tuple[PointCloud, list[str]]:
    """Return what `write_ply` can store of a cloud, and in words what it cannot."""
    lists = cloud.header.lists if isinstance(cloud.header, PlyHeader) else {}
    return keeping(
        cloud,
        lambda name, values: (
            (exact_type(values, _NAMES) or _is_lists(values)) and (0 not in values.shape[1:] or name in lists)
        ),
    )


FORMAT = Format(
    "PLY",
    (".ply",),
    read_ply,
    write_ply,
    lambda head, size: re.match(rb"ply[ \t]*\r?\n", head) is not None,
    unread_ply,
    _fitted,
    header=PlyHeader,
    named=column_name,
    faces=count_ply_faces,
    triangles=ply_triangles,
    count=count_ply,
    spans=spans_of_ply,
    write_encoded=write_ply,
)
