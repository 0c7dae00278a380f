"""The header of LAS files and its scales: laspy reads it, after its counts and sizes have been checked.

The chunks of the points are checked in laz.py (`checked_chunks`).
"""

from __future__ import annotations

import logging
import os
import struct
from collections.abc import Callable, Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from datetime import UTC, date, datetime
from decimal import Decimal
from io import BufferedReader, BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.header import Header
from gppcs.errors import FileFormatError
from gppcs.io.crs import in_one_line, name_of_wkt, units_of_keys, units_of_wkt
from gppcs.io.rows import damaged, reported
from gppcs.spatial.units import Units

if TYPE_CHECKING:
    import laspy

logging.getLogger("laspy").addHandler(logging.NullHandler())  # else its warnings are printed

_LARGEST = 2**31 - 1  # of the whole numbers that coordinates are stored as
WAVEFORMS = ("LASF_Spec", 65535)
_EXTRA_BYTES = ("LASF_Spec", 4)
_PROJECTION = "LASF_Projection"  # user of the records of the coordinate system
_WKT, _GEO_KEYS, _GEO_TEXTS = 2112, 34735, 34737  # their numbers
# Records of the compression and of indices of the points, which hold for one file only.
_OF_ONE_FILE = {("laszip encoded", 22204), ("copc", 1), ("copc", 1000), ("LAStools", 30)}


@dataclass(frozen=True, eq=False)
class LasHeader(Header):
    """What a LAS file says of the whole cloud: laspy's header without what depends on the points or on compression."""

    las: laspy.LasHeader

    @classmethod
    def from_laspy(cls, header: laspy.LasHeader) -> LasHeader:
        """Return a copy of a header, whose counts and bounds are zero."""
        las = deepcopy(header)
        for records in (las.vlrs, las.evlrs or []):
            records[:] = [record for record in records if kind_of(record) not in _OF_ONE_FILE]
        for description in descriptions_of(las):
            # laspy would take the first point for the minimum and maximum of all.
            description.options &= ~(description.MIN_BIT_MASK | description.MAX_BIT_MASK)
        las.partial_reset()
        las.maxs = np.zeros(3)
        las.mins = np.zeros(3)
        las.start_of_waveform_data_packet_record = 0
        las.are_points_compressed = False
        las.generating_software = "gppcs"  # as it is written
        return cls(las)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LasHeader) and self._content() == other._content()

    def _content(self) -> bytes:
        """Return the header as it is written, but for its date."""
        las = deepcopy(self.las)
        las.creation_date = date.min
        with BytesIO() as file:
            las.write_to(file, encoding_errors="surrogateescape")
            if las.evlrs:
                las.evlrs.write_to(file, as_extended=True, encoding_errors="surrogateescape")
            return file.getvalue()

    def _projection(self, number: int) -> bytes:
        """Return the content of a record of the coordinate system; no bytes if there is none."""
        records = [*self.las.vlrs, *(self.las.evlrs or [])]
        return next((r.record_data_bytes() for r in records if kind_of(r) == (_PROJECTION, number)), b"")

    def with_crs_of(self, other: Header | None) -> LasHeader:
        """Return this header, with the coordinate system of another if it has none."""
        if self.crs or not isinstance(other, LasHeader):
            return self
        las = deepcopy(self.las)
        las.vlrs += [record for record in (*other.las.vlrs, *(other.las.evlrs or [])) if record.user_id == _PROJECTION]
        return LasHeader(las)

    @property
    def wkt(self) -> str:
        """The coordinate reference system as WKT; empty if the file has none."""
        return self._projection(_WKT).split(b"\0")[0].decode("utf-8", "replace").strip()

    @property
    def crs(self) -> str | None:
        """The coordinate reference system, by its name and code; None if it is not known."""
        by_wkt, by_keys = name_of_wkt(self.wkt), self._crs_of_keys()
        return (by_wkt or by_keys) if self.las.global_encoding.wkt else (by_keys or by_wkt)

    @property
    def units(self) -> Units | None:
        """The units of the axes; None if they are not known."""
        by_wkt = units_of_wkt(self.wkt)
        by_keys = units_of_keys({key: value for key, (location, _, value) in self._geo_keys().items() if not location})
        return (by_wkt or by_keys) if self.las.global_encoding.wkt else (by_keys or by_wkt)

    def _geo_keys(self) -> dict[int, tuple[int, int, int]]:
        """Return where the value of each GeoTIFF key is, of how many parts it consists, and the value or its place."""
        content = self._projection(_GEO_KEYS)
        table = np.frombuffer(content[: len(content) // 8 * 8], "<u2").reshape(-1, 4).astype(int)
        return {key: (location, count, value) for key, location, count, value in table[1:].tolist()}

    def _crs_of_keys(self) -> str | None:
        keys, texts = self._geo_keys(), self._projection(_GEO_TEXTS)
        citations = [keys[key] for key in (3073, 1026, 2049) if key in keys]  # projected, of all, geographic
        names = [texts[start : start + count].split(b"\0")[0] for location, count, start in citations if location]
        name = next((in_one_line(name.decode("utf-8", "replace").strip("| ")) for name in names), None)
        codes = [keys[key][2] for key in (3072, 2048) if key in keys]  # projected, geographic
        code = next((f"EPSG:{code}" for code in codes if 1024 <= code <= 32766), None)
        return f"{name} ({code})" if name and code else name or code

    @property
    def decimals(self) -> list[int]:
        """The digits after the point that x, y and z have in the file."""
        steps = zip(self.las.scales, self.las.offsets, strict=True)
        return [max(-int(Decimal(repr(float(value))).as_tuple().exponent) for value in step) for step in steps]

    @property
    def conventions(self) -> dict[str, str]:
        """The kind of GPS time."""
        time = "standard" if self.las.global_encoding.gps_time_type else "of the week"
        return {"gps_time": f"GPS time {time}"}

    def contents(self) -> list[str]:
        """Return in words the coordinate system and the number of other records."""
        kinds = [kind_of(record) for record in (*self.las.vlrs, *(self.las.evlrs or []))]
        n_others = sum(kind[0] != _PROJECTION and kind != _EXTRA_BYTES for kind in kinds)
        crs = self.crs
        if crs is None and any(user == _PROJECTION for user, _ in kinds):
            crs = "of unknown name"
        return [
            *([f"coordinate system {crs}"] if crs else []),
            *([f"{n_others} variable-length record{'s' * (n_others > 1)}"] if n_others else []),
        ]


def descriptions_of(header: laspy.LasHeader) -> Iterator[Any]:
    """Yield the descriptions of extra bytes, but not those whose options are a number of bytes."""
    for record in header.vlrs.get("ExtraBytesVlr"):
        yield from (description for description in record.extra_bytes_structs if description.data_type)


def no_data_of(header: laspy.LasHeader) -> dict[str, Any]:
    """Return the stored numbers that mean no data, (1,) to (3,), by the names of extra bytes that have some."""
    marked = (description for description in descriptions_of(header) if description.no_data is not None)
    return {description.format_name(): description.no_data for description in marked}


def dated(header: laspy.LasHeader) -> laspy.LasHeader:
    """Return a copy of a header that is to be written, with its date, or else that of SOURCE_DATE_EPOCH or today."""
    header = deepcopy(header)
    if header.creation_date is None:
        epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
        header.creation_date = datetime.fromtimestamp(int(epoch), UTC).date() if epoch.isdecimal() else date.today()
    return header


def kind_of(record: laspy.VLR) -> tuple[str, int]:
    """Return the user that has defined a variable-length record, and its number among the user's kinds."""
    return record.user_id, record.record_id


def read_header(file: BufferedReader) -> laspy.LasHeader:
    """Read all but the points of a LAS file. Leave the file at its first point."""
    import laspy

    size = file.seek(0, 2)
    if size < 227:  # the header of LAS 1.0 to 1.2
        raise damaged("a LAS header of at least 227 bytes", str(size))
    file.seek(0)
    block = file.read(375)  # of LAS 1.4, which is the longest
    length, start, n_records = struct.unpack_from("<HII", block, 94)
    minimum = {3: 235, 4: 375}.get(block[25], 227)
    if not minimum <= length <= min(start, size):
        sizes = f"that it gives its own size as {length}, and {start} as the place of the points, in {size:,} bytes"
        raise damaged(f"a LAS header of at least {minimum} bytes before the points", sizes)
    n_complete = _n_complete(file, length, min(start, size), n_records)
    if block[25] >= 4:
        position, n_extended = struct.unpack_from("<QI", block, 235)
        if (n := _n_complete(file, position, size, n_extended, size=60, width=8)) < n_extended:
            raise damaged(f"{n_extended:,} extended variable-length records in the file", f"{n:,}")
    file.seek(0)
    content = bytearray(file.read(start))
    with reported("laspy", "a LAS header"):
        struct.pack_into("<I", content, 100, n_complete)  # some programs count more records than they write
        header = laspy.LasHeader.read_from(BytesIO(content))
        header.read_evlrs(file)
        header.point_format.dtype()  # which raises an error if two dimensions have one name
        if header.version.minor == 0:
            header.version = laspy.header.Version(1, 1)  # which has the same header, and which laspy writes
    for name in header.point_format.extra_dimension_names:
        if name in ("", "x", "y", "z"):
            raise FileFormatError(f"expected a name of its own for all extra bytes, found {name!r}; rename them")
    file.seek(start)
    return header


def _n_complete(file: BufferedReader, position: int, end: int, count: int, size: int = 54, width: int = 2) -> int:
    """Return how many variable-length records, the first of which begins at a position, lie before the end.

    The start of each has `size` bytes, and from the 20th on its length in `width` bytes.
    """
    for i in range(count):
        if position + size > end:
            return i
        file.seek(position + 20)
        position += size + int.from_bytes(file.read(width), "little")
        if position > end:
            return i
    return count


def scale_and_offset(
    parts: Callable[[], Iterable[NDArray[np.float64]]], scale: float, offset: float
) -> tuple[float, float]:
    """Return the scale and the offset in which one axis is stored, by its coordinates in parts, as often as needed.

    They are those of the header if these are exact. Otherwise the scale is the coarsest power of ten that is exact and
    fits 32 bits, or else the finest one that fits.
    """
    if scale and all(_is_exact(part, scale, offset) for part in parts()):
        return scale, offset
    limits = np.array([(part.min(), part.max()) for part in parts() if len(part)] or [(0.0, 0.0)])
    for scale, offset in _scales(float(limits[:, 0].min()), float(limits[:, 1].max())):
        if all(_is_exact(part, scale, offset) for part in parts()):
            break
    return scale, offset


def multiples(
    values: NDArray[np.float64], scale: float | NDArray[np.float64], offset: float | NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return coordinates as they are read from a file, NaN where they do not fit."""
    with np.errstate(all="ignore"):
        numbers = np.rint((values - offset) / scale)
        numbers[~(np.abs(numbers) <= _LARGEST)] = np.nan
        result: NDArray[np.float64] = numbers * scale + offset
    return result


def _is_exact(values: NDArray[np.float64], scale: float, offset: float) -> bool:
    """Return whether values are multiples of a scale that fit, but for two units in the last place: 41 times 0.01."""
    for part in (values[:1000], values[1000:]):  # most scales fail at the first
        with np.errstate(over="ignore"):
            tolerance = 2 * np.spacing(np.maximum(np.abs(part), abs(offset)))
        if not (np.abs(multiples(part, scale, offset) - part) <= tolerance).all():
            return False
    return True


def _scales(lower: float, upper: float) -> Iterator[tuple[float, float]]:
    """Yield powers of ten that fit, the finest last, each with a fitting offset."""
    for offset in (0.0, float(np.rint(lower / 2 + upper / 2))):
        distance = max(upper - offset, offset - lower)
        fits = (e for e in range(-300, 309) if distance <= float(f"1e{e}") * (_LARGEST - 1))
        finest = next(fits) if distance else 0
        # In multiples of coarser scales than the first, all but zero are too small.
        for exponent in range(max(finest, min(finest + 10, 0)), finest - 1, -1):
            yield float(f"1e{exponent}"), offset
