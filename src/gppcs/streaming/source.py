"""Gives the points of a box: from the files that meet it, or from files into which all points were sorted once."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from gppcs.amounts.options import Options
from gppcs.clouds.cloud import PointCloud
from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.spatial.boxes import Boxes, inside
from gppcs.spatial.samples import HASHES, point_hashes
from gppcs.streaming.graph import Engine
from gppcs.streaming.plan import CHUNK
from gppcs.streaming.rows import Rows
from gppcs.streaming.scratch import complete_file

RUN = 8  # Chunks that are sorted together.


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

    def chunks(self) -> Generator[Rows, None, None]:
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

    def read(self, boxes: Boxes, mask: Flags) -> Iterator[Rows]:
        """Read the points in some boxes, a mask of all, (boxes,)."""
        if (mask & boxes.meeting(self.lower, self.upper)).any():
            # Several tasks may read a file at once, each with a file object of its own.
            for rows in replace(self, files=copy(self.files)).chunks():
                of_point = boxes.box_of(rows.points)
                yield replace(rows, columns={**rows.columns, "box": of_point}).only(mask[of_point])


@dataclass(frozen=True, eq=False)
class Run:
    """A file of points that are sorted by boxes."""

    path: Path
    starts: Ints  # (boxes + 1,), where the points of each box begin
    columns: Mapping[str, tuple[np.dtype[Any], tuple[int, ...]]]  # type and shape of each, which follow each other

    @classmethod
    def write(cls, path: Path, boxes: Boxes, rows: Rows) -> Run:
        """Sort points into a new file."""
        of_point = boxes.box_of(rows.points)
        order = np.argsort(of_point, kind="stable")  # by radix
        columns = {"index": rows.indices, "point": rows.points, **rows.columns}
        with complete_file(path) as file:
            for values in columns.values():
                values.take(order, axis=0).tofile(file)
        starts = np.concatenate([[0], np.cumsum(np.bincount(of_point, minlength=len(boxes)))])
        return cls(path, starts, {name: (values.dtype, values.shape) for name, values in columns.items()})

    def read(self, boxes: Boxes, mask: Flags) -> Iterator[Rows]:
        """Read the points in some boxes, a mask of all, (boxes,)."""
        ends = np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)  # of boxes one after another
        numbers = np.flatnonzero(mask).astype(np.uint16)
        spans = [(first, last) for first, last in self.starts[ends] if first < last]
        if spans:
            columns: dict[str, Any] = {"box": np.repeat(numbers, np.diff(self.starts)[numbers])}
            offset = 0
            for name, (dtype, shape) in self.columns.items():
                stored = np.memmap(self.path, dtype, "r", offset, shape)
                columns[name] = np.concatenate([stored[first:last] for first, last in spans])
                offset += stored.nbytes
            yield Rows(columns.pop("index"), columns.pop("point"), columns)


@dataclass(frozen=True, eq=False)
class Source:
    """The points of a cloud, by the box in which they lie."""

    pieces: Sequence[Part | Run]
    boxes: Boxes
    nothing: Rows  # of the same columns
    excluded: Ints  # (n,), ascending: indices of outliers, which are not there

    def read(self, lower: Floats, upper: Floats, fraction: float = 1.0) -> Rows:
        """Read a fraction of the points between two corners, (3,), in an order that does not depend on the files."""
        mask = self.boxes.meeting(lower, upper)
        rows = Rows.joined(self.read_piece(mask, fraction, piece) for piece in self.pieces)
        return self.ordered(rows.only(inside(rows.points, lower, upper)))

    def read_piece(self, mask: Flags, fraction: float, piece: Part | Run) -> Rows:
        """Read a fraction of the points in some boxes, a mask of all, (boxes,), by hashes, and all points to keep."""
        parts = piece.read(self.boxes, mask)
        if fraction < 1.0:
            parts = (rows.only(rows.keep | (point_hashes(rows.points, size=1.0) < fraction * HASHES)) for rows in parts)
        return Rows.joined([self.nothing, *parts])

    def ordered(self, rows: Rows) -> Rows:
        """Return what is read of all pieces, in the order of the hashes, but the outliers."""
        if len(self.excluded):
            rows = rows.only(~np.isin(rows.indices, self.excluded))
        hashes = point_hashes(rows.points, size=1.0).astype("<u8", copy=False)
        return rows.take(np.lexsort(hashes.view("<u2").reshape(-1, 4).T))  # by radix


def sorted_once(parts: Sequence[Part], boxes: Boxes, folder: Path, run_on: Engine, timer: Timer) -> list[Run]:
    """Read all points, and sort them by boxes into files in a folder."""
    with timer("sorting", len(parts)) as on_progress:
        runs = run_on.run(partial(_sort, boxes, folder), parts, on_progress=on_progress)
    return [run for of_part in runs for run in of_part]


def _sort(boxes: Boxes, folder: Path, part: Part) -> list[Run]:
    """Sort the points of a part."""
    runs = list[Run]()
    with closing(part.chunks()) as chunks:  # here, and not in another thread, after an error
        while together := list(islice(chunks, RUN)):
            runs.append(Run.write(folder / f"{part.first}-{len(runs)}.run", boxes, Rows.joined(together)))
    return runs
