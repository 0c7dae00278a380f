"""The two readings of the files of a cloud that does not fit into memory.

The first stores its points, the last takes the kept ones with all their attributes. Several files, and several parts of
a file where its format allows, are read at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.guide import ChunkGuide, WeightRange
from gppcs.amounts.request import Request
from gppcs.clouds.cloud import PointCloud
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.joining import JointColumns
from gppcs.spatial.boxes import Boxes, Each
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.row_sample import place_hashes
from gppcs.spatial.scaling import Frame, bounds
from gppcs.spatial.stored import Run, StoredPoints, boxes_for, write_run
from gppcs.streaming.records import Columns, raw_field, raw_kind

SAMPLED = 1 << 18  # Points of the sample by which space is divided.
SPARE = 1.1  # Sampled points for each one wanted, so that there are hardly ever too few.
MOST_SAMPLED = 4 * SAMPLED  # In memory, where there are more points than were expected.
HASHES = float(2**64)
RUN = 1 << 19  # Points of a run at most, unless a chunk has more: with too few, too many files are read.
NO_ROWS = np.empty(0, dtype=np.int64)


class Chunk(NamedTuple):
    """A chunk of points on disk: the file, the row of its first point, and how many of its points are stored."""

    name: str
    first: int
    stored: int


@dataclass
class Overview:
    """What the first reading finds out about a cloud, or about a part of it."""

    count: int = 0  # points
    bad: int = 0  # points that are not finite
    first_bad: int = 0  # the row of the first of these
    # Corners (3,) of the bounding box of the stored points.
    low: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.inf))
    high: NDArray[np.float64] = field(default_factory=lambda: np.full(3, -np.inf))
    columns: JointColumns = field(default_factory=JointColumns)
    # Rows (k,) and places (k, 3) of the points to keep.
    keep: NDArray[np.int64] = field(default_factory=lambda: NO_ROWS)
    places: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    weights: WeightRange = WeightRange()  # noqa: RUF009  # a tuple
    chunks: list[Chunk] = field(default_factory=list)
    # A random sample (m, 3) of the stored points, and the random numbers (m,) by which it was drawn.
    hashes: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, dtype=np.uint64))
    sample: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    values: dict[str, NDArray[Any]] = field(default_factory=dict)  # attributes of the sample
    labels: list[NDArray[np.uint8]] = field(default_factory=list)  # quotas of each chunk
    groups: list[Sequence[NDArray[Any]]] = field(default_factory=list)  # what makes groups in each chunk
    counts: list[int] = field(default_factory=list)  # points of each source

    @property
    def stored(self) -> int:
        """Number of points that are stored."""
        return sum(chunk.stored for chunk in self.chunks)

    def add(self, other: Overview) -> None:
        """Take note of the next points."""
        if other.bad and not self.bad:
            self.first_bad = self.count + other.first_bad
        self.columns.merge(other.columns)
        self.low, self.high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        self.keep = np.concatenate([self.keep, self.count + other.keep])
        self.places = np.concatenate([self.places, other.places])
        self.weights = self.weights.followed_by(other.weights)
        self.chunks += [chunk._replace(first=self.count + chunk.first) for chunk in other.chunks]
        self.hashes = np.concatenate([self.hashes, other.hashes])
        self.sample = np.concatenate([self.sample, other.sample])
        for name, values in other.values.items():
            self.values[name] = np.concatenate([self.values[name], values]) if name in self.values else values
        if len(self.hashes) > MOST_SAMPLED:
            some = np.argpartition(self.hashes, MOST_SAMPLED // 2)[: MOST_SAMPLED // 2]
            self.hashes, self.sample = self.hashes[some], self.sample[some]
            self.values = {name: values[some] for name, values in self.values.items()}
        self.labels += other.labels
        self.groups += other.groups
        self.counts.append(other.count)
        self.count, self.bad = self.count + other.count, self.bad + other.bad


def read_all(
    sources: Sequence[CloudFiles], folder: Path, rows: int, about: int, guide: ChunkGuide, each: Each, timer: Timer
) -> Overview:
    """Read all points of files, or of parts of files, once in chunks, and store the usable ones in a folder."""
    seen, share = Overview(), min(1.0, SPARE * SAMPLED / max(1, about))
    with timer("reading", about) as advanced:
        for found in each(partial(_read, folder, rows, share, guide), list(enumerate(sources))):
            seen.add(found)
            advanced(found.count)
    return seen


def _read(folder: Path, rows: int, share: float, guide: ChunkGuide, source: tuple[int, CloudFiles]) -> Overview:
    """Read a source, and store its usable points."""
    place, seen = source[0], Overview()
    with source[1] as files:
        for number, cloud in enumerate(files.chunks(True, rows)):
            seen.add(_look(cloud, folder / f"{place}-{number}.raw", share, guide))
    return replace(seen, counts=[])


def _look(cloud: PointCloud, path: Path, share: float, guide: ChunkGuide) -> Overview:
    """Look at a chunk, and store its usable points in a file."""
    seen = Overview(count=len(cloud))
    seen.columns.add(cloud)
    usable = guide.of_chunk(cloud)
    places = cloud.points[usable.rows]
    if not np.isfinite(bounds(cloud.points)).all():
        bad = cloud.non_finite()
        seen.bad, seen.first_bad = len(bad), int(bad[0])
    seen.weights = usable.known
    seen.labels = [] if usable.labels is None else [usable.labels]
    seen.groups = [usable.groups] if usable.groups else []
    if len(places):
        records = np.empty(len(places), dtype=raw_kind(usable.weights is not None, usable.columns))
        records["row"], records["place"] = usable.rows, places
        if usable.weights is not None:
            records["weight"] = usable.weights
        for name, values in usable.columns.items():
            records[raw_field(name)] = values
        records.tofile(path)
        seen.chunks = [Chunk(path.name, 0, len(places))]
        seen.low, seen.high = bounds(places)
        seen.keep, seen.places = usable.rows[usable.keep], places[usable.keep]
        hashes = place_hashes(places)
        some = np.flatnonzero(hashes < share * HASHES) if share < 1.0 else np.arange(len(hashes))
        seen.hashes, seen.sample = hashes[some], places[some]
        seen.values = {name: values[some] for name, values in usable.columns.items()}
    return seen


def sorted_by_boxes(
    seen: Overview, folder: Path, frame: Frame, request: Request, each: Each, timer: Timer
) -> StoredPoints:
    """Sort the stored points by boxes, in the coordinates of a frame."""
    order = np.argsort(seen.hashes, kind="stable")
    sample = frame.local(seen.sample[order][: round(SPARE * SAMPLED)])
    sample = sample[first_occurrences(sample)][:SAMPLED]
    boxes = boxes_for(sample, seen.stored)
    columns = Columns.of(PointCloud(seen.sample, seen.values), seen.weights, request)
    counts = np.zeros(len(boxes), dtype=np.int64)
    groups, runs = _grouped(seen.chunks), []
    with timer("boxes", seen.stored) as advanced:
        sort = partial(_sort, folder, boxes, frame, columns)
        for group, (run, of_group) in zip(groups, each(sort, groups), strict=True):
            runs.append(run)
            counts += of_group
            for chunk in group:
                (folder / chunk.name).unlink()
                advanced(chunk.stored)
    return StoredPoints(folder, boxes, counts, tuple(runs), columns.kind, sample, seen.weights.mean_share)


def _grouped(chunks: Sequence[Chunk]) -> list[list[Chunk]]:
    """Return the chunks in groups of about as many points as a run should have."""
    groups: list[list[Chunk]] = []
    for chunk in chunks:
        if groups and sum(each.stored for each in groups[-1]) + chunk.stored <= RUN:
            groups[-1].append(chunk)
        else:
            groups.append([chunk])
    return groups


def _sort(
    folder: Path, boxes: Boxes, frame: Frame, columns: Columns, group: Sequence[Chunk]
) -> tuple[Run, NDArray[np.int64]]:
    """Sort some chunks into a run, and return it with the number of its points in each box."""
    records, begin = np.empty(sum(chunk.stored for chunk in group), columns.kind), 0
    for chunk in group:
        some = records[begin : begin + chunk.stored]
        columns.fill(some, np.fromfile(folder / chunk.name, dtype=columns.raw))
        some["row"] += chunk.first
        begin += chunk.stored
    records["place"] = frame.local(np.ascontiguousarray(records["place"]))
    return write_run(folder, group[0].name.replace(".raw", ".run"), boxes, records)


def take(
    sources: Sequence[CloudFiles], seen: Overview, rows: NDArray[np.int64], chunk: int, each: Each, timer: Timer
) -> PointCloud:
    """Read some points, (n,), with all their attributes, in the order of their rows given."""
    order = np.argsort(rows)
    asked, first = [], 0
    for files, count in zip(sources, seen.counts, strict=True):
        some = slice(*np.searchsorted(rows[order], [first, first + count]))
        asked.append(_Taken(files, count, rows[order][some] - first, chunk))
        first += count
    with timer("kept points", seen.count) as advanced:
        clouds = []
        for part, cloud in zip(asked, each(_take, asked), strict=True):
            clouds += [cloud] if cloud is not None else []
            advanced(part.points)
    return seen.columns.joined(clouds).take(np.argsort(order))


class _Taken(NamedTuple):
    """Which rows, (n,), ascending, to take of a source of so many points that is read in chunks."""

    files: CloudFiles
    points: int
    rows: NDArray[np.int64]
    chunk: int


def _take(asked: _Taken) -> PointCloud | None:
    """Read some points of a source; None if it has none of them and need not be read."""
    if not len(asked.rows):
        return None
    first, clouds, columns = 0, [], JointColumns()
    with asked.files as files:
        for cloud in files.chunks(True, asked.chunk):
            begin, end = np.searchsorted(asked.rows, [first, first + len(cloud)])
            columns.add(cloud)
            clouds.append(cloud.take(asked.rows[begin:end] - first))
            first += len(cloud)
    if first != asked.points:
        raise InputError(
            f"expected {asked.points:,} points again, found {first:,}: the files have changed meanwhile; start anew"
        )
    return columns.joined(clouds)
