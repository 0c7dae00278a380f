"""Writes COPC files: LAZ files whose chunks are the nodes of an octree, from coarse to fine."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds import above
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column
from gppcs.errors import OutputError
from gppcs.io import las
from gppcs.io.copc import ENTRY, INFO
from gppcs.io.copc_levels import MOST, Cube, by_node, level_and_cell, levels_of
from gppcs.io.las_header import (
    COPC,
    COPC_HIERARCHY,
    EXTENDED,
    RECORD,
    SIZES,
    TYPES,
    WAVEFORMS,
    LasHeader,
    empty_header,
    record_of,
)

ORDERS = ("gp", "fps", "random", "order")
RANKED, RANKED_SHARE = 1 << 20, 4  # Points that a method ranks, at most: so many, or this part of the cloud.
AT_ONCE = 16  # Nodes that are compressed at once.
# Point formats of older versions, and of waveforms, and those that hold their dimensions.
_RAISED = {0: 6, 1: 6, 2: 7, 3: 7, 4: 6, 5: 7, 9: 6, 10: 8}
_VERSIONS = dict.fromkeys((6, 7, 8), 4)
_DEGREES = 0.006  # of which scan angles are multiples from point format 6 on
_OF_WAVEFORMS = 0b110  # bits of the global encoding


@dataclass(frozen=True)
class Summary:
    """What a file says of its points."""

    header: LasHeader
    layout: las.Layout  # how each of them is stored
    counts: dict[str, Any]  # fields of the header: their number, how many there are of each return, and bounds
    gps_time: NDArray[np.float64]  # (2,), the earliest and the latest

    @classmethod
    def of(cls, cloud: PointCloud) -> Summary:
        """Return what is said of a cloud that `FORMAT` has made fit."""
        times = cloud.attributes.get("gps_time", np.zeros(1))
        span = np.array([times.min(initial=np.inf), times.max(initial=-np.inf)])
        return cls(las.header_of(cloud), las.layout_to_write(cloud), las.counts_of(cloud), span)

    @property
    def cube(self) -> Cube:
        """The cell of the first level."""
        high, low = self.counts["bounds"].T
        return Cube.around(low, high)


def write_copc(file: BinaryIO, cloud: PointCloud, levels_by: str = ORDERS[0]) -> None:
    """Write a COPC file of a cloud in memory."""
    summary, ranking = Summary.of(cloud), np.arange(len(cloud))
    if levels_by != "order" and len(cloud) > MOST:
        ranking = above.rank(cloud, levels_by, ranked_of(len(cloud)))
    codes = summary.cube.codes(cloud.points)
    level = levels_of(codes, ranking)
    keys, order, starts = by_node(codes, level)
    rows = np.split(order, starts[1:])[: len(keys)]  # one part, without points, if there are no nodes
    records = (las.records_of(cloud.take(each), summary.layout) for each in rows)
    write_octree(file, summary, keys.tolist(), cloud.points[level == 0], records)


def ranked_of(n: int) -> int:
    """Return how many of so many points are ranked."""
    return max(1, min(n // RANKED_SHARE, RANKED))


def write_octree(
    file: BinaryIO, summary: Summary, keys: list[int], root: NDArray[np.float64], records: Iterator[NDArray[Any]]
) -> None:
    """Write a COPC file, given the nodes, the places of points in the first, (n, 3), and of each as stored."""
    import lazrs

    kind = las.compression_of(summary.header, summary.layout, by_nodes=True)
    info = record_of(COPC, b"copc info", bytes(INFO.itemsize))
    cube = summary.cube
    counts = {**summary.counts, "bounds": np.column_stack([cube.high, cube.low])}
    header = las.write_header(file, summary.header, summary.layout, kind, counts, [info])
    start = file.tell()
    with las.reported_compression():
        compressor = lazrs.ParLasZipCompressor(file, kind)
        while several := [each.view(np.uint8) for each in islice(records, AT_ONCE)]:
            compressor.compress_chunks(several)
        compressor.done()
        file.seek(start)
        chunks = lazrs.read_chunk_table(file, kind) if keys else []
    hierarchy = _hierarchy(keys, chunks, start + 8)  # behind the place of the table of chunks
    record = record_of(COPC_HIERARCHY, b"EPT Hierarchy", hierarchy, extended=True)
    position = file.seek(0, 2) + EXTENDED.itemsize
    las.write_extended(file, replace(header, records=(record, *header.records)))
    times = summary.gps_time if len(keys) else np.zeros(2)
    half, rounding = cube.side / 2, np.spacing(np.abs(counts["bounds"]).max())
    fields = (cube.low + half, half + rounding, _spacing(root, cube), position, len(hierarchy), times, bytes(88))
    file.seek(SIZES[4] + RECORD.itemsize)
    file.write(np.array([fields], INFO).tobytes())
    file.seek(0, 2)


def _hierarchy(keys: list[int], chunks: list[tuple[int, int]], start: int) -> bytes:
    """Return the entries of the nodes, and of those above them that have no points, in the order of the levels."""
    places = {1: (0, 0, 0)}
    for key, (count, size) in zip(keys, chunks, strict=True):
        places[key] = (start, size, count)
        start += size
        while key := key >> 3:
            places.setdefault(key, (0, 0, 0))
    return np.array([(*level_and_cell(key), *places[key]) for key in sorted(places)], ENTRY).tobytes()


def _spacing(points: NDArray[np.float64], cube: Cube) -> float:
    """Return the mean spacing of the points of the first level, (n, 3), on their surface."""
    from gppcs.spatial.kdtree import KdTree, surface_area
    from gppcs.spatial.scaling import normalised

    if not len(points):
        return cube.side
    local, _, exponent = normalised(points)  # squares of far coordinates would overflow
    return float(np.ldexp(np.sqrt(surface_area(KdTree.build(local)) / len(points)), exponent)) or cube.side


def _stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud as `write_copc` writes it, without waveforms."""
    header = cloud.header if isinstance(cloud.header, LasHeader) else las.new_header(cloud, _VERSIONS)
    attributes: dict[str, Column] = dict(cloud.attributes)
    ranks = attributes.get("scan_angle_rank")
    if ranks is not None and ranks.dtype == np.int8 and "scan_angle" not in attributes:  # of an older point format
        attributes["scan_angle"] = np.rint(attributes.pop("scan_angle_rank") / _DEGREES).astype(np.int16)
    attributes, header = _one_number_each(attributes, _raised(header))
    without = replace(header, records=tuple(each for each in header.records if each.kind != WAVEFORMS))
    return las.stored(replace(cloud, header=without, attributes=attributes))


def _raised(header: LasHeader) -> LasHeader:
    """Return a header of LAS 1.4 with a point format that COPC has."""
    number, fields = header.point_format, header.fields()[0]
    raised = empty_header(4, _RAISED.get(number, number))
    kept = {name: fields[name] for name in fields.dtype.names if name not in ("major", "minor", "size", "point_format")}
    uses_wkt = int(raised.fields()["global_encoding"][0])
    kept["global_encoding"] = int(fields["global_encoding"]) & ~_OF_WAVEFORMS | uses_wkt
    return replace(raised.with_fields(**kept), records=header.records)


def _one_number_each(attributes: dict[str, Column], header: LasHeader) -> tuple[dict[str, Column], LasHeader]:
    """Return attributes, and a header that describes them, with a name for each number of those with several."""
    found, known = dict[str, Column](), header.extra_bytes
    several = _several(attributes, header)
    for name, values in attributes.items():
        if name not in several:
            found[name] = values
            continue
        for i, column in enumerate(values.reshape(len(values), -1).T):
            part = f"{name}_{i}"
            if part in attributes:
                raise OutputError(
                    f"expected attributes with different names, found {part} and {name}, whose numbers COPC files hold "
                    f"as {name}_0, {name}_1 and so on; rename one of them"
                )
            found[part] = column
            if name in known and len(part.encode()) <= las.LONGEST_NAME:  # otherwise an error tells it
                known[part] = _description_of_one(known[name], part, i)
    return found, header.with_extra_bytes(known.values())


def _several(attributes: Mapping[str, Column], header: LasHeader | None) -> list[str]:
    """Return the attributes that extra bytes would hold as two or three numbers, a type that many readers refuse."""
    known = header.extra_bytes if header else {}
    bytes_alone = {las.UNDESCRIBED, *(name for name, each in known.items() if not each["type"])}
    return [
        name for name, values in attributes.items() if math.prod(values.shape[1:]) in (2, 3) and name not in bytes_alone
    ]


def _description_of_one(description: NDArray[Any], name: str, index: int) -> NDArray[Any]:
    """Return what describes one of several numbers."""
    one, place = description.copy(), slice(8 * index, 8 * index + 8)
    one["name"], one["type"] = name.encode(), (description["type"] - 1) % len(TYPES) + 1
    for field in ("no_data", "scale", "offset"):
        one[field] = np.void(bytes(description[field])[place].ljust(24, b"\0"))
    return one


def _is_copc(head: bytes, size: int) -> bool:
    user = SIZES[4] + RECORD.fields["user"][1]  # type: ignore[index]
    return las.FORMATS[1].recognises(head, size) and head[user : user + 5] == b"copc\0"


FORMAT = replace(
    las.FORMATS[1], name="COPC", suffixes=(".copc.laz",), write=write_copc, recognises=_is_copc, stored=_stored,
    options=frozenset({"query", "levels_by"}), renames={"scan_angle_rank": "scan_angle"},
)  # fmt: skip
