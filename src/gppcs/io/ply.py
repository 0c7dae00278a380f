"""Reads PLY files, text and binary of both byte orders, and writes text and little-endian ones."""

import os
import struct
from dataclasses import dataclass, replace
from functools import partial
from io import BufferedReader
from itertools import islice
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import coordinate_names
from gppcs.clouds.header import Header
from gppcs.errors import FileFormatError
from gppcs.io import rows
from gppcs.io.columns import columns_of, exact_type, with_byte_colours
from gppcs.io.format import Format, Reader, begins, keeping
from gppcs.io.meshes import NO_FACES, triangles_of

_KINDS = map(np.dtype, ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"))
_NAMES = dict(zip(_KINDS, ("char", "uchar", "short", "ushort", "int", "uint", "float", "double"), strict=True))
_TYPES = {name: dtype for dtype, older in _NAMES.items() for name in (older, dtype.name)}
_LENGTHS = {name for name, dtype in _TYPES.items() if dtype.kind in "iu"}
_Order = Literal["<", ">"] | None  # of binary numbers; None for text
_ORDERS: dict[str, _Order] = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}


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


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]

    @property
    def has_lists(self) -> bool:
        return any(column.length for column in self.properties)

    def record(self, order: _Order) -> np.dtype[Any]:
        """Return the structured type of the properties, packed; a list has only its count."""
        with rows.reported("NumPy", f"different properties of {self.name}"):
            return np.dtype([(column.name, column.dtype.newbyteorder(order or "=")) for column in self.properties])


def open_ply(file: BufferedReader) -> Reader:
    """Open a PLY file to read its vertices, whose properties are numbers, and its faces. Other elements are skipped."""
    order, elements, remarks = _read_header(file)
    start = file.tell()
    by_name = {element.name: element for element in elements}
    vertices, faces = (by_name.get(name, _Element(name, 0, [])) for name in ("vertex", "face"))
    if "vertex" not in by_name:
        raise FileFormatError(f"expected an element named vertex, found {', '.join(map(repr, by_name)) or 'none'}")
    if vertices.has_lists:
        raise FileFormatError("expected one number as each property of a vertex, found a list; export without it")
    coordinate_names(column.name for column in vertices.properties)
    record, header = vertices.record(order), PlyHeader(tuple(remarks)) if remarks else None

    def with_header(cloud: PointCloud) -> PointCloud:
        return replace(cloud, header=header)

    _seek(file, start, order, elements, vertices)
    if order:
        reader = rows.records_reader(file, record, vertices.count, with_header, "vertex")
    else:
        blocks = partial(rows.read_fields, record=record, count=vertices.count, what="vertex")
        reader = rows.blocks_reader(file, blocks, vertices.count, with_header)

    def triangles() -> NDArray[np.int64]:
        names = {column.name for column in faces.properties if column.length} & {"vertex_indices", "vertex_index"}
        if not (names and faces.count):
            return NO_FACES
        _seek(file, start, order, elements, faces)
        return triangles_of(*_lists(file, order, faces, min(names)))

    skipped = [
        f"element {item.name} ({item.count:,})" for item in elements if item not in (vertices, faces) and item.count
    ]
    return replace(reader, n_faces=faces.count, skipped=skipped, triangles=triangles)


def _read_header(file: BufferedReader) -> tuple[_Order, list[_Element], list[str]]:
    """Return the byte order of numbers, the elements and the comments."""
    encoding, elements, remarks = "", list[_Element](), list[str]()
    for number, line in enumerate(iter(file.readline, b""), 1):
        text = line.decode("utf-8", "replace")
        match text.split():
            case ["ply"] if number == 1:
                pass
            case _ if number == 1:
                raise FileFormatError(f"expected 'ply' as the first line of a PLY file, found {rows.shortened(text)}")
            case []:
                pass
            case ["end_header"] if encoding:
                return _ORDERS[encoding], elements, remarks
            case ["comment" | "obj_info", *_]:
                remarks.append(line.decode("utf-8", "surrogateescape").rstrip("\r\n"))
            case ["format", kind, "1.0"] if kind in _ORDERS:
                encoding = kind
            case ["element", name, digits] if (count := rows.as_count(digits)) is not None:
                elements.append(_Element(name, count, []))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
            case ["property", "list", length, kind, name] if elements and kind in _TYPES and length in _LENGTHS:
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[length]))
            case _:
                raise FileFormatError(f"line {number}: expected a PLY header, found {rows.shortened(text)}")
    raise rows.damaged("a line 'end_header'", "the end of the file")


def _seek(file: BufferedReader, start: int, order: _Order, elements: list[_Element], element: _Element) -> None:
    """Move to the beginning of an element, given where the first one begins."""
    file.seek(start)
    for skipped in elements[: elements.index(element)]:
        if not order:
            for i in range(skipped.count):
                if not file.readline():
                    raise rows.ends_early(skipped.name, i, skipped.count)
        elif skipped.has_lists:
            _lists(file, order, skipped, skipped.properties[0].name)
        else:
            size = skipped.record(order).itemsize
            rows.check_length(file, size, skipped.count, skipped.name)
            file.seek(skipped.count * size, os.SEEK_CUR)


def _lists(
    file: BufferedReader, order: _Order, element: _Element, name: str
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the lengths of one list of an element, and all its items one after the other."""
    start, properties = file.tell(), element.properties
    if order:
        data = file.read()
    else:  # as if each number were a double one
        lines = islice(filter(rows.is_row, rows.lines_of(file)), element.count)
        with rows.reported("NumPy", f"numbers in {element.name}", (ValueError,)):
            data = np.array(" ".join(lines).split(), "<f8").tobytes()
        double = np.dtype("<f8")
        properties = [_Property(column.name, double, column.length and double) for column in properties]
    counts = [column.length and struct.Struct((order or "<") + column.length.char) for column in properties]
    parts, position = list[bytes](), 0
    for i in range(element.count):
        for column, count in zip(properties, counts, strict=True):
            length = 1
            if count:
                if position + count.size > len(data):
                    raise rows.ends_early(element.name, i, element.count)
                length = count.unpack_from(data, position)[0]
                position += count.size
                if not 0 <= length < 2**63 or length != int(length):
                    raise FileFormatError(f"expected a list in {element.name} {i + 1}, found one of length {length:g}")
            begin = position
            position += int(length) * column.dtype.itemsize
            if column.name == name:
                parts.append(data[begin:position])
        if position > len(data):
            raise rows.ends_early(element.name, i, element.count)
    if order:
        file.seek(start + position)
    dtype = next(column.dtype for column in properties if column.name == name)
    items = np.frombuffer(b"".join(parts), dtype.newbyteorder(order or "<"))
    sizes = np.array([len(part) // dtype.itemsize for part in parts], np.int64)
    return sizes, rows.cast(items, np.dtype(np.int64), "an index as corner")


def write_ply(
    file: BinaryIO,
    cloud: PointCloud,
    ascii: bool = False,  # noqa: A002
    faces: NDArray[np.int64] | None = None,
) -> None:
    """Write a PLY file with the attributes as properties; 64-bit integers take the first type that is exact."""
    columns = columns_of(cloud, types=_NAMES)
    lines = [
        "ply",
        f"format {'ascii' if ascii else 'binary_little_endian'} 1.0",
        *(cloud.header.remarks if isinstance(cloud.header, PlyHeader) else ()),
        f"element vertex {len(cloud)}",
        *(f"property {_NAMES[values.dtype]} {name}" for name, values in columns.items()),
        *([] if faces is None else [f"element face {len(faces)}", "property list uchar int vertex_indices"]),
        "end_header\n",
    ]
    file.write("\n".join(lines).encode("utf-8", "surrogateescape"))
    write = rows.write_rows if ascii else rows.write_records
    write(file, list(columns.values()))
    if faces is not None:
        write(file, [np.full(len(faces), 3, np.uint8), *faces.T.astype(np.int32)])


FORMAT = Format(
    "PLY",
    (".ply",),
    open_ply,
    write_ply,
    begins(rb"ply[ \t]*\r?\n"),
    lambda cloud: keeping(
        with_byte_colours(cloud), lambda name, values: exact_type(values, _NAMES), PlyHeader, plain_names=True
    ),
    frozenset({"ascii", "faces"}),
)
