"""Writes COPC files: LAZ files whose chunks are the nodes of an octree, from coarse to fine.

The order of the points decides: each lies in the coarsest node around it that is not full yet. So the first node holds
the first points of a ranking, and every node the first ones of those in its cell that no coarser node holds. Points
that have no ranking are taken in an order that spreads each node's over those in its cell.
"""

from __future__ import annotations

import struct
from collections import Counter, defaultdict
from copy import deepcopy
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.io import copc, las
from gppcs.io.format import Format
from gppcs.io.las_header import WAVEFORMS, LasHeader, dated, kind_of
from gppcs.io.laz import chunks_of

if TYPE_CHECKING:
    import laspy

ORDERS = ("order", "even")
BLOCK = 1 << 20  # Points that are sorted at once.
# Points of a node with others below it: a thousandth, so that few bytes hold a small part of the file, within limits.
# Viewers load complete nodes, and small ones are compressed less.
FEWEST, MOST = 1 << 12, 1 << 16
DEEPEST = 20  # Octree level whose cells three numbers of 20 bits name.
_SPREAD = np.array([sum((i >> bit & 1) << 3 * bit for bit in range(10)) for i in range(1024)])  # two zeros between bits


def write_copc(file: BinaryIO, cloud: PointCloud, levels_by: str | None = None) -> None:
    """Write a COPC file of a cloud in memory, which `stored` has returned."""
    header = las.header_of(cloud)
    records = las.records_of(cloud, header)
    rank = cloud.attributes.get("rank", np.empty(0))
    # whether it numbers the points, as that of `gppcs simplify --rank` does
    if levels_by is None and rank.dtype.kind in "iu" and rank.ndim == 1 and len(np.unique(rank)) == len(rank):
        records, levels_by = records[np.argsort(rank)], "order"
    is_even = levels_by != "order"
    if is_even and len(records) > BLOCK:
        records = records[np.random.default_rng(0).permutation(len(records))]
    write_octree(file, header, records, is_even)


def write_octree(file: BinaryIO, header: laspy.LasHeader, records: NDArray[Any], is_even: bool) -> None:
    """Write a COPC file of points as they are stored, (n,). It sorts them in place.

    The most important points come first, or if the levels are to be even, the points are in random order.
    """
    import laspy
    import lazrs

    header, info = dated(header), laspy.VLR("copc", 1, "copc info", bytes(160))
    header.vlrs.insert(0, info)
    header.are_points_compressed = True
    writer: Any = laspy.LazBackend.LazrsParallel.create_writer(file, header)
    writer.vlr = lazrs.LazVlr.new_for_compression(
        header.point_format.id, header.point_format.num_extra_bytes, use_variable_size_chunks=True
    )
    with las.reported_writing():
        writer.write_initial_header_and_vlrs(header, "surrogateescape")
        times = _count(header, records)
        octree = Octree(header, len(records))
        pieces = octree.sort(records, is_even)
        keys = sorted(pieces)
        for begin in range(0, len(keys), 16):  # nodes that are compressed at once
            nodes = (np.concatenate([records[i:j] for i, j in pieces[key]]) for key in keys[begin : begin + 16])
            writer.compressor.compress_chunks([node.view(np.uint8) for node in nodes])
        writer.done()
        hierarchy = _hierarchy(keys, chunks_of(file, header) if keys else np.zeros(1, copc.ENTRY))
        half, last_place = octree.side / 2, np.spacing(np.abs([header.mins, header.maxs]).max())
        spacing = octree.side / np.sqrt(max(1, octree.counts[1]))  # as if the first node were a square
        header.start_of_first_evlr = file.seek(0, 2)
        position = header.start_of_first_evlr + 60  # behind the head of the record
        info.record_data = struct.pack(
            "<5d2Q2d88x", *(octree.lower + half), half + last_place, spacing, position, len(hierarchy), *times
        )
        index = laspy.VLR("copc", 1000, "EPT Hierarchy", hierarchy)
        header.evlrs = laspy.vlrs.vlrlist.VLRList([index, *(header.evlrs or [])])
        header.number_of_evlrs = len(header.evlrs)
        header.evlrs.write_to(file, as_extended=True, encoding_errors="surrogateescape")
        writer.write_updated_header(header, "surrogateescape")


def _count(header: laspy.LasHeader, records: NDArray[Any]) -> tuple[float, float]:
    """Let a header count the points, and return the first and the last time of them."""
    import laspy

    header.partial_reset()
    if not len(records):
        header.update([])
        return 0.0, 0.0
    for begin in range(0, len(records), BLOCK):
        header.grow(laspy.PackedPointRecord(records[begin : begin + BLOCK], header.point_format))
    longest = int(np.argmax(header.maxs - header.mins))
    if header.maxs[longest] > header.mins[longest]:
        # copclib takes the cube from these bounds, and adds up the borders of cells, which must not fall short.
        header.maxs[longest] += 4 * np.spacing(max(abs(header.mins[longest]), abs(header.maxs[longest])))
    return header.min_gps_time, header.max_gps_time


def _hierarchy(keys: list[int], chunks: NDArray[Any]) -> bytes:
    """Return the entries of nodes, whose keys are in the order of their chunks."""
    entries = np.zeros(len(chunks), copc.ENTRY)
    for name in ("offset", "size", "count"):
        entries[name] = chunks[name]
    for i, key in enumerate(keys):
        depth = (key.bit_length() - 1) // 3
        entries["level"][i] = depth
        entries["cell"][i] = [sum((key >> 3 * bit + axis & 1) << bit for bit in range(depth)) for axis in range(3)]
    return entries.tobytes()


class Octree:
    """Sorts points into the nodes of a cube around them.

    The key of a node is a bit that tells its octree level, and behind it the code of its cell. Three bits less name the
    node above.
    """

    def __init__(self, header: laspy.LasHeader, n_points: int) -> None:
        self._header = header
        self._full = min(max(FEWEST, n_points >> 10), MOST)
        self.lower = np.array(header.mins)
        self.side = float(np.max(header.maxs - self.lower)) or 1.0
        self.counts: Counter[int] = Counter()  # points of each node

    def sort(self, records: NDArray[Any], is_even: bool) -> dict[int, list[tuple[int, int]]]:
        """Sort points block by block, and return for each node, by its key, the slices with its points."""
        pieces = defaultdict(list)
        for begin in range(0, len(records), BLOCK):
            block = records[begin : begin + BLOCK]
            codes, keys = self._codes_of(block), np.empty(len(block), np.int64)
            order = np.argsort(codes, kind="stable")[_evenly(len(block))] if is_even else np.arange(len(block))
            keys[order] = self._keys_of(codes[order])
            # Neighbours that follow each other are compressed better than points in random order.
            is_mixed = is_even and len(records) > BLOCK
            order = np.lexsort([codes, keys]) if is_mixed else np.argsort(keys, kind="stable")
            block[:] = block[order]
            nodes, starts = np.unique(keys[order], return_index=True)
            ends = [*starts[1:], len(block)]
            for node, start, end in zip(nodes.tolist(), starts.tolist(), ends, strict=True):
                pieces[node].append((begin + start, begin + int(end)))
        parents = {1}
        for key in sorted(pieces, reverse=True):  # each node behind those below it
            if key in parents or self.counts[key >> 3] + self.counts[key] > 3 * self._full // 2:
                parents.add(key >> 3)
            else:
                self.counts[key >> 3] += self.counts.pop(key)
                pieces[key >> 3] += pieces.pop(key)
        return pieces

    def _codes_of(self, records: NDArray[Any]) -> NDArray[np.int64]:
        """Return the cell of each point on the deepest level; three bits less name that on the level above."""
        codes, step = np.zeros(len(records), np.int64), self.side / 2**DEEPEST
        for axis, points in enumerate(las.coordinates_of(records, self._header).T):
            lower = self.lower[axis]
            cells = np.floor((points - lower) / step)
            cells -= points < lower + step * cells  # Readers round borders so: no point may lie beyond by its last bit.
            cells += points >= lower + step * (cells + 1)
            numbers = np.clip(cells, 0, 2**DEEPEST - 1).astype(np.int64)
            codes |= (_SPREAD[numbers >> 10] << 30 | _SPREAD[numbers & 1023]) << axis
        return codes

    def _keys_of(self, codes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the node of each point, by codes of its cell, and count it there. Shapes: (n,), (n,)."""
        keys, remaining = np.zeros(len(codes), np.int64), np.arange(len(codes))
        full = np.array([*sorted(key for key, count in self.counts.items() if count >= self._full), 2**62])
        for depth in range(DEEPEST + 1):
            nodes = 1 << 3 * depth | codes[remaining] >> 3 * (DEEPEST - depth)
            is_open = full[np.searchsorted(full, nodes)] != nodes
            nodes, candidates = nodes[is_open], remaining[is_open]
            order = np.argsort(nodes, kind="stable")
            nodes, candidates = nodes[order], candidates[order]
            unique, starts, counts = np.unique(nodes, return_index=True, return_counts=True)
            rooms = counts
            if depth < DEEPEST:
                rooms = np.minimum(counts, [self._full - self.counts[key] for key in unique.tolist()])
            fits = np.arange(len(nodes)) - np.repeat(starts, counts) < np.repeat(rooms, counts)
            keys[candidates[fits]] = nodes[fits]
            self.counts.update(dict(zip(unique.tolist(), rooms.tolist(), strict=True)))
            remaining = remaining[keys[remaining] == 0]
            if not len(remaining):
                break
        return keys


def _evenly(n: int) -> NDArray[np.int64]:
    """Return the numbers below n in the order of their reversed bits: the first ones are spread over all."""
    order = np.zeros(1, np.int64)
    while len(order) < n:
        order = np.concatenate([2 * order, 2 * order + 1])
    return order[order < n]


def stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud as `write_copc` writes it: LAS 1.4 in a point format that COPC has, without waveforms."""
    attributes = dict(cloud.attributes)
    header = cloud.header
    if isinstance(header, LasHeader):
        header = LasHeader(_raised(header.las))
        angles = attributes.get("scan_angle_rank")
        if angles is not None and angles.dtype == np.int8 and "scan_angle" not in attributes:  # of older formats
            del attributes["scan_angle_rank"]
            multiples = np.rint(angles.astype(np.float64) / 0.006)  # degrees
            attributes["scan_angle"] = multiples.astype(np.int16)
    cloud = PointCloud(cloud.points, attributes, header=header)
    # Many readers refuse extra bytes of two or three numbers.
    return las.stored(cloud, las.POINT_FORMATS[-3:], widest=1)


def _raised(las: laspy.LasHeader) -> laspy.LasHeader:
    """Return a header of LAS 1.4 with a point format that COPC has and that holds the dimensions of the old one."""
    import laspy

    header = deepcopy(las)
    raised = {0: 6, 1: 6, 2: 7, 3: 7, 4: 6, 5: 7, 9: 6, 10: 8}.get(las.point_format.id, las.point_format.id)
    point_format = laspy.PointFormat(raised)
    point_format.dimensions += las.point_format.extra_dimensions
    if raised != las.point_format.id:
        header.set_version_and_point_format(laspy.header.Version(1, 4), point_format)
    encoding = header.global_encoding
    encoding.wkt = True
    encoding.waveform_data_packets_internal = encoding.waveform_data_packets_external = False
    header.evlrs = [record for record in header.evlrs or [] if kind_of(record) != WAVEFORMS]
    return header


FORMAT = Format(
    "COPC",
    (".copc.laz",),
    copc.open_copc,
    write_copc,
    copc.is_copc,
    stored,
    frozenset({"query", "levels_by"}),
    lambda name: "scan_angle" if name == "scan_angle_rank" else las.las_name(name),
)
