"""Reads PCD files, text, binary and compressed, and writes text and binary ones."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from io import BufferedReader
from itertools import tee
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, cloud_of_columns, coordinate_names
from gppcs.clouds.header import Header
from gppcs.errors import FileFormatError, OutputError
from gppcs.io.columns import check_name, columns_of, exact_type
from gppcs.io.format import Format, Reader, from_start, keeping
from gppcs.io.joining import joined
from gppcs.io.rows import (
    as_count,
    at_most,
    bytes_left,
    cast,
    ends_early,
    lines_of,
    read_records,
    read_rows,
    shortened,
    write_records,
    write_rows,
)

_TYPES = {
    (kind.upper(), str(size)): np.dtype(f"{kind}{size}")
    for kind, sizes in (("f", (4, 8)), ("i", (1, 2, 4, 8)), ("u", (1, 2, 4, 8)))
    for size in sizes
}
_LETTERS = {dtype: letters for letters, dtype in _TYPES.items()}
_ENCODINGS = ("ascii", "binary", "binary_compressed")
_KEYWORDS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
_PADDING = "_"
_STRAIGHT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # no translation, no rotation
_CHANNELS = ("red", "green", "blue")
_BYTES = {"red": 2, "green": 1, "blue": 0, "alpha": 3}  # where a packed colour holds them, on little-endian machines
_LONGEST_LINE = 1 << 20
_LARGEST_RECORD = (1 << 31) - 1  # that NumPy has
_MOST_EXPANSION = 88  # LZF: 3 bytes stand for up to 264
_LOOK = re.compile(rb"(?:\xef\xbb\xbf)?(?:# \.PCD|(?:#[^\n]*\n|\s)*VERSION\s+0?\.\d\s+(?:FIELDS|COLUMNS)\s)")


@dataclass(frozen=True)
class PackedColour:
    """How a PCD file holds the colours of its points: all channels in the four bytes of one number."""

    name: str = "rgb"  # or "rgba"
    dtype: np.dtype[Any] = field(default_factory=lambda: np.dtype("f4"))  # or uint32 or int32
    fourth: int = 0  # the byte before red, green and blue if the cloud has no attribute `alpha`


@dataclass(frozen=True, eq=False)
class PcdHeader(Header):
    """What a PCD file says of the whole cloud."""

    viewpoint: tuple[float, ...] = _STRAIGHT  # of the sensor: its place, then its rotation as a quaternion w, x, y, z
    comments: tuple[str, ...] = ()  # whole lines, without the one that names the format
    colour: PackedColour | None = None  # how red, green, blue and alpha are packed; None if each is a field
    is_text: bool = False

    def contents(self) -> list[str]:
        """Return in words the viewpoint, if it is not the default, and the number of comments."""
        number = len(self.comments)
        comments = [f"{number} comment{'s' if number > 1 else ''}"] if number else []
        return [*(["the viewpoint"] if self.viewpoint != _STRAIGHT else []), *comments]


@dataclass(frozen=True)
class _Field:
    name: str
    dtype: np.dtype[Any]
    count: int = 1

    @property
    def shape(self) -> tuple[int, ...]:
        return () if self.count == 1 else (self.count,)

    @property
    def size(self) -> int:
        return self.dtype.itemsize * self.count

    @property
    def may_be_colour(self) -> bool:
        return self.name in ("rgb", "rgba") and self.dtype.itemsize == 4 and self.count == 1


@dataclass
class _Layout:
    fields: list[_Field]
    width: int
    height: int
    encoding: str
    header: PcdHeader
    lines: int

    @property
    def count(self) -> int:
        return self.width * self.height

    @property
    def kept(self) -> list[_Field]:
        return [each for each in self.fields if each.name != _PADDING]

    def record(self) -> np.dtype[Any]:
        """Return the structured type of a point, without the padding."""
        offsets = np.cumsum([0, *(each.size for each in self.fields)]).tolist()
        kept = [(each, offset) for each, offset in zip(self.fields, offsets, strict=False) if each.name != _PADDING]
        return np.dtype(
            {
                "names": [each.name for each, _ in kept],
                "formats": [(each.dtype.newbyteorder("<"), each.shape) for each, _ in kept],
                "offsets": [offset for _, offset in kept],
                "itemsize": offsets[-1],
            }
        )


def read_pcd(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read a PCD file in chunks, a compressed one as one."""
    layout, start = _read_header(file), file.tell()
    coordinate_names(each.name for each in layout.kept)
    colour, has_alpha = _packed_colour(layout), True
    clouds = _clouds(file, layout, rows, {each.name for each in layout.kept} if attributes else set())
    if colour and attributes and colour.name == "rgb":
        parts: Iterable[PointCloud]
        clouds, parts = tee(clouds) if rows >= layout.count else (clouds, _clouds(file, layout, rows, {colour.name}))
        fourths = {byte for each in parts for byte in np.unique(_bytes(each.attributes[colour.name], colour)[:, 3])}
        file.seek(start)
        has_alpha = len(fourths) > 1
        colour = replace(colour, fourth=0 if has_alpha else int(min(fourths, default=0)))
    for cloud in clouds:
        columns = cloud.attributes
        if colour and attributes:
            parts_of = _bytes(columns[colour.name], colour)
            names = [name for name in _BYTES if has_alpha or name != "alpha"]
            channels = {name: np.ascontiguousarray(parts_of[:, _BYTES[name]]) for name in names}
            columns = {
                name: values
                for field, found in columns.items()
                for name, values in (channels if field == colour.name else {field: found}).items()
            }
        yield replace(cloud, attributes=columns, header=replace(layout.header, colour=colour))


def _packed_colour(layout: _Layout) -> PackedColour | None:
    """Return the field that holds red, green and blue; None if there are two, or one of the other names is taken."""
    packed = [each for each in layout.kept if each.may_be_colour]
    if len(packed) != 1 or not _BYTES.keys().isdisjoint(each.name for each in layout.kept):
        return None
    return PackedColour(packed[0].name, packed[0].dtype)


def _bytes(values: Column, colour: PackedColour) -> NDArray[np.uint8]:
    """Return the four bytes of each packed colour."""
    return np.ascontiguousarray(values, colour.dtype.newbyteorder("<")).view(np.uint8).reshape(-1, 4)


def _clouds(file: BufferedReader, layout: _Layout, rows: int, kept: Collection[str]) -> Iterator[PointCloud]:
    """Read the points with some of their fields, in chunks."""
    axes = coordinate_names(each.name for each in layout.kept)
    if layout.encoding == "binary":
        return read_records(file, layout.record(), layout.count, rows, "point", kept)
    tables = iter([_read_compressed(file, layout)]) if layout.encoding != "ascii" else _read_text(file, layout)
    clouds = (cloud_of_columns({n: v for n, v in each.items() if n in kept or n in axes}) for each in tables)
    return at_most(rows, clouds) if rows < layout.count else iter([joined(clouds)])


def unread_pcd(file: BufferedReader) -> list[str]:
    """Return in words that `read_pcd` leaves out the order in rows and columns, if the file has one."""
    layout = _read_header(file)
    return [f"the grid of {layout.width:,} columns and {layout.height:,} rows"] if layout.height > 1 else []


def _read_header(file: BufferedReader) -> _Layout:
    entries: dict[str, list[str]] = {}
    comments = []
    number = 0
    while "DATA" not in entries:
        number += 1
        line = file.readline(_LONGEST_LINE)
        if not line:
            raise FileFormatError("expected a line 'DATA ...', found the end of the file; get the whole file again")
        text = line.decode("utf-8-sig" if number == 1 else "utf-8", "surrogateescape").strip()
        if text.startswith("#"):
            if not text.startswith("# .PCD"):
                comments.append(text)
        elif text:
            keyword, *words = text.split()
            keyword = "FIELDS" if keyword == "COLUMNS" else keyword  # the name before version 0.7
            if keyword not in _KEYWORDS or keyword in entries or len(line) == _LONGEST_LINE:
                found = shortened(text.encode("utf-8", "replace").decode())
                raise FileFormatError(f"line {number}: expected a PCD header, found {found}")
            entries[keyword] = words
    version = _entry(entries, "VERSION", 1)[0] if "VERSION" in entries else ".7"
    if version.removeprefix("0") not in (".5", ".6", ".7"):
        raise FileFormatError(f"expected a PCD file of version 0.5, 0.6 or 0.7, found {shortened(version)}")
    (encoding,) = _entry(entries, "DATA", 1)
    if encoding not in _ENCODINGS:
        raise FileFormatError(f"expected DATA to be one of {', '.join(_ENCODINGS)}, found {shortened(encoding)}")
    width, height = _size(entries)
    header = PcdHeader(_viewpoint(entries), tuple(comments), is_text=encoding == "ascii")
    return _Layout(_fields(entries), width, height, encoding, header, number)


def _entry(entries: dict[str, list[str]], keyword: str, length: int | None = None) -> list[str]:
    """Return the words of a line of the header; raise an error if it is missing or their number is another."""
    words = entries.get(keyword, [])
    if not words or len(words) != (length or len(words)):
        wanted = f"{length} value{'s' if length and length > 1 else ''}" if length else "values"
        found = shortened(" ".join(words).encode("utf-8", "replace").decode()) if words else "none"
        raise FileFormatError(f"expected a line {keyword} with {wanted} in the PCD header, found {found}")
    return words


def _fields(entries: dict[str, list[str]]) -> list[_Field]:
    names = [name.encode("utf-8", "surrogateescape").decode("utf-8", "replace") for name in _entry(entries, "FIELDS")]
    for i, name in enumerate(names):
        if name != _PADDING and name in names[:i]:
            raise FileFormatError(f"expected fields of different names, found {name!r} twice; rename one")
    sizes, letters = (_entry(entries, keyword, len(names)) for keyword in ("SIZE", "TYPE"))
    counts = _entry(entries, "COUNT", len(names)) if "COUNT" in entries else ["1"] * len(names)
    fields = []
    for name, letter, size, text in zip(names, letters, sizes, counts, strict=True):
        dtype, count = _TYPES.get((letter, size)), as_count(text)
        if dtype is None and name == _PADDING:
            dtype, count = np.dtype("u1"), (count or 0) * (as_count(size) or 0)
        if dtype is None:
            raise FileFormatError(
                "expected TYPE and SIZE to be F 4, F 8, or I or U with 1, 2, 4 or 8, "
                f"found {shortened(f'{letter} {size}')} for {name!r}"
            )
        if not count:
            raise FileFormatError(f"expected COUNT to be 1 or more, found {shortened(text)} for {name!r}")
        fields.append(_Field(name, dtype, count))
    if sum(each.size for each in fields) > _LARGEST_RECORD:
        raise FileFormatError("expected less than 2^31 bytes for each point, found more in SIZE and COUNT")
    return fields


def _size(entries: dict[str, list[str]]) -> tuple[int, int]:
    """Return width and height."""
    found = {}
    for keyword in filter(entries.__contains__, ("WIDTH", "HEIGHT", "POINTS")):
        (word,) = _entry(entries, keyword, 1)
        if (number := as_count(word)) is None:
            raise FileFormatError(f"expected a whole number as {keyword}, found {shortened(word)}")
        found[keyword] = number
    points = found.get("POINTS")
    width, height = (found["WIDTH"], found.get("HEIGHT", 1)) if "WIDTH" in found else (points, 1)
    if width is None:
        raise FileFormatError("expected a line WIDTH or POINTS in the PCD header, found none")
    if points is not None and width * height != points:
        raise FileFormatError(f"expected POINTS to be WIDTH times HEIGHT, found {points}, {width} and {height}")
    return width, height


def _viewpoint(entries: dict[str, list[str]]) -> tuple[float, ...]:
    if "VIEWPOINT" not in entries:
        return _STRAIGHT
    words = _entry(entries, "VIEWPOINT", 7)
    try:
        return tuple(map(float, words))
    except ValueError:
        raise FileFormatError(f"expected 7 numbers as VIEWPOINT, found {shortened(' '.join(words))}") from None


def _read_compressed(file: BufferedReader, layout: _Layout) -> dict[str, Column]:
    """Read points that are compressed field by field."""
    start = file.read(8)
    if len(start) < 8:
        raise ends_early("point", 0, layout.count)
    packed, size = struct.unpack("<II", start)
    expected = layout.count * layout.record().itemsize
    if size != expected:
        raise FileFormatError(f"expected {expected} bytes of points, found {size} announced before the compressed data")
    if packed > (left := bytes_left(file)):
        raise FileFormatError(f"expected {packed} bytes of compressed points, found {left}; get the whole file again")
    data = _decompressed(file.read(packed), size)
    columns = {}
    offset = 0
    for each in layout.fields:
        if each.name != _PADDING:
            values = np.frombuffer(data, each.dtype.newbyteorder("<"), layout.count * each.count, offset)
            columns[each.name] = values.reshape(layout.count, *each.shape)
        offset += layout.count * each.size
    return columns


def _decompressed(data: bytes, size: int) -> bytearray:
    """Return `size` bytes of data that LZF has compressed."""
    out = bytearray()
    if size <= _MOST_EXPANSION * len(data):
        at, end = 0, len(data)
        try:
            while at < end and len(out) <= size:
                control = data[at]
                if control < 32:  # that many bytes and one more follow as they are
                    out += data[at + 1 : at + control + 2]
                    at += control + 2
                    continue
                length = control >> 5
                if length == 7:
                    at += 1
                    length += data[at]
                distance = ((control & 31) << 8 | data[at + 1]) + 1
                at += 2
                first = len(out) - distance
                if first < 0:
                    break
                copied = out[first : first + length + 2]
                if distance < length + 2:  # the copy goes on with bytes that it has just made
                    copied = (copied * (length // distance + 3))[: length + 2]
                out += copied
        except IndexError:
            at = end + 1
        if at == end and len(out) == size:
            return out
    raise FileFormatError(f"expected {size} bytes of points in LZF compression, found damaged data; get the file again")


def _read_text(file: BufferedReader, layout: _Layout) -> Iterator[dict[str, Column]]:
    """Yield the points of a text file as blocks of columns."""
    width = sum(each.count for each in layout.fields)
    blocks = read_rows(lines_of(file), width, layout.count)
    done = 0
    for found in blocks:
        columns, first = {}, 0
        for each in layout.fields:
            if each.name != _PADDING:
                what = f"{each.dtype} as {each.name} of point"
                values = [cast(values, each.dtype, what, done) for values in found[first : first + each.count]]
                columns[each.name] = np.stack(values, axis=1).reshape(-1, *each.shape)
            first += each.count
        yield columns
        done += len(found[0])


def write_pcd(file: BinaryIO, cloud: PointCloud, ascii: bool | None = None) -> None:  # noqa: A002
    """Write a PCD file with the attributes as fields, colours packed unless they were fields of their own."""
    header = cloud.header if isinstance(cloud.header, PcdHeader) else PcdHeader(colour=_usual_colour(cloud))
    header = header if ascii is None else replace(header, is_text=ascii)
    columns = _columns(cloud, header.colour)
    fields = [_Field(name, values.dtype, math.prod(values.shape[1:])) for name, values in columns.items()]
    if header.colour and _has_colours(cloud) and not header.is_text:
        at = list(columns).index(header.colour.name)
        fields[at] = replace(fields[at], dtype=header.colour.dtype)
    letters = [_LETTERS[each.dtype] for each in fields]
    lines = [
        "# .PCD v0.7 - Point Cloud Data file format",
        *header.comments,
        "VERSION 0.7",
        f"FIELDS {' '.join(columns)}",
        f"SIZE {' '.join(size for _, size in letters)}",
        f"TYPE {' '.join(letter for letter, _ in letters)}",
        f"COUNT {' '.join(str(each.count) for each in fields)}",
        f"WIDTH {len(cloud)}",
        "HEIGHT 1",
        f"VIEWPOINT {' '.join(repr(number).removesuffix('.0') for number in header.viewpoint)}",
        f"POINTS {len(cloud)}",
        f"DATA {'ascii' if header.is_text else 'binary'}\n",
    ]
    file.write("\n".join(lines).encode("utf-8", "surrogateescape"))
    if header.is_text:
        flat = [values.reshape(len(cloud), each.count) for each, values in zip(fields, columns.values(), strict=True)]
        write_rows(file, [part for values in flat for part in values.T])
    else:
        write_records(file, [(values, values.dtype) for values in columns.values()])


def _columns(cloud: PointCloud, colour: PackedColour | None) -> dict[str, Column]:
    """Return what is written of each point, by the name of its field."""
    if colour and _has_colours(cloud):
        check_name(colour.name, cloud.attributes)
        cloud = replace(cloud, attributes=dict(_packed(list(cloud.attributes.items()), colour)))
    columns = columns_of(cloud, flat=False)
    if _PADDING in columns:
        raise OutputError("expected a name other than '_', which PCD files give to padding; rename the attribute")
    return {name: values.astype(exact_type(values, _LETTERS) or "f8", copy=False) for name, values in columns.items()}


def _packed(attributes: list[tuple[str, Column]], colour: PackedColour) -> list[tuple[str, Column]]:
    """Return attributes with one of type uint32 in place of red, and without green, blue and alpha."""
    channels = {name: values for name, values in attributes if name in _BYTES and _is_channel(values)}
    parts = np.full((len(channels["red"]), len(_BYTES)), colour.fourth, np.uint8)
    for name, values in channels.items():
        parts[:, _BYTES[name]] = values
    word = parts.view("<u4")[:, 0]
    return [
        (colour.name, word) if name == "red" else (name, values)
        for name, values in attributes
        if name == "red" or name not in channels
    ]


def _is_channel(values: Column) -> bool:
    return values.dtype == np.uint8 and values.ndim == 1


def _has_colours(cloud: PointCloud) -> bool:
    return all(name in cloud.attributes and _is_channel(cloud.attributes[name]) for name in _CHANNELS)


def _usual_colour(cloud: PointCloud) -> PackedColour:
    """Return how the colours of a cloud are packed that does not come from a PCD file."""
    has_alpha = "alpha" in cloud.attributes and _is_channel(cloud.attributes["alpha"])
    return PackedColour("rgba", np.dtype("u4")) if has_alpha else PackedColour()


def open_pcd(file: BufferedReader) -> Reader:
    """Open a PCD file."""
    return Reader(
        partial(from_start, read_pcd, file),
        _read_header(file).count,
        skipped=partial(from_start, unread_pcd, file),
    )


def _stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud as `write_pcd` stores it."""
    return keeping(
        cloud,
        lambda name, values: (
            exact_type(values, _LETTERS)
            and 0 not in values.shape[1:]
            and not (_Field(name, values.dtype, math.prod(values.shape[1:])).may_be_colour and values.ndim == 1)
        ),
        PcdHeader,
        plain_names=True,
    )


FORMAT = Format(
    "PCD",
    (".pcd",),
    open_pcd,
    write_pcd,
    lambda start, size: _LOOK.match(start) is not None,
    _stored,
    frozenset({"ascii"}),
)
