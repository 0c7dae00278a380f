"""The header of LAS files, kept as bytes: public header block, variable-length records, coordinate system.

laspy's own header is not used: it writes the records that it knows anew, with other bytes, and sets a missing date.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from io import BufferedReader
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.header import Header
from gppcs.errors import FileFormatError

# The names and places that the LAS specification gives; a file of version 1.2 ends before `waveforms`, one of 1.3
# before `first_extended`.
HEADER = np.dtype(
    [
        ("signature", "S4"), ("source_id", "<u2"), ("global_encoding", "<u2"), ("project_id", "V16"),
        ("major", "u1"), ("minor", "u1"), ("system_identifier", "S32"), ("generating_software", "S32"),
        ("day", "<u2"), ("year", "<u2"), ("size", "<u2"), ("offset_to_points", "<u4"), ("n_records", "<u4"),
        ("point_format", "u1"), ("point_size", "<u2"), ("legacy_count", "<u4"), ("legacy_returns", "<u4", 5),
        ("scales", "<f8", 3), ("offsets", "<f8", 3), ("bounds", "<f8", (3, 2)), ("waveforms", "<u8"),
        ("first_extended", "<u8"), ("n_extended", "<u4"), ("count", "<u8"), ("returns", "<u8", 15),
    ]
)  # fmt: skip
_MINOR = 25  # the byte that holds the version's second number
SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}  # of the header block, by the version's second number
# Of these, some depend on the points, the others on how the file is stored.
_DERIVED = (
    "offset_to_points", "n_records", "point_size", "legacy_count", "legacy_returns", "bounds", "waveforms",
    "first_extended", "n_extended", "count", "returns",
)  # fmt: skip
RECORD = np.dtype([("reserved", "<u2"), ("user", "S16"), ("id", "<u2"), ("length", "<u2"), ("description", "S32")])
EXTENDED = np.dtype([("reserved", "<u2"), ("user", "S16"), ("id", "<u2"), ("length", "<u8"), ("description", "S32")])
EXTRA_BYTES = np.dtype(
    [
        ("reserved", "V2"), ("type", "u1"), ("options", "u1"), ("name", "S32"), ("unused", "V4"), ("no_data", "V24"),
        ("min", "V24"), ("max", "V24"), ("scale", "V24"), ("offset", "V24"), ("description", "S32"),
    ]
)  # fmt: skip
TYPES = tuple(np.dtype(name) for name in ("<u1", "<i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f4", "<f8"))
_MIN_AND_MAX, _SCALE, _OFFSET = 0b00110, 0b01000, 0b10000  # options of extra bytes

_EXTRA_BYTES_RECORD = (b"LASF_Spec", 4)
WAVEFORMS = (b"LASF_Spec", 65535)
LASZIP = (b"laszip encoded", 22204)
COPC, COPC_HIERARCHY = (b"copc", 1), (b"copc", 1000)
WKT, _GEO_KEYS, _GEO_TEXTS = ((b"LASF_Projection", number) for number in (2112, 34735, 34737))
# Compression and indices of the points are right for one file only.
_OF_ONE_FILE = {LASZIP, COPC, COPC_HIERARCHY, (b"LAStools", 30)}
_PROJECTED, _GEOGRAPHIC, _CITATIONS = 3072, 2048, (3073, 1026, 2049)  # keys of GeoTIFF
_LINEAR_UNITS = 3076  # key of GeoTIFF
_METRES = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}  # its values: metre, foot, foot of the US survey
WITH_WKT = 6  # from this point format on, a coordinate system is given as WKT
# Bits of the global encoding.
_USES_WKT, _HOLDS_WAVEFORMS, _STANDARD_TIME = 0b10000, 0b10, 0b1
_Value = TypeVar("_Value", str, float)


@dataclass(frozen=True)
class Record:
    """A variable-length record, whole, with its own header."""

    content: bytes  # Header and data
    extended: bool = False  # Whether it stands behind the points

    @property
    def kind(self) -> tuple[bytes, int]:
        """The user that has defined the record, and its number among the user's kinds of records."""
        head = np.frombuffer(self.content, EXTENDED if self.extended else RECORD, 1)[0]
        return bytes(head["user"]), int(head["id"])

    @property
    def data(self) -> bytes:
        """What follows the record's header."""
        return self.content[(EXTENDED if self.extended else RECORD).itemsize :]


def record_of(kind: tuple[bytes, int], description: bytes, data: bytes, extended: bool = False) -> Record:
    """Return a record that stands before the points, or behind them."""
    head = np.array((0, *kind, len(data), description), EXTENDED if extended else RECORD)
    return Record(head.tobytes() + data, extended)


@dataclass(frozen=True, eq=False)
class LasHeader(Header):
    """What a LAS file says of the whole cloud."""

    block: bytes  # The public header block. What depends on the points, or on how the file is stored, is zero.
    # The variable-length records that do not describe compression or an index of the points.
    records: tuple[Record, ...] = ()
    padding: bytes = b""  # What stands between the last record and the first point

    def fields(self) -> NDArray[Any]:
        """Return a copy of the public header block by the names of `HEADER`. Fields beyond its version are zero."""
        return _fields(self.block)

    def with_fields(self, **values: Any) -> LasHeader:
        """Return the header with other values in its block."""
        fields = self.fields()
        for name, value in values.items():
            fields[name] = value
        size = SIZES[self.minor_version]
        return replace(self, block=fields.tobytes()[:size] + self.block[size:])

    @property
    def minor_version(self) -> int:
        """The second number of the version."""
        return self.block[_MINOR]

    @property
    def point_format(self) -> int:
        """The number of the point format, 0 to 10."""
        return int(self.fields()["point_format"][0])

    def descriptions(self) -> NDArray[Any]:
        """Return the descriptions of extra bytes, in the order of the bytes. Shapes: returns (K,)."""
        found = next((each.data for each in self.records if each.kind == _EXTRA_BYTES_RECORD), b"")
        return np.frombuffer(found, EXTRA_BYTES)

    @property
    def extra_bytes(self) -> dict[str, NDArray[Any]]:
        """The descriptions of extra bytes, each of type `EXTRA_BYTES`, by name."""
        return {extra_name(each): each for each in self.descriptions()}

    def with_extra_bytes(self, descriptions: Iterable[NDArray[Any]]) -> LasHeader:
        """Return the header with other descriptions of extra bytes, in the place of the old ones."""
        data = b"".join(each.tobytes() for each in descriptions)
        old = next((each for each in self.records if each.kind == _EXTRA_BYTES_RECORD), None)
        if data == (old.data if old else b""):
            return self
        new = [record_of(_EXTRA_BYTES_RECORD, b"Extra bytes", data)] if data else []
        place = self.records.index(old) if old else len(self.records)
        return replace(self, records=(*self.records[:place], *new, *self.records[place + bool(old) :]))

    @property
    def crs(self) -> str | None:
        """The coordinate reference system, by its name and code; None if it is not known."""
        found = {each.kind: each.data for each in self.records}
        return self._first_of(_crs_of_wkt(found.get(WKT, b"")), _crs_of_keys(found))

    @property
    def metres(self) -> float | None:
        """The unit of x and y in metres; None if it is not known, or if they are angles."""
        found = {each.kind: each.data for each in self.records}
        return self._first_of(_metres_of_wkt(found.get(WKT, b"")), _metres_of_keys(found))

    def _first_of(self, by_wkt: _Value | None, by_keys: _Value | None) -> _Value | None:
        """Return what the header says by WKT or by keys; if by both, in the way that its global encoding tells."""
        uses_wkt = int(self.fields()["global_encoding"][0]) & _USES_WKT
        return (by_wkt or by_keys) if uses_wkt else (by_keys or by_wkt)

    @property
    def conventions(self) -> dict[str, str]:
        """The kind of GPS time."""
        time = "standard" if int(self.fields()["global_encoding"][0]) & _STANDARD_TIME else "of the week"
        return {"gps_time": f"GPS time {time}"}

    def contents(self) -> list[str]:
        """Return in words the coordinate system and the number of other records."""
        known = (b"LASF_Projection",)
        others = sum(each.kind[0] not in known and each.kind != _EXTRA_BYTES_RECORD for each in self.records)
        crs = self.crs
        if crs is None and any(each.kind[0] in known for each in self.records):
            crs = "of unknown name"
        return [
            *([f"coordinate system {crs}"] if crs else []),
            *([f"{others} variable-length record{'s' * (others > 1)}"] if others else []),
        ]


def empty_header(minor: int, point_format: int) -> LasHeader:
    """Return the header of a new file of a version and a point format."""
    size = SIZES[minor]
    return LasHeader(bytes(_MINOR) + bytes([minor]) + bytes(size - _MINOR - 1)).with_fields(
        signature=b"LASF", major=1, size=size, point_format=point_format,
        global_encoding=_USES_WKT if point_format >= WITH_WKT else 0,
    )  # fmt: skip


def extra_name(description: NDArray[Any]) -> str:
    """Return the name of extra bytes, with an escape for each byte that is not UTF-8."""
    return bytes(description["name"]).split(b"\0")[0].decode("utf-8", "backslashreplace")


class Scaling(NamedTuple):
    """How physical values follow from the numbers in extra bytes: times a scale, plus an offset."""

    # (1,) or (k,) each, of each of k numbers of a point.
    scale: NDArray[np.float64]
    offset: NDArray[np.float64]

    def physical(self, stored: NDArray[Any]) -> NDArray[np.float64]:
        """Return the values of stored numbers, (n,) or (n, k)."""
        return stored * self._of(self.scale, stored) + self._of(self.offset, stored)

    def stored(self, values: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
        """Return the numbers to store for values, (n,) or (n, k)."""
        numbers = (values - self._of(self.offset, values)) / self._of(self.scale, values)
        return (numbers if dtype.kind == "f" else np.rint(numbers)).astype(dtype)

    def _of(self, factors: NDArray[np.float64], values: NDArray[Any]) -> Any:
        return factors if values.ndim > 1 else factors[0]


def scaling_of(description: NDArray[Any]) -> Scaling | None:
    """Return how the numbers in extra bytes are scaled; None if they are not."""
    kind, options = int(description["type"]), int(description["options"])
    if kind == 0 or not options & (_SCALE | _OFFSET):
        return None
    k = (kind - 1) // 10 + 1
    scale, offset = (np.frombuffer(bytes(description[name]), "<f8")[:k] for name in ("scale", "offset"))
    return Scaling(scale if options & _SCALE else np.ones(k), offset if options & _OFFSET else np.zeros(k))


def _crs_of_wkt(data: bytes) -> str | None:
    text = data.split(b"\0")[0].decode("utf-8", "replace").strip()
    name = re.match(r'\w+\s*[\[(]\s*"([^"]+)"', text)
    code = re.search(r'(?:AUTHORITY|ID)\s*[\[(]\s*"(\w+)"\s*,\s*"?(\w+)"?\s*[\])]\s*[\])]$', text)
    return name and _in_one_line(f"{name[1]} ({code[1]}:{code[2]})" if code else name[1])


def _metres_of_wkt(data: bytes) -> float | None:
    """Return the unit of the axes of a projected system, which is the first unit of length after the geographic one."""
    text = data.split(b"\0")[0].decode("utf-8", "replace")
    begin = re.search(r"PROJC(S|RS)\b", text)
    if not begin:
        return None
    axes = re.search(r"CS\s*[\[(]\s*Cartesian", text)  # as WKT 2 says; ellipsoid and projection have units before it
    found = re.findall(r'(?:LENGTHUNIT|UNIT)\s*[\[(]\s*"([^"]*)"\s*,\s*([\d.eE+-]+)', text[(axes or begin).start() :])
    lengths = [factor for name, factor in found if not re.search("degree|grad|radian|gon", name, re.IGNORECASE)]
    try:
        metres = float(lengths[0]) if lengths else 0.0
    except ValueError:
        return None
    return metres if 0.0 < metres < np.inf else None


def _metres_of_keys(records: dict[tuple[bytes, int], bytes]) -> float | None:
    where, _, code = _geo_keys(records).get(_LINEAR_UNITS, (0, 0, 0))
    return None if where else _METRES.get(code)


def _geo_keys(records: dict[tuple[bytes, int], bytes]) -> dict[int, tuple[int, int, int]]:
    """Return where the value of each key is, of how many parts it consists, and the value or its place."""
    words = records.get(_GEO_KEYS, b"")
    table = np.frombuffer(words[: len(words) // 8 * 8], "<u2").reshape(-1, 4).astype(int)
    return {key: (place, count, value) for key, place, count, value in table[1:].tolist()}


def _crs_of_keys(records: dict[tuple[bytes, int], bytes]) -> str | None:
    keys = _geo_keys(records)
    texts = records.get(_GEO_TEXTS, b"")
    names = [
        texts[start : start + count] for where, count, start in map(keys.get, _CITATIONS, [(0, 0, 0)] * 3) if where
    ]
    name = next((_in_one_line(each.split(b"\0")[0].decode("utf-8", "replace").strip("| ")) for each in names), None)
    codes = [keys[key][2] for key in (_PROJECTED, _GEOGRAPHIC) if key in keys]
    code = next((f"EPSG:{each}" for each in codes if 1024 <= each <= 32766), None)
    return f"{name} ({code})" if name and code else name or code


def _in_one_line(text: str) -> str:
    return re.sub(r"[\s\x00-\x1f\x7f-\x9f]+", " ", text)


def read_header(file: BufferedReader) -> tuple[LasHeader, NDArray[Any], dict[tuple[bytes, int], Record]]:
    """Read all but the points of a LAS file. Leave the file at its first point."""
    size = file.seek(0, 2)
    file.seek(0)
    fields, block = _read_block(file, size)
    n_records, start = int(fields["n_records"][0]), int(fields["offset_to_points"][0])
    whole = file.read(start - len(block))
    records, position = [], 0
    for i in range(n_records):
        content = _record(whole, position, i, n_records)
        records.append(Record(content))
        position += len(content)
    padding = whole[position:]
    records += _read_extended(file, size, fields)
    file.seek(start)
    kept = tuple(_without_bounds(each) for each in records if each.kind not in _OF_ONE_FILE)
    own = {each.kind: each for each in reversed(records) if each.kind in _OF_ONE_FILE}
    header = LasHeader(block, kept, padding)
    number = int(fields["point_format"][0]) & 0b111111  # the other bits tell that points are compressed
    zeros = dict.fromkeys(_DERIVED, 0)
    return header.with_fields(**zeros, point_format=number), fields, own


def _read_block(file: BufferedReader, size: int) -> tuple[NDArray[Any], bytes]:
    head = file.read(HEADER.itemsize)
    if not head.startswith(b"LASF") or len(head) < SIZES[2]:
        raise FileFormatError(
            f"expected a LAS header of at least {SIZES[2]} bytes, found {len(head)} or another format"
        )
    major, minor = head[_MINOR - 1], head[_MINOR]
    if major != 1 or minor not in SIZES:
        raise FileFormatError(f"expected LAS of version 1.0 to 1.4, found {major}.{minor}; convert the file")
    fields = _fields(head)
    length, start = int(fields["size"][0]), int(fields["offset_to_points"][0])
    if not SIZES[minor] <= length <= start <= size:
        raise FileFormatError(
            f"expected a header of at least {SIZES[minor]} bytes before the points and within the file, found one of "
            f"{length:,} bytes, points from byte {start:,} on and a file of {size:,}; get the whole file again"
        )
    file.seek(0)
    return fields, file.read(length)


def _fields(block: bytes) -> NDArray[Any]:
    """Return the public header block by names. What stands behind the fields of its version is left out."""
    return np.frombuffer(block[: SIZES[block[_MINOR]]].ljust(HEADER.itemsize, b"\0"), HEADER).copy()


def _record(data: bytes, position: int, index: int, count: int) -> bytes:
    """Return the record that begins at a position of the bytes before the points."""
    end = position + RECORD.itemsize
    if end <= len(data):
        end += int(np.frombuffer(data, RECORD, 1, position)["length"][0])
    if end > len(data):
        raise FileFormatError(
            f"expected {count:,} variable-length records before the points, found {index:,}; get the whole file again"
        )
    return data[position:end]


def _read_extended(file: BufferedReader, size: int, fields: NDArray[Any]) -> Iterator[Record]:
    """Yield the records behind the points."""
    count, position = int(fields["n_extended"][0]), int(fields["first_extended"][0])
    if fields["minor"][0] == 3 and int(fields["global_encoding"][0]) & _HOLDS_WAVEFORMS and fields["waveforms"][0]:
        count, position = 1, int(fields["waveforms"][0])
    for i in range(count):
        file.seek(min(position, size))
        head = file.read(EXTENDED.itemsize)
        length = int(np.frombuffer(head, EXTENDED)["length"][0]) if len(head) == EXTENDED.itemsize else size
        position += EXTENDED.itemsize + length
        if position > size:
            raise FileFormatError(
                f"expected {count:,} extended variable-length records, found {i:,}; get the whole file again"
            )
        yield Record(head + file.read(length), extended=True)


def _without_bounds(record: Record) -> Record:
    """Return a record of extra bytes without minima and maxima, which depend on the points; others unchanged."""
    if record.kind != _EXTRA_BYTES_RECORD:
        return record
    if len(record.data) % EXTRA_BYTES.itemsize:
        raise FileFormatError(
            f"expected {EXTRA_BYTES.itemsize} bytes for each description of extra bytes, "
            f"found {len(record.data):,} in all; the file may be damaged"
        )
    descriptions = np.frombuffer(record.data, EXTRA_BYTES).copy()
    typed = descriptions["type"] > 0  # otherwise the options are a number of bytes
    descriptions["options"][typed] &= 0xFF ^ _MIN_AND_MAX
    descriptions["min"] = descriptions["max"] = np.void(bytes(24))
    return (
        replace(record, content=record.content[: -len(record.data)] + descriptions.tobytes()) if len(typed) else record
    )


def waveforms_at(records: Iterable[Record], start: int) -> tuple[int, bytes]:
    """Return where the waveform data will stand, and the bytes of all records that stand behind the points."""
    found, content = 0, b""
    for each in records:
        if each.extended:
            found = start + len(content) if each.kind == WAVEFORMS else found
            content += each.content
    return found, content
