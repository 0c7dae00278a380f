"""Reads and writes LAS and LAZ files: headers by laspy, compressed points by lazrs; reads COPC files as LAZ."""

from __future__ import annotations

import errno
import math
import re
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import replace
from functools import cache, partial
from io import BufferedReader
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.colours import full_scale
from gppcs.clouds.columns import COLOUR, Column, exact_as_double
from gppcs.errors import InputError, OutputError
from gppcs.io.columns import check_name, exact_type
from gppcs.io.format import Format, Reader, Span, begins
from gppcs.io.las_header import (
    WAVEFORMS,
    LasHeader,
    dated,
    descriptions_of,
    kind_of,
    multiples,
    no_data_of,
    read_header,
    scale_and_offset,
)  # fmt: skip
from gppcs.io.laz import check_counts, checked_chunks, points_of
from gppcs.io.rows import BLOCK, MAX_EXPANSION, at_most, check_unpacked, damaged, size_of_repeats

if TYPE_CHECKING:
    import laspy
    from laspy.point.dims import DimensionInfo

# Point formats for clouds of other sources, in the order of preference: none has waveforms, COPC has the last three.
POINT_FORMATS = (0, 1, 2, 3, 6, 7, 8)
_SYNONYMS = {"class": "classification", "infrared": "nir", "nearinfrared": "nir", "numreturns": "number_of_returns"}


def open_las(
    file: BufferedReader, select: Callable[[BufferedReader, laspy.LasHeader], NDArray[Any]] = checked_chunks
) -> Reader:
    """Open a LAS, LAZ or COPC file; `select` returns the chunks that are read."""
    las = read_header(file)
    if not (np.isfinite([las.scales, las.offsets]).all() and las.scales.all()):
        raise damaged("finite scales and offsets", f"{las.scales} and {las.offsets}")
    header = LasHeader.from_laspy(las)
    skipped = [
        f"the mark of no data of attribute {name} ({' '.join(map(str, value))} is read as a number, with its scale)"
        for name, value in no_data_of(las).items()
        if las.point_format.dimension_by_name(name).is_scaled
    ]
    skipped += ["waveforms"] if las.version.minor == 3 and las.start_of_waveform_data_packet_record else []

    def chunks(n: int, span: Span | None = None) -> Iterator[PointCloud]:
        """Read the points in chunks, the first of which has no points."""
        selected = select(file, las)
        if span:
            selected = selected[slice(*np.searchsorted(np.cumsum(selected["count"]), span, side="right"))]
        blocks = chain([np.empty(0, las.point_format.dtype())], points_of(file, las, selected))
        return at_most(n, (cloud_of(block, las, header) for block in blocks))

    def spans(n: int) -> list[Span]:
        """Divide the points at borders of chunks."""
        begins = [0]
        for end in np.cumsum(select(file, las)["count"]).tolist():
            if begins[-1] + n <= end < las.point_count:
                begins.append(end)
        return list(pairwise([*begins, las.point_count])) if las.point_count else []

    bounds = np.array([las.mins, las.maxs])
    memory, size = 0, file.seek(0, 2)
    unpacked = las.point_count * las.point_format.size
    if las.are_points_compressed and unpacked > MAX_EXPANSION * size:  # unless the header lies
        chunk_table = select(file, las)
        check_counts(chunk_table)
        count = int(chunk_table["count"].sum())
        check_unpacked(count * las.point_format.size, size)
        memory = size_of_repeats(count, size)
    return Reader(chunks, las.point_count, skipped=skipped, spans=spans, bounds=bounds, memory=memory)


def cloud_of(block: NDArray[Any], las: laspy.LasHeader, header: LasHeader) -> PointCloud:
    """Return points as they are stored as a cloud."""
    return PointCloud(coordinates_of(block, las), _attributes_of(block, las), header=header)


def coordinates_of(block: NDArray[Any], las: laspy.LasHeader) -> NDArray[np.float64]:
    """Return the coordinates (n, 3) of points as they are stored."""
    with np.errstate(all="ignore"):
        axes = zip("XYZ", las.scales, las.offsets, strict=True)
        return np.stack([block[axis] * scale + offset for axis, scale, offset in axes], axis=1)


def _attributes_of(block: NDArray[Any], las: laspy.LasHeader) -> dict[str, Column]:
    """Return the attributes of points as they are stored."""
    import laspy

    record = laspy.PackedPointRecord(block, las.point_format)
    columns = {}
    for dimension in las.point_format.dimensions[3:]:
        is_bit_field = dimension.dtype is None
        values = np.asarray(record[dimension.name]) if is_bit_field else _physical(block[dimension.name], dimension)
        columns[dimension.name] = np.ascontiguousarray(values, values.dtype.newbyteorder("="))
    return columns


def _physical(values: NDArray[Any], dimension: DimensionInfo) -> Column:
    """Return the values that stored numbers of a dimension stand for."""
    values = values[:, 0] if values.shape[1:] == (1,) else values  # of one byte that no record describes
    return values * dimension.scales + dimension.offsets if dimension.is_scaled else values


def _stored(values: Column, dimension: DimensionInfo) -> Column | None:
    """Return an attribute as the numbers that a dimension stores; None if these would not give it back exactly."""
    dtype = np.dtype(np.uint8) if dimension.dtype is None else dimension.dtype  # of a bit field
    if values.dtype.kind not in "biuf" or values.shape[1:] != (dtype.shape if dtype.shape != (1,) else ()):
        return None
    if dtype.base.kind == "f" and values.dtype.kind in "iu" and not exact_as_double(values):
        return None
    with np.errstate(all="ignore"):
        numbers = (values - dimension.offsets) / dimension.scales if dimension.is_scaled else values
        if numbers.dtype.kind == "f" and dtype.base.kind != "f":
            numbers = np.rint(numbers)
        stored = numbers.astype(dtype.base, copy=False)
        is_exact = np.array_equal(_physical(stored, dimension), values, equal_nan=values.dtype.kind == "f")
    if dimension.dtype is None and len(stored):
        is_exact = is_exact and stored.max() <= dimension.max
    return stored if is_exact else None


def write_las(file: BinaryIO, cloud: PointCloud, compressed: bool) -> None:
    """Write a LAS or LAZ file of a cloud that `stored` has returned."""
    import laspy

    las = dated(header_of(cloud))
    with (
        reported_writing(),
        laspy.LasWriter(file, las, compressed, closefd=False, encoding_errors="surrogateescape") as writer,
    ):
        for start in range(0, len(cloud), BLOCK):
            block = records_of(cloud[start : start + BLOCK], las)
            points = laspy.PackedPointRecord(block, las.point_format)
            if compressed:
                writer.write_points(points)
            else:  # laspy writes no points of dimensions with a colon in their names
                writer.header.grow(points)
                file.write(block.view(np.uint8).data)
        if las.evlrs:
            writer.write_evlrs(las.evlrs)
            position = writer.header.start_of_first_evlr
            for record in las.evlrs:
                if kind_of(record) == WAVEFORMS:
                    writer.header.start_of_waveform_data_packet_record = position
                position += 60 + len(record.record_data_bytes())


def header_of(cloud: PointCloud) -> laspy.LasHeader:
    """Return the header of a cloud that `stored` has returned."""
    assert isinstance(cloud.header, LasHeader)
    return cloud.header.las


def records_of(cloud: PointCloud, las: laspy.LasHeader) -> NDArray[Any]:
    """Return the points of a cloud as they are stored, (n,)."""
    import laspy

    record = laspy.PackedPointRecord.zeros(len(cloud), las.point_format)
    set_coordinates(record.array, cloud.points, las)
    for dimension in las.point_format.dimensions[3:]:
        if dimension.name in cloud.attributes:
            values = _stored(cloud.attributes[dimension.name], dimension)
            assert values is not None
            if dimension.dtype is None:
                record[dimension.name][:] = values
            else:
                stored = record.array[dimension.name]
                stored[:] = np.reshape(values, stored.shape)
    return record.array


def set_coordinates(block: NDArray[Any], points: NDArray[np.float64], las: laspy.LasHeader) -> None:
    """Set the coordinates of points as they are stored."""
    for axis, values, scale, offset in zip("XYZ", points.T, las.scales, las.offsets, strict=True):
        block[axis] = np.rint((values - offset) / scale)


@contextmanager
def reported_writing() -> Iterator[None]:
    """Raise an error of laspy as an OutputError, and one of lazrs, which hides the cause, as that of a full disk."""
    import laspy
    import lazrs

    try:
        yield
    except (lazrs.LazrsError, OSError) as error:
        if getattr(error, "errno", None) is not None or isinstance(error, OutputError):  # not from lazrs
            raise
        raise OSError(errno.ENOSPC, f"lazrs reports: {error}, perhaps of a full disk") from error
    except (laspy.LaspyException, ValueError, OverflowError) as error:
        raise OutputError(f"expected a header that LAS can hold, but laspy reports: {error}") from error


def to_laspy(cloud: PointCloud) -> laspy.LasData:
    """Return a cloud as data of laspy, as it would be written to a file and laspy would read it."""
    import laspy

    fit = FORMATS[0].fit(cloud)
    if fit.values:
        raise InputError(f"expected what LAS can hold, found {', '.join(fit.values)}; convert or drop it")
    las = dated(header_of(fit.cloud))
    block = records_of(fit.cloud, las)
    las.update(laspy.PackedPointRecord(block, las.point_format))
    return laspy.LasData(las, laspy.ScaleAwarePointRecord(block, las.point_format, las.scales, las.offsets))


def stored(cloud: PointCloud, point_formats: Collection[int] = POINT_FORMATS, widest: int = 3) -> PointCloud:
    """Return a cloud as `write_las` writes it, with a `LasHeader`.

    If it has no such header yet, it gets one of the point formats. Attributes in extra bytes have at most `widest`
    numbers for each point; wider ones become several.
    """
    check_coordinates(cloud.points)
    cloud = _in_las_terms(cloud)
    las = deepcopy(cloud.header.las) if isinstance(cloud.header, LasHeader) else _new_header(cloud, point_formats)
    attributes = _fit_attributes(cloud, las, widest)
    for i, values in enumerate(cloud.points.T):
        las.scales[i], las.offsets[i] = scale_and_offset(partial(list, [values]), las.scales[i], las.offsets[i])
    points = multiples(cloud.points, las.scales, las.offsets)
    return PointCloud(points, attributes, header=LasHeader.from_laspy(las))


def in_thousandths(cloud: PointCloud, unit: str, metres: str) -> PointCloud:
    """Return a cloud whose coordinates are multiples of 0.001 in LAS 1.4, in a local system of a unit."""
    import laspy

    las = laspy.LasHeader(version="1.4", point_format=7)
    las.scales, las.creation_date, las.global_encoding.wkt = np.full(3, 0.001), None, True
    wkt = f'LOCAL_CS["sample",UNIT["{unit}",{metres}]]'
    las.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
    points = multiples(cloud.points, 0.001, 0.0)
    return PointCloud(points, cloud.attributes, header=LasHeader.from_laspy(las))


@cache
def _dimensions() -> dict[str, DimensionInfo]:
    """Return the dimensions of all point formats by their names without underscores."""
    import laspy

    return {d.name.replace("_", ""): d for number in (3, 8) for d in laspy.PointFormat(number).dimensions[3:]}


def las_name(name: str) -> str:
    """Return the name of the dimension that a name stands for, or the same if there is none."""
    plain = re.sub(r"[\s_]", "", name.lower()).removeprefix("scalar")
    dimension = _dimensions().get(_SYNONYMS.get(plain, plain))
    return dimension.name if dimension else name


def _in_las_terms(cloud: PointCloud) -> PointCloud:
    """Return a cloud with the names of LAS, and with 16 bits of intensities and colours that do not fit these."""
    in_header = cloud.header.las.point_format.dimension_names if isinstance(cloud.header, LasHeader) else ()
    columns: dict[str, Column] = {}
    for name, values in cloud.attributes.items():
        new = name if name in in_header else las_name(name)
        columns[name if new in cloud.attributes or new in columns else new] = values
    for group in (("intensity",), COLOUR):
        wide = [columns[name] for name in group if name in columns and not np.can_cast(columns[name].dtype, np.uint16)]
        if len(wide) == len(group) and all(column.ndim == 1 and column.dtype.kind in "iuf" for column in wide):
            table: NDArray[Any] = np.stack(wide)
            if not table.size or np.isinf(table).any():
                continue
            lower = min(0.0, float(np.fmin.reduce(table, axis=None)))
            upper = float(np.fmax.reduce(table, axis=None))
            if lower < 0.0 or upper > 65535.0 or not np.array_equal(table, np.rint(table), equal_nan=True):
                full = full_scale(table) if lower == 0.0 and upper <= 65535.0 else upper - lower
                scaled = np.clip(np.nan_to_num(table - lower) * (65535 / (full or 1.0)), 0, 65535)
                columns |= zip(group, np.rint(scaled).astype(np.uint16), strict=True)
    dimensions = {dimension.name: dimension for dimension in _dimensions().values()}
    attributes = {}
    for (name, values), (new, column) in zip(cloud.attributes.items(), columns.items(), strict=True):
        fits = new in dimensions and _stored(column, dimensions[new]) is not None
        attributes[new if fits else name] = column if fits else values
    return replace(cloud, attributes=attributes)


def check_coordinates(points: NDArray[np.float64]) -> None:
    """Check that LAS can hold coordinates (n, 3)."""
    if n := np.count_nonzero(~np.isfinite(points).all(axis=1)):
        raise OutputError(
            f"expected finite coordinates, which alone LAS can hold, found {n:,} points with NaN or infinite ones; "
            "drop them first, as with cloud[cloud.is_finite()] or `invalid='drop'`, or write PLY"
        )
    if np.abs(points).max(initial=0.0) > 1e300:  # beyond, a whole number times the scale overflows
        raise OutputError("expected coordinates of at most 1e300 in LAS, found larger ones; drop them, or write PLY")


def _new_header(cloud: PointCloud, point_formats: Collection[int]) -> laspy.LasHeader:
    """Return a header with the first point format that holds the most attributes as standard dimensions."""
    import laspy

    def n_held(point_format: laspy.PointFormat) -> int:
        held = (d for d in point_format.dimensions[3:] if d.name in cloud.attributes)
        return sum(_stored(cloud.attributes[dimension.name], dimension) is not None for dimension in held)

    best = max(map(laspy.PointFormat, point_formats), key=n_held)
    is_new = best.id >= 6 or len(cloud) >= 2**32
    las = laspy.LasHeader(version="1.4" if is_new else "1.2", point_format=best)
    las.global_encoding.wkt = best.id >= 6
    las.creation_date = None
    las.scales = np.zeros(3)  # which no coordinates fit, so that `scale_and_offset` looks for better ones
    return las


def _fit_attributes(cloud: PointCloud, las: laspy.LasHeader, widest: int) -> dict[str, Column]:
    """Convert attributes to the types that a header has for them, and describe those in extra bytes in the header."""
    import laspy
    from laspy.point.dims import DimensionInfo

    standard = laspy.PointFormat(las.point_format.id)
    taken = (*standard.dimension_names, *standard.dtype().names)
    dimensions = {dimension.name: dimension for dimension in las.point_format.dimensions[3:]}
    kept: dict[str, Column] = {}
    extra = []
    for name, values in cloud.attributes.items():
        dimension = dimensions.get(name)
        is_usable = dimension and (dimension.num_elements <= widest or dimension.num_elements > 3 == widest)
        column = _stored(values, dimension) if dimension and is_usable else None
        if dimension and column is not None:
            kept[name] = values if dimension.is_scaled else column
            extra += [] if dimension.is_standard else [dimension]
        elif dimension is None or not dimension.is_standard:
            for part, numbers in _extra_columns(name, values, widest).items():
                check_name(part, (*kept, *taken))
                kept[part] = numbers
                dtype = np.dtype((numbers.dtype, numbers.shape[1:]))
                extra.append(DimensionInfo.from_dtype(part, dtype, is_standard=False))
    standard.dimensions += extra
    no_data = no_data_of(las)
    if standard != las.point_format:
        with reported_writing():
            las.point_format = standard
        for description in descriptions_of(las):
            name = description.format_name()
            if name in no_data and any(dimension is dimensions[name] for dimension in extra):
                description.no_data = no_data[name]
    return kept


def _extra_columns(name: str, values: Column, widest: int) -> dict[str, Column]:
    """Return an attribute as columns of types that extra bytes can have; none if there are no such types."""
    types = [np.dtype(kind) for kind in ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")]
    dtype, width = exact_type(values, types), math.prod(values.shape[1:])
    if dtype is None:
        return {}
    columns = np.ascontiguousarray(values, dtype).reshape(len(values), width)
    if width == 1:
        return {name: columns[:, 0]}
    return {name: columns} if width <= widest else {f"{name}_{i}": column for i, column in enumerate(columns.T)}


_write_las, _write_laz = partial(write_las, compressed=False), partial(write_las, compressed=True)
_is_las, _is_laz = begins(rb"LASF.{100}[\x00-\x3f]"), begins(rb"LASF.{100}[\x40-\xff]")  # by the point format
FORMATS = (
    Format("LAS", (".las",), open_las, _write_las, _is_las, stored, renamed=las_name),
    Format("LAZ", (".laz",), open_las, _write_laz, _is_laz, stored, renamed=las_name),
)
