"""Write the points of files that do not fit into memory to one COPC file.

They are stored once, as they are going to stand in the file. How many lie in each of some cells tells the levels. Then
blocks of points are sorted by nodes, and each node is put together from its pieces in the blocks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.options import Options
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.io import copc_writing as copc
from gppcs.io import las
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.copc_levels import ROOT, Cells, Levels, by_node, divided
from gppcs.io.copc_writing import Summary
from gppcs.io.files import refuse_losses
from gppcs.io.format import shift_in_words
from gppcs.io.las_header import LasHeader
from gppcs.io.streams import whole_output
from gppcs.simplification import simplify_files
from gppcs.streaming.plan import Plan, make_plan
from gppcs.streaming.scratch import scratch_folder

BLOCK = 1 << 20  # Points that are sorted at once.
RANK, POINT = "rank", "point"
RECORDS, COORDINATES = "points.raw", "coordinates.raw"


@dataclass
class _Stored:
    """All points on disk as they are written but for their coordinates, with their places in the ranking."""

    folder: Path
    summary: Summary
    lost: list[str]  # What the file does not hold, in words
    dropped: int = 0  # Number of points that are not finite, and so are left out

    @property
    def path(self) -> Path:
        """The file of the points; their coordinates are in another."""
        return self.folder / RECORDS

    def coordinates(self) -> Iterator[NDArray[np.float64]]:
        """Yield the coordinates as they were read, (n, 3)."""
        with open(self.folder / COORDINATES, "rb") as file:
            while len(block := np.fromfile(file, count=3 * BLOCK)):
                yield block.reshape(-1, 3)

    def blocks(self) -> Iterator[tuple[NDArray[np.int32], NDArray[Any], NDArray[np.int64]]]:
        """Yield the places in the ranking, -1 for others, the points as they are stored, and their codes (n,)."""
        header, kind = self.summary.header, _record_type(self.summary.layout)
        with open(self.path, "rb") as file:
            for points in self.coordinates():
                block = np.fromfile(file, kind, len(points))
                las.store_coordinates(block[POINT], points, header)
                places = las.multiples(points, *_grid(header))
                yield block[RANK], block[POINT], self.summary.cube.codes(places)

    def on_one_grid(self) -> tuple[list[str], bool]:
        """Choose one scale and offset for all points; return as `rounding` does what that moves."""

        def of_axis(axis: int) -> Iterator[NDArray[np.float64]]:
            return (points[:, axis] for points in self.coordinates())

        header, bounds = self.summary.header, self.summary.counts["bounds"]
        found = [las.scale_and_offset(partial(of_axis, i), *each) for i, each in enumerate(np.transpose(_grid(header)))]
        grid = scales, offsets = np.transpose(found)
        counts = {**self.summary.counts, "bounds": las.multiples(bounds.T, *grid).T}
        header = header.with_fields(scales=scales, offsets=offsets)
        self.summary = replace(self.summary, header=header, counts=counts)
        shift = max((np.abs(las.multiples(each, *grid) - each).max() for each in self.coordinates()), default=0.0)
        return shift_in_words(float(shift), float(np.abs(bounds).max()), float(np.linalg.norm(np.ptp(bounds, axis=1))))


def _grid(header: LasHeader) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the scales and offsets of a header. Shapes: returns (3,), (3,)."""
    fields = header.fields()
    return fields["scales"][0], fields["offsets"][0]


def _record_type(layout: las.Layout) -> np.dtype[Any]:
    """Return the type of a record on disk."""
    return np.dtype([(RANK, "<i4"), (POINT, layout.record)])


def write_beyond_memory(
    target: Path, files: CloudFiles, options: Options, timer: Timer, force: bool, lossy: bool
) -> list[str] | None:
    """Write a COPC file of files, and return in words what it does not hold; None if they fit into memory."""
    options = replace(options, n_points=copc.ranked_of(files.n_points))
    planned = make_plan(files, options)
    if planned.in_memory:
        return None
    unread = files.skipped()
    dropped, lost = _write(target, files, planned, options, timer, force, lossy)
    invalid = [f"points with NaN or infinite coordinates ({dropped:,})"] if dropped else []
    return [*unread, *invalid, *lost]


def _write(
    target: Path, files: CloudFiles, planned: Plan, options: Options, timer: Timer, force: bool, lossy: bool
) -> tuple[int, list[str]]:
    """Write a COPC file, and return how many points were not finite, and in words what the file does not hold."""
    head = files.preview
    layout = las.layout_to_write(copc.FORMAT.fit(head.take(head.finite_rows())).cloud)
    row = _record_type(layout).itemsize + head.points.itemsize * head.points.shape[1]
    ranked = simplify_files(files, options, planned, timer)
    with scratch_folder(None, planned.points_in * row) as folder, whole_output(target, force) as file:
        with timer("points to disk", planned.points_in) as advanced:
            drop = options.invalid == "drop"
            stored = _stored(target, files, folder, ranked.indices, drop, lossy, advanced)
        with timer("levels"):
            codes = stored.summary.cube.codes(las.multiples(ranked.cloud.points, *_grid(stored.summary.header)))
            cells = Cells.around(codes, stored.summary.counts["count"])
            pieces = _sorted_by_nodes(stored, divided(cells, cells.places(codes), _others(stored, cells)))
        with timer("writing", planned.points_in) as advanced, open(stored.path, "rb") as scratch:
            records = _nodes(scratch, stored.summary.layout.record, pieces, advanced)
            keys = np.unique(pieces[:, 0]).tolist()
            copc.write_octree(file, stored.summary, keys, ranked.cloud.points[:ROOT], records)
    return stored.dropped, stored.lost


def _stored(
    target: Path, files: CloudFiles, folder: Path, ranking: NDArray[np.int64], drop: bool, lossy: bool, advanced: Any
) -> _Stored:
    """Store all points in a folder, with one scale and offset for their coordinates."""
    order = np.argsort(ranking)
    rows, begin, dropped = ranking[order], 0, 0
    own = _grid(las.header_of(copc.FORMAT.fit(files.preview[:0]).cloud))
    lost, summary = list[str](), None
    with open(folder / RECORDS, "wb") as file, open(folder / COORDINATES, "wb") as coordinates:
        for cloud in files.chunks(True):
            some = slice(*np.searchsorted(rows, [begin, begin + len(cloud)]))
            ranks = np.full(len(cloud), -1, np.int32)
            ranks[rows[some] - begin] = order[some]
            begin += len(cloud)
            usable = cloud.finite_rows() if drop else np.arange(len(cloud))
            dropped += len(cloud) - len(usable)
            points = cloud.points[usable]
            given = cloud.take(usable).moved(np.zeros(points.shape))  # all coordinates are fitted together, later
            fit = copc.FORMAT.fit(replace(given, header=summary.header) if summary else given)
            if not lossy:
                refuse_losses(target, copc.FORMAT.name, fit.values)
            header = las.header_of(fit.cloud).with_fields(scales=own[0], offsets=own[1])
            chunk = Summary.of(replace(fit.cloud, points=points, header=header))
            lost, summary = (lost, _joined(summary, chunk)) if summary else ([*fit.values, *fit.remarks], chunk)
            records = np.empty(len(usable), _record_type(chunk.layout))
            records[RANK], records[POINT] = ranks[usable], las.records_of(fit.cloud, chunk.layout)
            records.tofile(file)
            points.tofile(coordinates)
            advanced(len(cloud))
    assert summary is not None
    stored = _Stored(folder, summary, lost, dropped)
    digits, tolerated = stored.on_one_grid()
    if not (tolerated or lossy):
        refuse_losses(target, copc.FORMAT.name, digits)
    lost += digits
    return stored


def _joined(known: Summary, new: Summary) -> Summary:
    """Return what is said of points and of others that follow them, which have to be stored in the same way."""
    if new.layout.record != known.layout.record or new.header.block != known.header.block:
        raise InputError(
            "expected the same attributes in all files, of types that hold all their values, found others; raise "
            "memory, or convert the files to LAZ of one point format first"
        )
    if not (known.counts["count"] and new.counts["count"]):
        return new if new.counts["count"] else known
    counts = {name: known.counts[name] + new.counts[name] for name in ("count", "returns")}
    highs, lows = np.dstack([known.counts["bounds"], new.counts["bounds"]]).transpose(1, 0, 2)
    counts["bounds"] = np.column_stack([highs.max(axis=1), lows.min(axis=1)])
    times = np.array([known.gps_time, new.gps_time])
    return replace(known, counts=counts, gps_time=np.array([times[:, 0].min(), times[:, 1].max()]))


def _others(stored: _Stored, cells: Cells) -> NDArray[np.int64]:
    """Return how many points that are not ranked each cell holds, (c,)."""
    others = np.zeros(len(cells.codes), np.int64)
    for rank, _, codes in stored.blocks():
        others += np.bincount(cells.places(codes[rank < 0]), minlength=len(others))
    return others


def _sorted_by_nodes(stored: _Stored, levels: Levels) -> NDArray[np.int64]:
    """Sort each block by nodes, in place, without ranks; return the pieces, (k, 3): node, first point, number."""
    pieces, position = [], 0
    with open(stored.path, "r+b") as file:
        for number, (rank, points, codes) in enumerate(stored.blocks()):
            level = levels.of_others(levels.cells.places(codes), number)
            level[rank >= 0] = levels.of_ranked[rank[rank >= 0]]
            keys, order, starts = by_node(codes, level)
            pieces.append(np.column_stack([keys, position + starts, np.diff(starts, append=len(order))]))
            file.seek(position * points.itemsize)  # before what is still to be read, whose records are longer
            file.write(np.ascontiguousarray(points[order]).tobytes())
            position += len(points)
    return np.concatenate(pieces)


def _nodes(file: BinaryIO, record: np.dtype[Any], pieces: NDArray[np.int64], advanced: Any) -> Iterator[NDArray[Any]]:
    """Yield the points of each node, in the order of the nodes."""
    pieces = pieces[np.argsort(pieces[:, 0], kind="stable")]
    for node in np.split(pieces, np.flatnonzero(np.diff(pieces[:, 0])) + 1):
        found = np.empty(node[:, 2].sum(), record)
        begin = 0
        for _, start, count in node.tolist():
            file.seek(start * record.itemsize)
            found[begin : begin + count] = np.frombuffer(file.read(count * record.itemsize), record)
            begin += count
        advanced(len(found))
        yield found
