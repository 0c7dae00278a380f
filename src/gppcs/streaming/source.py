"""Gives the points of a box: from the files that meet it, or from files into which all points were sorted once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gppcs.amounts.options import Options
from gppcs.clouds.cloud import PointCloud
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.spatial.boxes import Boxes, inside
from gppcs.spatial.samples import HASHES, point_hashes
from gppcs.streaming.graph import Engine
from gppcs.streaming.plan import CHUNK
from gppcs.streaming.rows import Rows
from gppcs.streaming.scratch import complete_file

RUN = 1 << 20  # Points that are sorted together, about.


@dataclass(frozen=True, eq=False)
class Part:
    """Some of the files of a cloud, or a part of one, whose points follow each other."""

    files: CloudFiles
    options: Options
    first: int = 0  # index of its first point
    count: int | None = None  # of its points, if they are counted
    lower: Floats = field(default_factory=lambda: np.full(3, np.inf))  # (3,), corners of the box of its points
    upper: Floats = field(default_factory=lambda: np.full(3, -np.inf))

    def clouds(self) -> Iterator[tuple[int, PointCloud]]:
        """Read all points, chunk by chunk; yield these with the number of points before them."""
        n = 0
        with self.files as files:
            for cloud in files.chunks(CHUNK):
                yield n, cloud
                n += len(cloud)
        if self.count is not None and n != self.count:
            raise InputError(f"expected {self.count:,} points again, found {n:,}: the files have changed meanwhile")

    def chunks(self) -> Iterator[Rows]:
        """Read the points that may be kept."""
        for n, cloud in self.clouds():
            yield Rows.from_cloud(cloud, self.first + n, self.of_chunk(n, len(cloud)))

    def of_chunk(self, first: int, n: int) -> Options:
        """Return the options with only those entries of arrays that describe n points of the part."""
        keep, weight = (
            values[first : first + n] if isinstance(values, np.ndarray) else values
            for values in (self.options.keep, self.options.weight)
        )
        if keep is self.options.keep and weight is self.options.weight:
            return self.options
        return replace(self.options, keep=keep, weight=weight)

    def meets(self, lower: Floats, upper: Floats) -> bool:
        """Return whether points may lie between two corners, (3,)."""
        return bool(((self.lower <= upper) & (self.upper >= lower)).all())

    def read(self, lower: Floats, upper: Floats) -> Iterator[Rows]:
        """Read the points between two corners, (3,)."""
        # Several tiles may read a file at once, each with a file object of its own.
        for rows in replace(self, files=copy(self.files)).chunks():
            yield rows.only(inside(rows.points, lower, upper))


@dataclass(frozen=True, eq=False)
class Run:
    """A file of points that are sorted by boxes, column by column."""

    path: Path
    boxes: Boxes
    starts: Ints  # (boxes + 1,), where the points of each box begin
    kinds: Mapping[str, np.dtype[Any]]  # of a column, one value

    @classmethod
    def write(cls, path: Path, boxes: Boxes, rows: Rows) -> Run:
        """Sort points into a new file."""
        of_point = boxes.box_of(rows.points).astype(np.min_scalar_type(len(boxes)))  # sorted by radix, up to 16 bits
        rows = rows.take(np.argsort(of_point, kind="stable"))
        starts = np.concatenate([[0], np.cumsum(np.bincount(of_point, minlength=len(boxes)))])
        columns = {"index": rows.indices, "point": rows.points, **rows.columns}
        kinds = {name: np.dtype((values.dtype, values.shape[1:])) for name, values in columns.items()}
        with complete_file(path) as file:
            for values in columns.values():
                values.tofile(file)
        return cls(path, boxes, starts, kinds)

    def meets(self, lower: Floats, upper: Floats) -> bool:
        """Return whether points may lie between two corners, (3,)."""
        return any(first < last for first, last in self._spans(lower, upper))

    def read(self, lower: Floats, upper: Floats) -> Iterator[Rows]:
        """Read the points between two corners, (3,)."""
        spans = self._spans(lower, upper)
        columns, begin = {}, 0
        with self.path.open("rb", buffering=0) as file:
            for name, kind in self.kinds.items():
                values = np.empty(sum(last - first for first, last in spans), kind)
                n = 0
                for first, last in spans:
                    file.seek(begin + first * kind.itemsize)
                    file.readinto(values[n : n + last - first].view(np.uint8).data)
                    n += last - first
                columns[name] = values
                begin += int(self.starts[-1]) * kind.itemsize
        rows = Rows(columns.pop("index"), columns.pop("point"), columns)
        yield rows.only(inside(rows.points, lower, upper))

    def _spans(self, lower: Floats, upper: Floats) -> list[tuple[int, int]]:
        """Return where points of boxes that may lie between two corners begin and end."""
        near = self.boxes.meeting(lower, upper)
        together = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1) if len(near) else []
        spans = [(int(self.starts[span[0]]), int(self.starts[span[-1] + 1])) for span in together]
        return [span for span in spans if span[0] < span[1]]


@dataclass(frozen=True, eq=False)
class Source:
    """The points of a cloud, by the box in which they lie."""

    pieces: Sequence[Part | Run]
    nothing: Rows  # of the same columns
    excluded: Ints  # (n,), ascending: indices of outliers, which are not there

    def read(self, lower: Floats, upper: Floats, fraction: float = 1.0) -> Rows:
        """Read the points between two corners, (3,), in an order that does not depend on that of the files."""
        parts = [
            _drawn(rows, fraction)
            for piece in self.pieces
            if piece.meets(lower, upper)
            for rows in piece.read(lower, upper)
        ]
        rows = Rows.joined([self.nothing, *parts])
        if len(self.excluded):
            rows = rows.only(~np.isin(rows.indices, self.excluded))
        return rows.take(np.argsort(point_hashes(rows.points, size=1.0), kind="stable"))


def _drawn(rows: Rows, fraction: float) -> Rows:
    """Return a fraction of the places, by their hashes, and all points to keep."""
    return rows if fraction >= 1.0 else rows.only(rows.keep | (point_hashes(rows.points, size=1.0) < fraction * HASHES))


def sorted_once(parts: Sequence[Part], boxes: Boxes, folder: Path, run_on: Engine, timer: Timer) -> list[Run]:
    """Read all points, and sort them by boxes into files in a folder."""
    with timer("sorting", len(parts)) as on_progress:
        runs = run_on.run(partial(_sort, boxes, folder), parts, on_progress=on_progress)
    return [run for of_part in runs for run in of_part]


def _sort(boxes: Boxes, folder: Path, part: Part) -> list[Run]:
    """Sort the points of a part."""
    runs, waiting = list[Run](), list[Rows]()
    for rows in part.chunks():
        waiting.append(rows)
        if sum(map(len, waiting)) >= RUN:
            runs.append(Run.write(folder / f"{part.first}-{len(runs)}.run", boxes, Rows.joined(waiting)))
            waiting = []
    if waiting:
        runs.append(Run.write(folder / f"{part.first}-{len(runs)}.run", boxes, Rows.joined(waiting)))
    return runs
