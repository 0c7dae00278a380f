"""Reads OFF, OBJ and STL files: their vertices, and their faces as triangles. Writes OFF and OBJ files."""

from __future__ import annotations

import re
from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from io import BufferedReader
from itertools import islice
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.colours import eight_bits, fit_eight_bits
from gppcs.clouds.columns import Column, check_coordinate, cloud_of_columns
from gppcs.errors import FileFormatError
from gppcs.io.columns import coordinate_type, default_names
from gppcs.io.format import Format, Reader, from_start
from gppcs.io.rows import as_count, as_found, ends_early, lines_of, number_blocks, write_rows

_OFF_HEADER = re.compile(r"\s*(ST)?(C)?(N)?OFF(?![A-Za-z])(.*)", re.DOTALL)
_OFF_LOOK = re.compile(rb"\s*(ST)?C?N?4?n?OFF(?![A-Za-z])")
COLOURS = ("red", "green", "blue")  # attributes that hold the colour of a point
_INDEX = re.compile(r"[+-]?[0-9]{1,18}")
NO_FACES = np.empty((0, 3), dtype=np.int64)
STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")])
_STL_START = 84  # a comment of 80 bytes, then the number of facets


def read_off(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read the vertices of an OFF file; normals, colours and texture coordinates (NOFF, COFF, STOFF) too."""
    lines = lines_of(file)
    header, number, (count, *_) = _off_header(_off_lines(lines))
    blocks = number_blocks(lines, number + 1, _off_numbers, count=count, what="vertex")
    for table in _tables(blocks):
        names = _off_names(len(table), header.groups()[:3]) if count else default_names(3)
        yield cloud_of_columns(dict(zip(names, table, strict=True)))


def _off_header(numbered: Iterator[tuple[int, str]]) -> tuple[re.Match[str], int, list[int]]:
    """Return the keyword, the number of the line with the counts, and the counts: vertices first, then faces."""
    number, line = next(numbered, (1, ""))
    header = _OFF_HEADER.match(line)
    if header is None or "BINARY" in line:
        raise FileFormatError(f"expected a text file that begins with OFF, COFF or NOFF, found {as_found(line)}")
    text = header[4].strip()
    if not text:
        number, text = next(numbered, (number, ""))
    counts = [as_count(word) for word in text.split()[:2]]
    known = [count for count in counts if count is not None]
    if not counts or counts[0] is None:
        raise FileFormatError(f"line {number}: expected numbers of vertices, faces, edges, found {as_found(text)}")
    return header, number, known


def unread_obj(file: BufferedReader) -> list[str]:
    """Return in words what `read_obj` leaves out of a file, besides faces: normals and texture coordinates."""
    counts = Counter(line.split(None, 1)[0] for line in lines_of(file) if line.startswith("v"))
    others = {"vn": "normals", "vt": "texture coordinates"}
    return [f"{others[word]} ({counts[word]:,})" for word in others if counts[word]]


def off_triangles(file: BufferedReader) -> NDArray[np.int64]:
    """Read the faces of an OFF file as triangles."""
    numbered = _off_lines(lines_of(file))
    _, _, (vertices, *rest) = _off_header(numbered)
    sizes, found = array("q"), array("q")
    for number, text in islice(numbered, vertices, vertices + sum(rest)):
        count, *corners = _indices(number, text.split()[: int(as_count(text.split()[0]) or 0) + 1])
        if count != len(corners) or not all(0 <= corner < vertices for corner in corners):
            raise FileFormatError(
                f"line {number}: expected a number of corners and then as many indices from 0 to {vertices - 1}, "
                f"found {as_found(text)}"
            )
        sizes.append(count)
        found.extend(corners)
    if rest and len(sizes) < rest[0]:
        raise ends_early("face", len(sizes), rest[0])
    return triangles_of(np.array(sizes, np.int64), np.array(found, np.int64))


def obj_triangles(file: BufferedReader) -> NDArray[np.int64]:
    """Read the faces of an OBJ file, which refer to vertices on earlier lines, as triangles."""
    vertices = 0
    sizes, found = array("q"), array("q")
    for number, text in enumerate(lines_of(file), 1):
        keyword, *words = text.split() or [""]
        vertices += keyword == "v"
        if keyword == "f":
            corners = _indices(number, [word.partition("/")[0] for word in words])
            if not all(1 <= abs(corner) <= vertices for corner in corners):
                raise FileFormatError(
                    f"line {number}: expected indices of earlier vertices, 1 to {vertices} or -1 to {-vertices}, "
                    f"found {as_found(text)}"
                )
            sizes.append(len(corners))
            found.extend(corner - 1 if corner > 0 else vertices + corner for corner in corners)
    return triangles_of(np.array(sizes, np.int64), np.array(found, np.int64))


def triangles_of(sizes: NDArray[np.int64], corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return polygons, given by their sizes and all their corners, as triangles that share a polygon's first corner."""
    counts = np.maximum(sizes - 2, 0)
    first = np.repeat(np.cumsum(sizes) - sizes, counts)
    second = first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    return corners[np.stack([first, second, second + 1], axis=1)]


def _indices(number: int, words: list[str]) -> list[int]:
    if not all(map(_INDEX.fullmatch, words)):
        raise FileFormatError(f"line {number}: expected whole numbers, found {as_found(' '.join(words))}")
    return [int(word) for word in words]


def _off_numbers(line: str) -> str:
    return line.partition("#")[0].strip()


def _off_lines(lines: Iterator[str]) -> Iterator[tuple[int, str]]:
    """Yield the numbers and the contents of lines that are neither empty nor a comment."""
    return ((i, text) for i, text in enumerate(map(_off_numbers, lines), 1) if text)


def _off_names(width: int, groups: tuple[str | None, ...]) -> list[str]:
    """Return the names of the columns of a vertex, in the order of OFF files."""
    texture, colour, normal = groups
    names = [*default_names(3), *(NORMALS if normal else ()), *(COLOURS if colour else ())]
    if colour and width > len(names) + 2 * bool(texture):
        names.append("alpha")
    names += ["s", "t"] if texture else []
    if len(names) > width:
        raise FileFormatError(f"expected {len(names)} numbers for each vertex, found {width}")
    return [*names, *default_names(width)[len(names) :]]


def read_obj(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read the `v` lines of an OBJ file: x y z, then w, or red green blue, or both."""
    for table in _tables(_prefixed(file, "v")):
        extras = {3: [], 4: ["w"], 6: COLOURS, 7: ["w", *COLOURS]}.get(len(table))
        if extras is None:
            raise FileFormatError(f"expected 3, 4, 6 or 7 numbers in each v line, found {len(table)}")
        yield cloud_of_columns(dict(zip([*default_names(3), *extras], table, strict=True)))


def _prefixed(file: BufferedReader, keyword: str, width: int | None = None) -> Iterator[list[Column]]:
    """Yield blocks of the numbers in lines that start with a keyword."""

    def numbers(line: str) -> str:
        words = line.split(None, 1)
        return words[1] if len(words) == 2 and words[0] == keyword else ""

    return number_blocks(lines_of(file), 1, numbers, width=width)


def _tables(blocks: Iterator[list[Column]]) -> Iterator[list[Column]]:
    """Yield blocks with coordinates as float64."""
    for table in blocks:
        if len(table) < 3:
            raise FileFormatError(f"expected three coordinates for each vertex, found {len(table)}")
        for i, axis in enumerate("xyz"):
            check_coordinate(axis, table[i])
        yield [*(values.astype(np.float64) for values in table[:3]), *table[3:]]


def read_stl(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read the distinct corners of the facets of an STL file, text or binary, in order of first appearance."""
    corners = _corners(file)
    points = corners[_distinct(corners)[0]]
    yield PointCloud(points, coordinate_dtype=corners.dtype.newbyteorder("="))


def _corners(file: BufferedReader) -> Column:
    """Return the corners of all facets, three rows for each."""
    data = file.read()
    if _is_text_stl(data[:1024], len(data)):
        file.seek(0)
        blocks = [np.stack(columns, axis=1) for columns in _prefixed(file, "vertex", 3)]
        corners = np.concatenate([np.empty((0, 3)), *blocks])
        if len(corners) % 3 or not data.rstrip().rpartition(b"\n")[2].lstrip().startswith(b"endsolid"):
            raise FileFormatError(f"the file ends in facet {len(corners) // 3 + 1}; get the whole file again")
        return corners
    count = int.from_bytes(data[80:_STL_START], "little")
    whole = (len(data) - _STL_START) // STL_FACET.itemsize
    if len(data) < _STL_START:
        raise FileFormatError(f"expected an STL file of at least {_STL_START} bytes, found {len(data)}")
    if whole < count:
        raise ends_early("facet", whole, count)
    return np.frombuffer(data, STL_FACET, count, _STL_START)["corners"].reshape(-1, 3)


def _distinct(rows: Column) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """Return the index of the first occurrence of each distinct row, ascending, and which of these each row equals."""
    order = np.lexsort(rows.T)  # stable, so equal rows keep their order
    ordered = rows[order]
    begins = np.ones(len(rows), dtype=bool)
    begins[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    first, group = np.unique(order[begins], return_inverse=True)
    equal = np.empty(len(rows), np.int64)
    equal[order] = group[np.cumsum(begins) - 1]
    return first, equal


def _is_text_stl(head: bytes, size: int) -> bool:
    return head.lstrip().startswith(b"solid") and b"\0" not in head and not _is_binary_stl(head, size)


def _is_binary_stl(head: bytes, size: int) -> bool:
    count = int.from_bytes(head[80:_STL_START], "little")
    return size == _STL_START + count * STL_FACET.itemsize


def _looks_like_stl(head: bytes, size: int) -> bool:
    return _is_binary_stl(head, size) or (_is_text_stl(head, size) and (b"facet" in head or b"endsolid" in head))


def write_off(file: BinaryIO, cloud: PointCloud, faces: NDArray[np.int64] = NO_FACES) -> None:
    """Write points with their normals and colours, as far as they have these, and triangles, as an OFF file."""
    colours, name = colours_of(cloud), "OFF"
    columns = _coordinates(cloud)
    if set(NORMALS) <= set(cloud.attributes):
        columns, name = columns + [cloud.attributes[each] for each in NORMALS], f"N{name}"
    if colours is not None:
        columns, name = columns + list(colours.T), f"C{name}"
    file.write(f"{name}\n{len(cloud)} {len(faces)} 0\n".encode())
    write_rows(file, columns)
    write_rows(file, list(faces.T), prefix="3 ")


def write_obj(file: BinaryIO, cloud: PointCloud, faces: NDArray[np.int64] = NO_FACES) -> None:
    """Write points with colours from 0 to 1, normals, and triangles, as an OBJ file."""
    colours = colours_of(cloud)
    fractions = [] if colours is None else list(np.round(colours / 255, 6).T)
    write_rows(file, _coordinates(cloud) + fractions, prefix="v ")
    numbers = faces + 1
    if not set(NORMALS) <= set(cloud.attributes):
        write_rows(file, list(numbers.T), prefix="f ")
        return
    write_rows(file, [cloud.attributes[name] for name in NORMALS], prefix="vn ")
    file.writelines(b"f %d//%d %d//%d %d//%d\n" % (a, a, b, b, c, c) for a, b, c in numbers.tolist())


def _coordinates(cloud: PointCloud) -> list[Column]:
    return list(cloud.points.astype(coordinate_type(cloud), copy=False).T)


def colours_of(cloud: PointCloud) -> NDArray[np.uint8] | None:
    """Return the colours of the points, (N, 3), as bytes; None if there are none."""
    return eight_bits(_stacked(cloud)) if set(COLOURS) <= set(cloud.attributes) else None


def _stacked(cloud: PointCloud) -> Column:
    """Return the colours of the points, (N, 3), in their own type."""
    return np.column_stack([cloud.attributes[name] for name in COLOURS])


def held(cloud: PointCloud, groups: Sequence[Sequence[str]]) -> PointCloud:
    """Return a cloud with those groups of attributes that are numbers and complete, colours with 8 bits."""
    numbers = {name for name, values in cloud.attributes.items() if values.dtype.kind in "biuf" and values.ndim == 1}
    names = {name for group in groups if set(group) <= numbers for name in group}
    kept = {name: values for name, values in cloud.attributes.items() if name in names}
    if set(COLOURS) <= names and not fit_eight_bits(_stacked(cloud)):
        colours = colours_of(cloud)
        assert colours is not None
        kept.update(zip(COLOURS, colours.T, strict=True))
    return replace(cloud, attributes=kept, header=None)


def open_off(file: BufferedReader) -> Reader:
    """Open an OFF file."""
    return Reader(
        partial(from_start, read_off, file),
        at_once=True,
        n_faces=partial(from_start, _count_off_faces, file),
        triangles=partial(from_start, off_triangles, file),
    )


def open_obj(file: BufferedReader) -> Reader:
    """Open an OBJ file."""

    def n_faces() -> int:
        file.seek(0)
        return sum(line.split(None, 1)[:1] == ["f"] for line in lines_of(file))

    return Reader(
        partial(from_start, read_obj, file),
        at_once=True,
        n_faces=n_faces,
        skipped=partial(from_start, unread_obj, file),
        triangles=partial(from_start, obj_triangles, file),
    )


def open_stl(file: BufferedReader) -> Reader:
    """Open an STL file."""

    def corners() -> Column:
        file.seek(0)
        return _corners(file)

    return Reader(
        partial(from_start, read_stl, file),
        at_once=True,
        n_faces=lambda: len(corners()) // 3,
        triangles=lambda: _distinct(corners())[1].reshape(-1, 3),
    )


def _count_off_faces(file: BufferedReader) -> int:
    _, _, (_, *faces) = _off_header(_off_lines(lines_of(file)))
    return faces[0] if faces else 0


FACES = frozenset({"faces"})
OFF, OBJ, STL = FORMATS = (
    Format(
        "OFF",
        (".off",),
        open_off,
        write_off,
        lambda start, size: _OFF_LOOK.match(start) is not None,
        partial(held, groups=(NORMALS, COLOURS)),
        FACES,
    ),
    Format(
        "OBJ",
        (".obj",),
        open_obj,
        write_obj,
        stored=partial(held, groups=(COLOURS,)),  # normals would not be read again
        options=FACES,
    ),
    Format("STL", (".stl",), open_stl, recognises=_looks_like_stl, options=FACES),
)
