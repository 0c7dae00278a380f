"""Reads and writes LAS and LAZ files; reads COPC files, which are LAZ files with an index of the points."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from io import BufferedReader, BytesIO
from itertools import chain, pairwise
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, exact_as_double
from gppcs.errors import FileFormatError, InputError, OutputError
from gppcs.io.columns import check_name
from gppcs.io.copc import chunks_of
from gppcs.io.format import Format, Reader, Span, from_start
from gppcs.io.las_header import (
    COPC,
    EXTRA_BYTES,
    LASZIP,
    TYPES,
    WITH_WKT,
    LasHeader,
    Record,
    Scaling,
    empty_header,
    extra_name,
    read_header,
    record_of,
    scaling_of,
    waveforms_at,
)
from gppcs.io.laz import chunks_of_points, decompressed_chunks, fewest_points
from gppcs.io.query import Query, not_empty, without_levels
from gppcs.io.rows import BLOCK, at_most, check_length, type_and_shape

_AXES = ("X", "Y", "Z")
UNDESCRIBED = "ExtraBytes"  # laspy's name for bytes of each point that no record describes
LONGEST_NAME = 32
LAST_PLACES = 2.0  # Units in the last place by which 41 times 0.01 may differ from 0.41.
FARTHEST = 1e300  # Largest coordinate. Beyond, a whole number times the scale overflows.
_LARGEST = 2**31 - 1  # of the whole numbers that coordinates are stored as
_LONGEST_RECORD = 2**16 - 1
_SAMPLE = 1000  # coordinates by which a scale is tried first
_FINEST = -300  # the smallest power of ten of a scale
# Point formats for clouds of other sources, in the order of preference, and the versions that have them.
_VERSIONS = {0: 2, 1: 2, 2: 2, 3: 2, 6: 4, 7: 4, 8: 4}


@dataclass(frozen=True)
class _Dimension:
    """Where an attribute stands in the record of a point: in a field, or in some bits of one."""

    field: str
    dtype: np.dtype[Any]
    mask: int = 0
    scaling: Scaling | None = None

    @property
    def shift(self) -> int:
        return (self.mask & -self.mask).bit_length() - 1

    def values(self, points: NDArray[Any]) -> Column:
        """Return the attribute of some points."""
        values = points[self.field]
        if self.scaling:
            return self.scaling.physical(values)
        return (values & self.mask) >> self.shift if self.mask else values

    def store(self, points: NDArray[Any], values: Column) -> None:
        """Set the attribute of some points, whose bits are zero."""
        if self.scaling:
            points[self.field] = self.scaling.stored(values, self.dtype)
        elif self.mask:
            points[self.field] |= values.astype(self.dtype) << self.shift
        else:
            points[self.field] = values

    def fits(self, values: Column) -> bool:
        """Return whether a standard dimension holds an attribute exactly."""
        if values.ndim != 1 or values.dtype.kind not in "biuf":
            return False
        if self.dtype.kind == "f":
            if values.dtype.kind in "iu":
                return exact_as_double(values) and np.array_equal(values.astype(self.dtype), values.astype(np.float64))
            return values.astype(self.dtype).astype(values.dtype).tobytes() == values.tobytes()
        if values.dtype.kind == "f":
            return False
        low, high = np.iinfo(self.dtype).min, np.iinfo(self.dtype).max
        high = self.mask >> self.shift if self.mask else high
        return not len(values) or (low <= int(values.min()) and int(values.max()) <= high)


@dataclass(frozen=True)
class Layout:
    """How points are stored: the type of a point's record, and the attributes in it by name."""

    record: np.dtype[Any]
    dimensions: Mapping[str, _Dimension] = field(default_factory=dict)

    def with_extra(
        self, name: str, dtype: np.dtype[Any], shape: tuple[int, ...] = (), scaling: Scaling | None = None
    ) -> Layout:
        """Return a layout with another attribute in extra bytes."""
        place = f"extra {name}"  # no name of a standard field
        record = np.dtype([*((each, *type_and_shape(self.record[each])) for each in self.record.names or ()),
                           (place, dtype, shape)])  # fmt: skip
        return Layout(record, {**self.dimensions, name: _Dimension(place, dtype, scaling=scaling)})


def _standard_layout(point_format: int) -> Layout:
    from laspy.point.dims import ALL_POINT_FORMATS_DTYPE, COMPOSED_FIELDS

    record = ALL_POINT_FORMATS_DTYPE[point_format]
    parts = COMPOSED_FIELDS[point_format]
    dimensions = {}
    for name in record.names:
        for part in parts.get(name, ()):
            dimensions[part.name] = _Dimension(name, record[name], part.mask)
        if name not in parts and name not in _AXES:
            dimensions[name] = _Dimension(name, record[name])
    return Layout(record, dimensions)


def layout_of(header: LasHeader, fields: NDArray[Any]) -> Layout:
    """Return how the points of a file are stored."""
    number, size = header.point_format, int(fields["point_size"][0])
    if number > 10:
        raise FileFormatError(f"expected a point format of 0 to 10, found {number}")
    layout = _standard_layout(number)
    if size > layout.record.itemsize:  # otherwise there are no extra bytes, even if some are described
        for description in header.descriptions():
            name = extra_name(description)
            if not name or name in layout.dimensions or name in ("x", "y", "z", *_AXES):
                raise FileFormatError(f"expected a name of its own for all extra bytes, found {name!r}; rename them")
            layout = layout.with_extra(name, *_type_of_extra(description), scaling_of(description))
    rest = size - layout.record.itemsize
    if rest < 0:
        raise FileFormatError(f"expected points of {layout.record.itemsize:,} bytes or more, found {size:,}")
    return layout.with_extra(UNDESCRIBED, TYPES[0], (rest,)) if rest else layout


def _type_of_extra(description: NDArray[Any]) -> tuple[np.dtype[Any], tuple[int, ...]]:
    number, options = int(description["type"]), int(description["options"])
    if number == 0:
        return TYPES[0], () if options == 1 else (options,)
    if number > 3 * len(TYPES):
        raise FileFormatError(f"expected extra bytes of a type of 0 to 30, found {number}; the file may be damaged")
    several, kind = divmod(number - 1, len(TYPES))
    return TYPES[kind], (several + 1,) if several else ()


def read_las_chunks(
    file: BufferedReader, rows: int, attributes: bool, query: Query | None = None, span: Span | None = None
) -> Iterator[PointCloud]:
    """Read a LAS, LAZ or COPC file in chunks."""
    yield from at_most(rows, not_empty(_blocks_as_clouds(file, attributes, query, span)))


def open_las(file: BufferedReader, query: Query | None = None) -> Reader:
    """Open a LAS, LAZ or COPC file, of the last of which only those parts are read that a query may ask for."""

    def chunks(n: int, attributes: bool, span: Span | None = None) -> Iterator[PointCloud]:
        file.seek(0)
        return read_las_chunks(file, n, attributes, query, span)

    return Reader(
        chunks,
        _count(read_header(file)[1]),
        skipped=partial(from_start, uncounted_las_points, file),
        spans=partial(from_start, spans_of_las, file),
    )


def uncounted_las_points(file: BufferedReader) -> list[str]:
    """Return in words how many points a LAS or LAZ file holds behind those that its header counts, if any."""
    header, fields, own = read_header(file)
    layout, start = layout_of(header, fields), file.tell()
    if _is_compressed(fields):
        held = fewest_points(file, layout.record, own.get(LASZIP)) if _count(fields) else 0
    else:
        behind = [int(fields[name][0]) for name in ("first_extended", "waveforms")]
        end = min([file.seek(0, 2), *(place for place in behind if place > start)])
        held = (end - start) // layout.record.itemsize
    uncounted = held - _count(fields)
    return [f"points that its header does not count ({uncounted:,} or more)"] if uncounted > 0 else []


def spans_of_las(file: BufferedReader, rows: int) -> list[Span]:
    """Divide the points of a LAS, LAZ or COPC file into parts that can be read by themselves."""
    header, fields, own = read_header(file)
    layout, count = layout_of(header, fields), _count(fields)
    if not count:
        return []
    if _is_compressed(fields):
        chunks = chunks_of_points(file, layout.record, count, own.get(LASZIP))
        ends = np.cumsum([points for _, _, points in chunks]).tolist()
    else:
        check_length(file, layout.record.itemsize, count)
        ends = range(rows, count, rows)
    begins = [0]
    for end in ends:
        if begins[-1] + rows <= end < count:
            begins.append(end)
    return list(pairwise([*begins, count]))


def _count(fields: NDArray[Any]) -> int:
    return int(fields["count"][0]) or int(fields["legacy_count"][0])


def _is_compressed(fields: NDArray[Any]) -> bool:
    return bool(int(fields["point_format"][0]) & 0b11000000)


def _blocks_as_clouds(
    file: BufferedReader, attributes: bool, query: Query | None, span: Span | None
) -> Iterator[PointCloud]:
    """Yield a cloud without points, and then one for each block of points."""
    header, fields, own = read_header(file)
    layout, compressed = layout_of(header, fields), _is_compressed(fields)
    count = _count(fields)
    scales, offsets = fields["scales"][0], fields["offsets"][0]
    if query and compressed and COPC in own:
        chunks = chunks_of(file, own[COPC].data, query, scales)
        blocks = decompressed_chunks(file, layout.record, chunks, own.get(LASZIP))
    elif query and query.resolution is not None:
        raise without_levels("LAZ without them" if compressed else "LAS")
    elif compressed:
        chunks = chunks_of_points(file, layout.record, count, own.get(LASZIP))
        if span:
            ends = np.cumsum([points for _, _, points in chunks])
            chunks = chunks[slice(*np.searchsorted(ends, span, side="right"))]
        blocks = decompressed_chunks(file, layout.record, chunks, own.get(LASZIP))
    else:
        blocks = _uncompressed(file, layout, *(span or (0, count)))
    for block in chain([np.empty(0, layout.record)], blocks):
        points = coordinates_of(block, scales, offsets)
        if query:
            inside = query.holds(points)
            points, block = points[inside], block[inside]
        yield PointCloud(points, attributes_of(block, layout) if attributes else {}, header=header)


def attributes_of(points: NDArray[Any], layout: Layout) -> dict[str, Column]:
    """Return the attributes of points as they are stored."""
    return {
        name: np.ascontiguousarray(
            dimension.values(points), np.float64 if dimension.scaling else dimension.dtype.newbyteorder("=")
        )
        for name, dimension in layout.dimensions.items()
    }


def _uncompressed(file: BufferedReader, layout: Layout, begin: int, end: int) -> Iterator[NDArray[Any]]:
    size = layout.record.itemsize
    check_length(file, size, end)
    file.seek(begin * size, 1)
    for first in range(begin, end, BLOCK):
        n = min(BLOCK, end - first)
        yield np.frombuffer(file.read(n * size), layout.record, n)


def coordinates_of(
    points: NDArray[Any], scales: NDArray[np.float64], offsets: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the coordinates of points as they are stored, with a scale and an offset of each axis."""
    result = np.empty((len(points), 3))
    with np.errstate(all="ignore"):
        for i, axis in enumerate(_AXES):
            result[:, i] = points[axis] * scales[i] + offsets[i]
            if not np.array_equal(np.rint((result[:, i] - offsets[i]) / scales[i]), points[axis]):
                raise FileFormatError(
                    f"expected a scale and an offset of {axis} that keep different coordinates different, found "
                    f"{scales[i]:g} and {offsets[i]:g}; the file may be damaged"
                )
    return result


def write_las(file: BinaryIO, cloud: PointCloud, compressed: bool) -> None:
    """Write a LAS or LAZ file."""
    import lazrs

    header, layout = header_of(cloud), layout_to_write(cloud)
    if header.minor_version < 4 and len(cloud) >= 2**32:
        raise OutputError(f"expected fewer than 2^32 points in LAS 1.{header.minor_version}, found {len(cloud):,}")
    kind = compression_of(header, layout) if compressed else None
    header = write_header(file, header, layout, kind, counts_of(cloud))
    blocks = (records_of(cloud[start : start + BLOCK], layout) for start in range(0, len(cloud), BLOCK))
    if kind:
        with reported_compression():
            compressor = lazrs.ParLasZipCompressor(file, kind)
            for block in blocks:
                compressor.compress_many(block.view(np.uint8))
            compressor.done()
        file.seek(0, 2)
    else:
        for block in blocks:
            file.write(block.view(np.uint8).data)
    write_extended(file, header)


def layout_to_write(cloud: PointCloud) -> Layout:
    """Return how the points of a cloud are stored, which `stored` has returned."""
    header = header_of(cloud)
    layout, described = _standard_layout(header.point_format), header.extra_bytes
    for name, values in cloud.attributes.items():
        if name not in layout.dimensions:
            if name in described:
                layout = layout.with_extra(name, *_type_of_extra(described[name]), scaling_of(described[name]))
            else:
                assert name == UNDESCRIBED
                layout = layout.with_extra(name, values.dtype.newbyteorder("<"), values.shape[1:])
    if (size := layout.record.itemsize) > _LONGEST_RECORD:
        raise OutputError(f"expected points of at most {_LONGEST_RECORD:,} bytes, found {size:,}; drop attributes")
    return layout


def header_of(cloud: PointCloud) -> LasHeader:
    """Return the header of a cloud that `stored` has returned."""
    assert isinstance(cloud.header, LasHeader)
    return cloud.header


def compression_of(header: LasHeader, layout: Layout, by_nodes: bool = False) -> Any:
    """Return lazrs' description of the compression; `by_nodes` lets chunks have any number of points."""
    import lazrs

    number = header.point_format
    extra = layout.record.itemsize - _standard_layout(number).record.itemsize
    return lazrs.LazVlr.new_for_compression(number, extra, use_variable_size_chunks=by_nodes)


def write_header(
    file: BinaryIO, header: LasHeader, layout: Layout, kind: Any, counts: dict[str, Any], first: Sequence[Record] = ()
) -> LasHeader:
    """Write what stands before the points, and return it; `first` are the first records."""
    records = [*first, *(each for each in header.records if not each.extended)]
    if kind:
        records.append(record_of(LASZIP, b"lazrs", bytes(kind.record_data())))
    before = b"".join(each.content for each in records) + header.padding
    header = header.with_fields(
        offset_to_points=len(header.block) + len(before),
        n_records=len(records),
        point_format=header.point_format | (0b10000000 if kind else 0),
        point_size=layout.record.itemsize,
        **counts,
    )
    file.write(header.block + before)
    return header


@contextmanager
def reported_compression() -> Iterator[None]:
    """Raise an error of lazrs, which hides why the file could not be written, as an OutputError."""
    import lazrs

    try:
        yield
    except (lazrs.LazrsError, OSError) as error:
        if getattr(error, "errno", None) is not None:  # not from lazrs
            raise
        raise OutputError(f"expected to write LAZ, but {error}; the disk may be full, or its quota used up") from error


def write_extended(file: BinaryIO, header: LasHeader) -> None:
    """Write the records behind the points, and where they are."""
    position = file.tell()
    waveforms, content = waveforms_at(header.records, position)
    if content:
        file.write(content)
        fields = {"waveforms": waveforms}
        if header.minor_version >= 4:
            fields |= {"first_extended": position, "n_extended": sum(each.extended for each in header.records)}
        file.seek(0)
        file.write(header.with_fields(**fields).block)


def counts_of(cloud: PointCloud) -> dict[str, Any]:
    """Return what the public header block says of the points: how many, how many of each return, and bounds."""
    header = header_of(cloud)
    returns = np.bincount(cloud.attributes.get("return_number", np.empty(0, np.uint8)), minlength=16)[1:16]
    bounds = np.zeros((3, 2))
    if len(cloud):
        bounds = np.array([[values.max(), values.min()] for values in cloud.points.T])
    fields: dict[str, Any] = {"bounds": bounds}
    if header.minor_version >= 4:
        fields |= {"count": len(cloud), "returns": returns}
    if header.point_format < WITH_WKT and len(cloud) < 2**32:
        fields |= {"legacy_count": len(cloud), "legacy_returns": returns[:5]}
    return fields


def records_of(cloud: PointCloud, layout: Layout) -> NDArray[Any]:
    """Return the points of a cloud as they are stored."""
    block = np.zeros(len(cloud), layout.record)
    store_coordinates(block, cloud.points, header_of(cloud))
    for name, values in cloud.attributes.items():
        layout.dimensions[name].store(block, values)
    return block


def store_coordinates(block: NDArray[Any], points: NDArray[np.float64], header: LasHeader) -> None:
    """Set the coordinates of points as they are stored."""
    fields = header.fields()
    for i, axis in enumerate(_AXES):
        block[axis] = np.rint((points[:, i] - fields["offsets"][0, i]) / fields["scales"][0, i])


def to_laspy(cloud: PointCloud) -> Any:
    """Return a cloud as data of laspy, a `LasData`, as it would be written to a file and laspy would read it."""
    import laspy

    fit = FORMATS[0].fit(cloud)
    if fit.values:
        raise InputError(f"expected what LAS can hold, found {', '.join(fit.values)}; convert or drop it")
    with BytesIO() as file:
        write_las(file, fit.cloud, compressed=False)
        file.seek(0)
        return laspy.read(file)


def stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud as `write_las` writes it, with a `LasHeader`."""
    _check_coordinates(cloud)
    header = cloud.header if isinstance(cloud.header, LasHeader) else new_header(cloud, _VERSIONS)
    cloud, header = _fit_attributes(cloud, header)
    points, header = _fit_points(cloud.points, header)
    return replace(cloud, points=points, coordinate_dtype=np.dtype(np.float64), header=header)


def _check_coordinates(cloud: PointCloud) -> None:
    if len(bad := cloud.non_finite()):
        raise OutputError(
            f"expected finite coordinates, which alone LAS can hold, found {len(bad):,} points with NaN or infinite "
            f"ones, the first at index {bad[0]}; drop invalid points first, or write PLY"
        )
    if np.abs(cloud.points).max(initial=0.0) > FARTHEST:
        raise OutputError(
            f"expected coordinates of at most {FARTHEST:g} in LAS, found larger ones: drop them first, or write PLY"
        )


def new_header(cloud: PointCloud, formats: Mapping[int, int]) -> LasHeader:
    """Return a header with the first point format that holds the most attributes as standard dimensions."""
    layouts = {number: _standard_layout(number).dimensions for number in formats}

    def held(number: int) -> int:
        return sum(
            name in layouts[number] and layouts[number][name].fits(values) for name, values in cloud.attributes.items()
        )

    best = max(layouts, key=held)
    minor = formats[best] if len(cloud) < 2**32 else 4
    return empty_header(minor, best).with_fields(system_identifier=b"OTHER", generating_software=b"gppcs")


def _fit_attributes(cloud: PointCloud, header: LasHeader) -> tuple[PointCloud, LasHeader]:
    """Convert attributes to the types that the file has for them, and describe those in extra bytes."""
    standard, described = _standard_layout(header.point_format).dimensions, header.extra_bytes
    kept: dict[str, Column] = {}
    descriptions, last = [], {}
    for name, values in cloud.attributes.items():
        if name in standard:
            if standard[name].fits(values):
                kept[name] = values.astype(standard[name].dtype.newbyteorder("="), copy=False)
            continue
        if name == UNDESCRIBED and name not in described and values.dtype == np.uint8 and values.ndim == 2:
            last[name] = values  # stands behind all that are described
            continue
        if name in described and _keeps_scale(values, described[name]):
            kept[name] = values
            descriptions.append(described[name])
            continue
        for part, column in _extra_columns(name, values).items():
            check_name(part, (*kept, *last, *standard, *_AXES))
            kept[part] = column
            descriptions.append(_description(part, column, described.get(part)))
    header = _with_descriptions(header, descriptions)
    return replace(cloud, attributes={**kept, **last}), header


def _keeps_scale(values: Column, description: NDArray[Any]) -> bool:
    """Return whether physical values are exactly those that scaled extra bytes hold."""
    scaling, (dtype, shape) = scaling_of(description), _type_of_extra(description)
    if scaling is None or values.dtype != np.float64 or values.shape[1:] != shape:
        return False
    with np.errstate(invalid="ignore", over="ignore"):
        return bool(np.array_equal(scaling.physical(scaling.stored(values, dtype)), values))


def _with_descriptions(header: LasHeader, descriptions: list[NDArray[Any]]) -> LasHeader:
    if len(descriptions) * EXTRA_BYTES.itemsize > _LONGEST_RECORD:
        most = _LONGEST_RECORD // EXTRA_BYTES.itemsize
        raise OutputError(f"expected at most {most} attributes in extra bytes, found {len(descriptions):,}; drop some")
    return header.with_extra_bytes(descriptions)


def _extra_columns(name: str, values: Column) -> dict[str, Column]:
    """Return an attribute as columns of types that extra bytes can have; none if there are no such types."""
    dtype = values.dtype.newbyteorder("=")
    if dtype.kind == "b":
        dtype = np.dtype(np.uint8)
    elif dtype == np.float16:
        dtype = np.dtype(np.float32)
    elif dtype.kind == "f" and dtype.itemsize > 8 and exact_as_double(values):
        dtype = np.dtype(np.float64)
    width = math.prod(values.shape[1:])
    if dtype not in TYPES or not width:
        return {}
    values = np.ascontiguousarray(values, dtype).reshape(len(values), width)
    if width == 1:
        return {name: values[:, 0]}
    if width <= 3 or (dtype == np.uint8 and width <= 255):
        return {name: values}
    return {f"{name}_{i}": values[:, i] for i in range(width)}


def _description(name: str, values: Column, known: NDArray[Any] | None) -> NDArray[Any]:
    """Return what describes an attribute in extra bytes: what the header holds, if that is of the same type."""
    if known is not None and _type_of_extra(known) == (values.dtype.newbyteorder("<"), values.shape[1:]):
        return known
    if len(name.encode()) > LONGEST_NAME:
        raise OutputError(
            f"expected a name of at most {LONGEST_NAME} bytes for each attribute in LAS, found {name!r}; rename it"
        )
    width = values.shape[1] if values.ndim > 1 else 1
    number = TYPES.index(values.dtype.newbyteorder("<")) + 1
    new = np.zeros((), EXTRA_BYTES)
    new["name"] = name.encode()
    new["type"], new["options"] = (number + (width - 1) * len(TYPES), 0) if width <= 3 else (0, width)
    return new


def _fit_points(points: NDArray[np.float64], header: LasHeader) -> tuple[NDArray[np.float64], LasHeader]:
    """Return the coordinates as whole multiples of a scale, and a header with that scale."""
    fields = header.fields()
    scales, offsets = fields["scales"][0], fields["offsets"][0]
    for i, values in enumerate(points.T):
        scales[i], offsets[i] = scale_and_offset(partial(list, [values]), scales[i], offsets[i])
    return multiples(points, scales, offsets), header.with_fields(scales=scales, offsets=offsets)


def scale_and_offset(
    parts: Callable[[], Iterable[NDArray[np.float64]]], scale: float, offset: float
) -> tuple[float, float]:
    """Return the scale and the offset in which one axis is stored, given its coordinates in parts, as often as asked.

    They are those of the header if these are exact. Otherwise the scale is the coarsest power of ten that is exact and
    fits 32 bits, or else the finest one that fits.
    """
    if all(_is_exact(part, scale, offset) for part in parts()):
        return scale, offset
    limits = [(part.min(), part.max()) for part in parts() if len(part)]
    low, high = float(min(low for low, _ in limits)), float(max(high for _, high in limits))
    for scale, offset, rounding in _powers(low, high):
        if all(_is_exact(part, scale, offset, rounding) for part in parts()):
            break
    return scale, offset


def multiples(
    values: NDArray[np.float64], scale: float | NDArray[np.float64], offset: float | NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return coordinates as they are read from a file, NaN where they do not fit."""
    with np.errstate(all="ignore"):
        whole = np.rint((values - offset) / scale)
        whole[~(np.abs(whole) <= _LARGEST)] = np.nan
        result: NDArray[np.float64] = whole * scale + offset
    return result


def _is_exact(values: NDArray[np.float64], scale: float, offset: float, rounding: float = 0.0) -> bool:
    """Return whether values are whole multiples of a scale that fit, but for `rounding` units in the last place."""

    def all_are(part: NDArray[np.float64]) -> bool:
        with np.errstate(over="ignore"):
            tolerance = rounding * np.spacing(np.maximum(np.abs(part), abs(offset))) if rounding else 0.0
        return bool((np.abs(multiples(part, scale, offset) - part) <= tolerance).all())

    return all_are(values[:_SAMPLE]) and all_are(values[_SAMPLE:])  # most scales fail at the first


def _powers(low: float, high: float) -> Iterator[tuple[float, float, float]]:
    """Yield scales that fit, the finest last, with a fitting offset and the rounding in which they count as exact."""
    middle = float(np.rint(low / 2 + high / 2))
    for offset in (0.0, middle):
        finest = _finest(max(high - offset, offset - low))
        # In multiples of coarser scales than the first, all but zero are too small.
        for exponent in range(max(finest, min(finest + 10, 0)), finest - 1, -1):
            rounding = LAST_PLACES if -9 <= exponent <= 0 else 0.0  # People write numbers in these scales.
            yield float(f"1e{exponent}"), offset, rounding


def _finest(reach: float) -> int:
    """Return the exponent of the smallest power of ten in which a length is at most a whole number of 31 bits."""
    if reach <= 0:
        return 0
    exponent = max(math.ceil(math.log10(reach) - math.log10(_LARGEST)), _FINEST)
    return exponent + (reach / float(f"1e{exponent}") > _LARGEST - 1)


def _format(name: str, suffix: str, compressed: bool) -> Format:
    write: Callable[[BinaryIO, PointCloud], None] = partial(write_las, compressed=compressed)
    return Format(
        name,
        (suffix,),
        open_las,
        write,
        lambda start, size: (
            start.startswith(b"LASF") and len(start) > 104 and bool(start[104] & 0b11000000) == compressed
        ),
        stored,
        frozenset({"query"}),
    )


FORMATS = (_format("LAS", ".las", False), _format("LAZ", ".laz", True))
