"""Writes COPC files: LAZ files whose chunks are the nodes of an octree, from coarse to fine.

The place of a point in a ranking gives its level, and where it lies gives its node there. So the points of the first
levels, together, are the first of the ranking, whatever their number.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds import above
from gppcs.clouds.cloud import PointCloud
from gppcs.io import las
from gppcs.io.copc import ENTRY, INFO
from gppcs.io.las_header import (
    COPC,
    COPC_HIERARCHY,
    EXTENDED,
    RECORD,
    SIZES,
    WAVEFORMS,
    WITH_WKT,
    WKT,
    LasHeader,
    empty_header,
    record_of,
)

ORDERS = ("gp", "fps", "random", "order")
MOST = 100_000  # Points of a node. Viewers load whole nodes.
ROOT = (
    1 << 16
)  # Points of the first level: below, the nodes of terrain and of objects have some 10,000 points and more.
GROWTH = 2  # Binary digits of the number of points from level to level: on a surface, the spacing halves.
DEEPEST = 20  # Level whose cells three numbers of 21 bits can name.
DENSE = 7  # Level down to which the points of each of its cells are counted, also of empty ones.
RANKED, RANKED_SHARE = 1 << 20, 4  # Points that a method ranks, at most: so many, or this part of the cloud.
PER_ROOT = 128  # Spacings along the cube, where the points tell none.
AT_ONCE = 16  # Nodes that are compressed at once.
_SPREAD = (  # Shifts and masks that put two zeros between the bits of a number.
    (32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F), (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)  # fmt: skip
# Point formats of older versions, and of waveforms, and those that hold their dimensions.
_RAISED = {0: 6, 1: 6, 2: 7, 3: 7, 4: 6, 5: 7, 9: 6, 10: 8}
_VERSIONS = dict.fromkeys((6, 7, 8), 4)
_DEGREES = 0.006  # of which scan angles are multiples from point format 6 on


class Cube(NamedTuple):
    """The cell of the first level: the corner (3,) and the length of its edges."""

    low: NDArray[np.float64]
    side: float

    @classmethod
    def around(cls, low: NDArray[np.float64], high: NDArray[np.float64], scales: NDArray[np.float64]) -> Cube:
        """Return a cube with all points inside, also those that other programs round.

        It begins at the lowest point: in its middle, terrain would lie on both sides of a border of its cells.
        """
        spare = float(scales.max()) or 1.0
        return cls(low - spare, float((high - low).max()) + 2 * spare)

    def codes(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the cell of each point on the deepest level; three bits less name that on the level above."""
        codes = np.zeros(len(points), np.int64)
        for axis in range(3):
            cells = (points[:, axis] - self.low[axis]) * (2**DEEPEST / self.side)
            cells = np.clip(cells, 0, 2**DEEPEST - 1).astype(np.int64)
            for shift, mask in _SPREAD:
                cells = (cells | cells << shift) & mask
            codes |= cells << axis
        return codes


class Node(NamedTuple):
    """A node of the octree: its level and the code of its cell there."""

    level: int
    code: int

    @property
    def cell(self) -> tuple[int, ...]:
        """The place of the cell along each axis."""
        return tuple(sum((self.code >> (3 * bit + axis) & 1) << bit for bit in range(self.level)) for axis in range(3))

    def path(self) -> Iterator[Node]:
        """Yield the nodes above it, which readers have to find on their way."""
        for up in range(1, self.level + 1):
            yield Node(self.level - up, self.code >> 3 * up)


class Octree(NamedTuple):
    """What a file says of its levels: the cube, the spacing of the first level, and the range of GPS times (2,)."""

    cube: Cube
    spacing: float
    gps_time: NDArray[np.float64]


def write_copc(file: BinaryIO, cloud: PointCloud, levels_by: str = ORDERS[0]) -> None:
    """Write a COPC file of a cloud in memory."""
    if las.header_of(cloud).crs is None and len(cloud) > 1:  # one point is written to try it
        logging.getLogger("gppcs").info("note: the cloud names no coordinate system, so no map can show the COPC file")
    counts, layout = las.counts_of(cloud), las.layout_to_write(cloud)
    high, low = counts["bounds"].T
    cube = Cube.around(low, high, las.header_of(cloud).fields()["scales"][0])
    (order, ranked), codes = _order(cloud, levels_by), cube.codes(cloud.points)
    nodes: list[Node] = []
    rows: list[NDArray[np.int64]] = []
    for level, chosen in enumerate(levels_of(codes[order], ranked)):
        here = np.sort(order[chosen])  # neighbours in the cloud, so that they take less space
        cells, parts = by_cell(codes[here], level)
        nodes += [Node(level, cell) for cell in cells]
        rows += [here[part] for part in parts]
    times = cloud.attributes.get("gps_time", np.zeros(1))
    octree = Octree(
        cube,
        spacing_of(cloud.points[rows[0]], cube) if rows else cube.side,
        np.array([times.min(), times.max()]) if len(times) else np.zeros(2),
    )
    records = (las.records_of(cloud.take(part), layout) for part in rows)
    write_octree(file, las.header_of(cloud), layout, counts, octree, nodes, records)


def _order(cloud: PointCloud, levels_by: str) -> tuple[NDArray[np.int64], int]:
    """Return all rows of a cloud, first those that a method ranks, then the others at random; and how many it ranks."""
    n = len(cloud)
    if levels_by == "order" or n <= MOST:
        return np.arange(n), n
    first = above.rank(cloud, levels_by, ranked_of(n))
    others = np.ones(n, np.bool_)
    others[first] = False
    return np.concatenate([first, np.random.default_rng(0).permutation(np.flatnonzero(others))]), len(first)


def ranked_of(n: int) -> int:
    """Return how many of so many points are ranked."""
    return max(1, min(n // RANKED_SHARE, RANKED))


def levels_of(codes: NDArray[np.int64], ranked: int) -> Iterator[NDArray[np.int64]]:
    """Yield which points are on each level, given in the order of their ranking, which holds for so many of them.

    A level takes the next points, as many as wanted or as its nodes hold. Behind the ranking, a cell in which no more
    points are left than a node holds takes them all.
    """
    left, level = np.arange(len(codes)), 0
    while len(left):
        cells, counts = _counted(codes[left] >> 3 * (DEEPEST - level), level)
        done = len(codes) - len(left)
        wanted = (ROOT << GROWTH * level) - done
        if counts.max() <= MOST or level == DEEPEST:
            taken = np.ones(len(left), np.bool_)
        else:
            first = cells[:wanted]
            full = np.flatnonzero(np.bincount(first) > MOST)
            wanted = min((int(np.flatnonzero(first == cell)[MOST]) for cell in full), default=wanted)
            taken = np.arange(len(left)) < wanted
            if done + wanted > ranked:
                taken |= (counts <= MOST)[cells]
        yield left[taken]
        left, level = left[~taken], level + 1


def _counted(cells: NDArray[np.int64], level: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the number of the cell of each point, and how many points lie in each."""
    if level > DENSE:
        _, cells = np.unique(cells, return_inverse=True)
    return cells, np.bincount(cells)


def by_cell(codes: NDArray[np.int64], level: int) -> tuple[list[int], list[NDArray[np.int64]]]:
    """Return the occupied cells of a level, and which of the points lie in each, ascending."""
    cells = codes >> 3 * (DEEPEST - level)
    order = np.argsort(cells, kind="stable")
    found, starts = np.unique(cells[order], return_index=True)
    return found.tolist(), np.split(order, starts[1:])


def spacing_of(points: NDArray[np.float64], cube: Cube) -> float:
    """Return the mean spacing of the points of the first level, on their surface."""
    from gppcs.spatial.kdtree import KdTree
    from gppcs.spatial.spacing import surface_area

    return float(np.sqrt(surface_area(KdTree.build(points)) / len(points))) or cube.side / PER_ROOT


def write_octree(
    file: BinaryIO, header: LasHeader, layout: las.Layout, counts: dict[str, Any], octree: Octree,
    nodes: list[Node], records: Iterator[NDArray[Any]],
) -> None:  # fmt: skip
    """Write a COPC file, given the points of each node as they are stored."""
    import lazrs

    kind = las.compression_of(header, layout, by_nodes=True)
    info = record_of(COPC, b"copc info", bytes(INFO.itemsize))
    header = las.write_header(file, header, layout, kind, counts, [info])
    start = file.tell()
    with las.reported_compression():
        compressor = lazrs.ParLasZipCompressor(file, kind)
        while several := [each.view(np.uint8) for each in islice(records, AT_ONCE)]:
            compressor.compress_chunks(several)
        compressor.done()
        file.seek(start)
        chunks = lazrs.read_chunk_table(file, kind) if nodes else []
    hierarchy = _hierarchy(nodes, chunks, start + 8)  # behind the place of the table of chunks
    record = record_of(COPC_HIERARCHY, b"EPT Hierarchy", hierarchy, extended=True)
    position = file.seek(0, 2) + EXTENDED.itemsize
    las.write_extended(file, replace(header, records=(record, *header.records)))
    (low, side), half = octree.cube, octree.cube.side / 2
    fields = (low + half, side / 2, octree.spacing, position, len(hierarchy), octree.gps_time, bytes(88))
    file.seek(SIZES[4] + RECORD.itemsize)
    file.write(np.array([fields], INFO).tobytes())
    file.seek(0, 2)


def _hierarchy(nodes: list[Node], chunks: list[tuple[int, int]], start: int) -> bytes:
    """Return the entries of the nodes, and of those above them that have no points, in the order of the levels."""
    places = dict.fromkeys([Node(0, 0), *(above for node in nodes for above in node.path())], (0, 0, 0))
    for node, (count, size) in zip(nodes, chunks, strict=True):
        places[node] = (start, size, count)
        start += size
    entries = [(node.level, node.cell, *place) for node, place in sorted(places.items())]
    return np.array(entries, ENTRY).tobytes()


def _fitted(cloud: PointCloud) -> tuple[PointCloud, list[str]]:
    """Return a cloud as `write_copc` writes it, and in words what it leaves out."""
    header = cloud.header if isinstance(cloud.header, LasHeader) else las.new_header(cloud, _VERSIONS)
    waveforms = [each for each in header.records if each.kind == WAVEFORMS]
    fields, number = header.fields()[0], header.point_format
    kept = {name: fields[name] for name in fields.dtype.names if name not in ("major", "minor", "size", "point_format")}
    encoding = empty_header(4, WITH_WKT).fields()["global_encoding"][0] | fields["global_encoding"]
    raised = empty_header(4, _RAISED.get(number, number)).with_fields(**kept | {"global_encoding": encoding})
    records = tuple(each for each in header.records if each not in waveforms)
    attributes = dict(cloud.attributes)
    if "scan_angle_rank" in attributes and "scan_angle" not in attributes:
        attributes = {
            **{name: values for name, values in attributes.items() if name != "scan_angle_rank"},
            "scan_angle": np.rint(np.asarray(attributes["scan_angle_rank"], np.float64) / _DEGREES).astype(np.int16),
        }
    cloud = replace(cloud, header=replace(raised, records=records), attributes=attributes)
    fitted, lost = las.fitted(cloud)
    return fitted, [*lost, *(["waveforms"] if waveforms else [])]


def _remarks(cloud: PointCloud) -> list[str]:
    """Return in words what the file says otherwise than the header of a cloud."""
    header, found = cloud.header, list[str]()
    if isinstance(header, LasHeader):
        if header.point_format in _RAISED:
            found.append(f"point format {header.point_format} (it becomes {_RAISED[header.point_format]})")
        if header.crs and all(each.kind != WKT for each in header.records):
            found.append("the coordinate system as WKT (it stays as keys of GeoTIFF, which not all readers know)")
    return found


def _is_copc(head: bytes, size: int) -> bool:
    user = SIZES[4] + RECORD.fields["user"][1]  # type: ignore[index]
    return las.FORMATS[1].recognises(head, size) and head[user : user + 5] == b"copc\0"


FORMAT = replace(
    las.FORMATS[1], name="COPC", suffixes=(".copc.laz",), write=write_copc, recognises=_is_copc, fitted=_fitted,
    remarks=_remarks, has_levels=True,
)  # fmt: skip
