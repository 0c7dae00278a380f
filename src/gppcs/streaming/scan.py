"""The two readings of a cloud that does not fit into memory: one stores its points, the last takes the kept ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.constraints import Constraints, WeightRange
from gppcs.amounts.groups import group_columns
from gppcs.amounts.options import Options
from gppcs.amounts.quotas import EXCLUDED
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.ranges import Details
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.joining import JointColumns
from gppcs.spatial.boxes import Boxes, MapParts
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.samples import HASHES, point_hashes
from gppcs.spatial.scaling import Frame, bounds
from gppcs.spatial.stored import RECORD, Run, StoredPoints, boxes_for, write_run
from gppcs.streaming import plan

SAMPLED = 1 << 18  # Points of the sample by which space is divided.
SPARE = 1.1  # Sampled points for each one needed, so that there are hardly ever too few.
FEWEST = 256  # Sampled points, if there are so many different ones.
RUN = 1 << 20  # Points of a run at most, unless a chunk has more: with too few, too many files are read.


@dataclass
class Overview:
    """What the first reading finds out about a cloud, or about a part of it. Overviews of parts are merged."""

    count: int = 0  # points
    n_bad: int = 0  # points that are not finite
    first_bad: int = 0  # the index of the first of these
    lower: Floats = field(default_factory=lambda: np.full(3, np.inf))  # (3,): of the box around the stored points
    upper: Floats = field(default_factory=lambda: np.full(3, -np.inf))
    columns: JointColumns = field(default_factory=JointColumns)
    keep: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))  # (k,): indices of the points to keep
    keep_points: Floats = field(default_factory=lambda: np.empty((0, 3)))  # (k, 3)
    weights: WeightRange = WeightRange()  # noqa: RUF009  # a tuple
    # The files of the chunks on disk, each with the index of its first point and the number of its stored points.
    chunks: list[tuple[str, int, int]] = field(default_factory=list)
    # A random sample (m, 3) of the different stored points with their attributes, and the numbers (m,) by which they
    # were drawn.
    hashes: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, dtype=np.uint64))
    sample: Floats = field(default_factory=lambda: np.empty((0, 3)))
    sample_columns: dict[str, NDArray[Any]] = field(default_factory=dict)
    # Of each chunk: the quotas of its points, and what makes groups. Of each source: the number of points.
    labels: list[NDArray[np.uint8]] = field(default_factory=list)
    groups: list[Sequence[NDArray[Any]]] = field(default_factory=list)
    source_counts: list[int] = field(default_factory=list)

    @property
    def stored(self) -> int:
        """Number of points that are stored."""
        return sum(count for _, _, count in self.chunks)

    def add(self, other: Overview) -> None:
        """Add the overview of the next points."""
        if other.n_bad and not self.n_bad:
            self.first_bad = self.count + other.first_bad
        self.columns.merge(other.columns)
        self.lower, self.upper = np.minimum(self.lower, other.lower), np.maximum(self.upper, other.upper)
        self.keep = np.concatenate([self.keep, self.count + other.keep])
        self.keep_points = np.concatenate([self.keep_points, other.keep_points])
        self.weights = self.weights.merged(other.weights)
        self.chunks += [(name, self.count + first, count) for name, first, count in other.chunks]
        self.hashes = np.concatenate([self.hashes, other.hashes])
        self.sample = np.concatenate([self.sample, other.sample])
        for name, values in other.sample_columns.items():
            earlier = self.sample_columns.get(name)
            self.sample_columns[name] = values if earlier is None else np.concatenate([earlier, values])
        if len(self.hashes) > 4 * SAMPLED:  # there are repeats, or more points than were expected
            self.keep_sampled(np.unique(self.hashes, return_index=True)[1][: 2 * SAMPLED])
        self.labels += other.labels
        self.groups += other.groups
        self.source_counts.append(other.count)
        self.count, self.n_bad = self.count + other.count, self.n_bad + other.n_bad

    def keep_sampled(self, indices: Ints) -> None:
        """Keep only some points of the sample, (n,)."""
        self.hashes, self.sample = self.hashes[indices], self.sample[indices]
        self.sample_columns = {name: values[indices] for name, values in self.sample_columns.items()}


def read_all(
    sources: Sequence[CloudFiles], folder: Path, about: int, options: Options, map_parts: MapParts, timer: Timer
) -> Overview:
    """Read all points of files, or of parts of files, once in chunks, and store the usable ones in a folder."""
    overview, fraction = Overview(), min(1.0, SPARE * SAMPLED / max(1, about))
    with timer("reading", about) as on_progress:
        read = partial(_read, folder, plan.CHUNK, fraction, options)
        for part in map_parts(read, list(enumerate(sources))):
            overview.add(part)
            on_progress(part.count)
    overview.keep_sampled(_sampled(overview.hashes, fraction))
    return overview


def _read(folder: Path, n: int, fraction: float, options: Options, source: tuple[int, CloudFiles]) -> Overview:
    """Read a source, and store its usable points."""
    overview = Overview()
    with source[1] as files:
        for number, cloud in enumerate(files.chunks(n)):
            overview.add(_read_chunk(cloud, folder / f"{source[0]}-{number}.raw", fraction, options))
    return replace(overview, source_counts=[])


def _read_chunk(cloud: PointCloud, path: Path, fraction: float, options: Options) -> Overview:
    """Return the overview of a chunk, and store its usable points in a file."""
    overview, finite = Overview(count=len(cloud)), np.flatnonzero(cloud.is_finite())
    overview.columns.add(cloud)
    constraints = Constraints.from_cloud(cloud, finite, options)
    if len(finite) < len(cloud):
        overview.n_bad, overview.first_bad = len(cloud) - len(finite), int(np.argmin(cloud.is_finite()))
    overview.weights = WeightRange.from_weights(constraints.weights)
    if constraints.labels is not None:
        labels = np.full(len(cloud), EXCLUDED)
        labels[finite] = constraints.labels
        overview.labels = [labels]
    if options.group is not None:
        overview.groups = [group_columns(cloud, options.group)]
    usable = constraints.usable(len(finite))
    points = cloud.points[finite[usable]]
    if not len(points):
        return overview
    records = np.empty(len(points), dtype=_raw_type(constraints.weights is not None, len(constraints.columns)))
    records["row"], records["place"] = finite[usable], points
    if constraints.weights is not None:
        records["weight"] = constraints.weights[usable]
    for number, values in enumerate(constraints.columns.values()):
        records["columns"][:, number] = values[usable]
    records.tofile(path)
    overview.chunks = [(path.name, 0, len(points))]
    overview.lower, overview.upper = bounds(points)
    overview.keep, overview.keep_points = finite[constraints.keep], cloud.points[finite[constraints.keep]]
    hashes = point_hashes(points)
    sampled = _sampled(hashes, fraction)
    overview.hashes, overview.sample = hashes[sampled], points[sampled]
    overview.sample_columns = {name: values[usable[sampled]] for name, values in constraints.columns.items()}
    return overview


def _sampled(hashes: NDArray[np.uint64], fraction: float) -> Ints:
    """Return the indices of a sample of different points, ascending: those of the smallest hashes, and not too few."""
    drawn = fraction
    while True:
        below = np.flatnonzero(hashes < drawn * HASHES) if drawn < 1.0 else np.arange(len(hashes))
        different, first = np.unique(hashes[below], return_index=True)
        if len(different) >= FEWEST or drawn >= 1.0:
            count = max(FEWEST, np.count_nonzero(different < fraction * HASHES))
            return np.sort(below[first[:count]])
        drawn *= 4.0


def _raw_type(is_weighted: bool, n_columns: int) -> np.dtype[Any]:
    """Return the type of the records of points as they are read."""
    weight: list[Any] = [("weight", np.float64)] if is_weighted else []
    return np.dtype([*RECORD.descr, *weight, ("columns", np.float64, (n_columns,))])


def sorted_by_boxes(
    overview: Overview, folder: Path, frame: Frame, options: Options, map_parts: MapParts, timer: Timer
) -> StoredPoints:
    """Sort the stored points by boxes, in the coordinates of a frame."""
    order = np.argsort(overview.hashes, kind="stable")
    sample = frame.local(overview.sample[order][: round(SPARE * SAMPLED)])
    sample = sample[first_occurrences(sample)][:SAMPLED]
    boxes = boxes_for(sample, overview.stored)
    cloud = PointCloud(overview.sample, overview.sample_columns)
    details = Details.from_cloud(cloud, options.details) if options.details else None
    record = _sorted_type(overview.weights, details, options)
    counts, runs = np.zeros(len(boxes), dtype=np.int64), []
    groups = _grouped(overview.chunks)
    names = list(overview.sample_columns)
    with timer("boxes", overview.stored) as on_progress:
        attribute = options.algorithm.reads_attribute
        sort = partial(_sort, folder, boxes, frame, record, names, overview.weights, details, attribute)
        for group, (run, run_counts) in zip(groups, map_parts(sort, groups), strict=True):
            runs.append(run)
            counts += run_counts
            for name, _, count in group:
                (folder / name).unlink()
                on_progress(count)
    n_places = _number_of_places(overview.hashes, overview.stored)
    return StoredPoints(folder, boxes, counts, tuple(runs), record, sample, n_places, overview.weights.mean)


def _number_of_places(hashes: NDArray[np.uint64], n: int) -> int:
    """Return about how many of n points are different, from the smallest hashes of these (Bar-Yossef et al. 2002)."""
    if len(hashes) < FEWEST:
        return len(hashes)
    estimate = (len(hashes) - 1) * HASHES / float(hashes.max())
    return n if estimate > 0.75 * n else round(estimate)  # no less of a cloud without repeats


def _sorted_type(weights: WeightRange, details: Details | None, options: Options) -> np.dtype[Any]:
    """Return the type of the records of points that are sorted by boxes: what a method needs of each."""
    more: list[Any] = [("weight", np.float64)] if weights.n_positive else []
    if details and details.width:
        more.append(("detail", np.float32, (details.width,)))
    if options.algorithm.reads_attribute is not None:
        more.append(("value", np.float64))
    return np.dtype([*RECORD.descr, *more])


def _grouped(chunks: Sequence[tuple[str, int, int]]) -> list[list[tuple[str, int, int]]]:
    """Return the chunks in groups of about as many points as a run should have."""
    groups: list[list[tuple[str, int, int]]] = []
    room = 0
    for chunk in chunks:
        if chunk[2] > room:
            groups.append([])
            room = max(RUN, chunk[2])
        groups[-1].append(chunk)
        room -= chunk[2]
    return groups


def _sort(
    folder: Path,
    boxes: Boxes,
    frame: Frame,
    record: np.dtype[Any],
    names: Sequence[str],
    weights: WeightRange,
    details: Details | None,
    attribute: str | None,
    group: Sequence[tuple[str, int, int]],
) -> tuple[Run, Ints]:
    """Sort some chunks into a run, and return it with the number of its points in each box."""
    records, begin = np.empty(sum(count for _, _, count in group), record), 0
    for name, first, count in group:
        chunk = records[begin : begin + count]
        raw = np.fromfile(folder / name, dtype=_raw_type(weights.n_positive > 0, len(names)))
        chunk["row"], chunk["place"] = raw["row"] + first, frame.local(np.ascontiguousarray(raw["place"]))
        if weights.n_positive:
            relative = weights.relative(np.ascontiguousarray(raw["weight"]))
            chunk["weight"] = np.where(relative > 0.0, relative, 1.0)  # points of weight 0 are here only to be kept
        columns = {column: raw["columns"][:, number] for number, column in enumerate(names)}
        if details and details.width:
            chunk["detail"] = details.values(PointCloud(raw["place"], columns))
        if attribute is not None:
            chunk["value"] = columns[attribute]
        begin += count
    return write_run(folder, group[0][0].replace(".raw", ".run"), boxes, records)


def take(
    sources: Sequence[CloudFiles], overview: Overview, indices: Ints, map_parts: MapParts, timer: Timer
) -> PointCloud:
    """Read the points at some indices, (n,), with all their attributes, in this order."""
    order = np.argsort(indices)
    tasks, first = [], 0
    for files, count in zip(sources, overview.source_counts, strict=True):
        within = slice(*np.searchsorted(indices[order], [first, first + count]))
        tasks.append((files, count, indices[order][within] - first, plan.CHUNK))
        first += count
    clouds = []
    with timer("kept points", overview.count) as on_progress:
        for task, cloud in zip(tasks, map_parts(_take, tasks), strict=True):
            clouds += [cloud] if cloud is not None else []
            on_progress(task[1])
    return overview.columns.joined(clouds).take(np.argsort(order))


def _take(task: tuple[CloudFiles, int, Ints, int]) -> PointCloud | None:
    """Read the points of a source at some indices, (n,), ascending; None if there are none."""
    files, count, indices, n = task
    if not len(indices):
        return None
    first, clouds, columns = 0, [], JointColumns()
    with files:
        for cloud in files.chunks(n):
            begin, end = np.searchsorted(indices, [first, first + len(cloud)])
            columns.add(cloud)
            clouds.append(cloud.take(indices[begin:end] - first))
            first += len(cloud)
    if first != count:
        raise InputError(f"expected {count:,} points again, found {first:,}: the files have changed meanwhile")
    return columns.joined(clouds)
