"""Points on disk, sorted by the boxes in which they lie, so that a part of the cloud and its halo can be read.

The points come in chunks. Some of them together are sorted into a file, a *run*, so several processes can sort.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from io import FileIO
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.spatial.boxes import Boxes, MapParts, Part
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.samples import is_drawn

BOX = 1 << 14  # Points of a box, unless there are more boxes than the sample can tell apart.
BLOCK = 1 << 16  # Points that are copied at once: few fit into the cache, and take little memory.
RECORD = np.dtype([("row", np.int64), ("place", np.float64, 3)])


class Run(NamedTuple):
    """A file with points of the boxes from `first` to `last`, the latter excluded, sorted by boxes."""

    name: str
    first: int
    last: int


class Neighbourhood(NamedTuple):
    """The records of a part and of its halo, by ascending indices."""

    records: NDArray[Any]  # (n,), with at least the fields "row" and "place"
    inside: Flags  # (n,), whether a point lies in the part itself

    @property
    def indices(self) -> Ints:
        """Indices of the points in the cloud, (n,)."""
        return np.ascontiguousarray(self.records["row"])

    @property
    def points(self) -> Floats:
        """The points, (n, 3)."""
        return np.ascontiguousarray(self.records["place"])

    @property
    def values(self) -> Floats | None:
        """The values of the column that the method reads, (n,), if any."""
        return np.ascontiguousarray(self.records["value"]) if "value" in (self.records.dtype.names or ()) else None

    def take(self, indices: NDArray[Any]) -> Neighbourhood:
        """Return some of them."""
        return Neighbourhood(self.records.take(indices), self.inside[indices])


@dataclass(frozen=True, eq=False)
class StoredPoints:
    """The points of a cloud, in a file for each run."""

    folder: Path
    boxes: Boxes
    counts: Ints  # (boxes,), number of points in each box
    runs: tuple[Run, ...]
    kind: np.dtype[Any]  # Of a record: its fields are "row", "place" and others
    sample: Floats  # (n, 3), A random sample of the points, without repeats
    n_places: int  # Number of different points, about
    mean_weight: float = 1.0  # Mean of the weights, in units of the largest, if each record has a "weight"

    def __len__(self) -> int:
        return int(self.counts.sum())

    def count(self, part: Part) -> int:
        """Return how many points a part has."""
        return int(self.counts[part.first : part.last].sum())

    def parts(self, maximum: int) -> list[Part]:
        """Return parts of at most so many points each, unless a box has more."""
        return self.boxes.parts(self.counts, maximum)

    def near(self, part: Part, width: float = 0.0, *, repeats: bool = False, fraction: float = 1.0) -> Neighbourhood:
        """Read the points of a part and of a halo of some width around it, by default without repeats.

        With a fraction below 1, these are a random sample, as `is_drawn` marks it.
        """
        has_repeats = self.n_places < len(self)
        if has_repeats and fraction < 1.0 and not repeats:  # the first of them counts, also if only others are drawn
            near = self.near(part, width)
            return near.take(np.flatnonzero(is_drawn(near.indices, fraction)))
        around = _in_spans(self.boxes.around(part, width)) if width else []
        records = self.records([(part.first, part.last)], fraction)
        count = len(records)
        records = np.concatenate([records, part.near(self.records(around, fraction), width)])
        order = np.argsort(records["row"], kind="stable")
        records = records.take(order)  # four times as fast as records[order], which copies field by field
        near = Neighbourhood(records, order < count)
        if repeats:
            return near
        first = first_occurrences(near.points)
        return near if first.all() else near.take(np.flatnonzero(first))

    def besides(self, indices: Ints, count: int) -> Ints:
        """Return the first indices besides some, (count,), for clouds with fewer different points than are wanted."""
        rest = np.empty(0, dtype=np.int64)
        for run in self.runs:
            records = replace(self, runs=(run,)).records([(0, len(self.boxes))])
            rest = np.sort(np.concatenate([rest, np.setdiff1d(records["row"], indices)]))[:count]
        return rest

    def records(self, spans: Sequence[tuple[int, int]], fraction: float = 1.0) -> NDArray[Any]:
        """Read the points of spans of boxes, each with its first box and the one behind, or a random sample."""
        records = [np.empty(0, dtype=self.kind)]
        for run in self.runs:
            in_run = [(max(first, run.first), min(last, run.last)) for first, last in spans]
            in_run = [(first, last) for first, last in in_run if first < last]
            if in_run:
                with (self.folder / run.name).open("rb", buffering=0) as file:
                    for first, last in in_run:
                        piece = _read(file, run, first, last, self.kind)
                        records.append(piece if fraction >= 1.0 else piece.compress(is_drawn(piece["row"], fraction)))
        return np.concatenate(records)


def _read(file: FileIO, run: Run, first: int, last: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """Read the points of some boxes of a run: the file begins with the place of each box among the points."""
    starts = np.empty(last - first + 1, dtype=np.int64)
    file.seek(starts.itemsize * (first - run.first))
    file.readinto(starts.data)
    records = np.empty(int(starts[-1] - starts[0]), dtype=kind)
    if len(records):
        file.seek(starts.itemsize * (run.last - run.first + 1) + int(starts[0]) * kind.itemsize)
        file.readinto(records.view(np.uint8).data)
    return records


def _in_spans(boxes: Ints) -> list[tuple[int, int]]:
    """Return spans of boxes that follow each other."""
    spans = np.split(boxes, np.flatnonzero(np.diff(boxes) > 1) + 1) if len(boxes) else []
    return [(int(span[0]), int(span[-1]) + 1) for span in spans]


def boxes_for(sample: Floats, n: int) -> Boxes:
    """Return boxes that hold about as many of n points each, of which there is a sample, (m, 3)."""
    count = -(-n // BOX)
    maximum = max(1, len(sample) // 16)  # a box needs so many points of the sample
    return Boxes.from_sample(sample, 1 << min((count - 1).bit_length(), maximum.bit_length() - 1))


def write_run(folder: Path, name: str, boxes: Boxes, records: NDArray[Any]) -> tuple[Run, Ints]:
    """Write some records as a run, and return it with the number of its points in each box."""
    blocks = [slice(first, first + BLOCK) for first in range(0, len(records), BLOCK)]
    of_point = np.empty(len(records), dtype=np.min_scalar_type(len(boxes)))  # sorted by radix, up to 16 bits
    for block in blocks:
        of_point[block] = boxes.box_of(np.ascontiguousarray(records["place"][block]))
    counts = np.bincount(of_point, minlength=len(boxes))
    first, last = (int(of_point.min()), int(of_point.max()) + 1) if len(records) else (0, 0)
    order = np.argsort(of_point, kind="stable")
    starts = np.concatenate([[0], np.cumsum(counts[first:last])])
    write_at_once(folder / name, chain([starts], (records.take(order[block]) for block in blocks)))
    return Run(name, first, last), counts


def write_at_once(path: Path, arrays: Iterable[NDArray[Any]]) -> None:
    """Write arrays to a file, which appears once it is complete: a task may be done by two workers at once."""
    unfinished = path.with_name(f"{path.name}.{uuid4().hex}")
    with unfinished.open("wb") as file:
        for array in arrays:
            array.tofile(file)
    os.replace(unfinished, path)


def without(stored: StoredPoints, indices: Ints, map_parts: MapParts) -> StoredPoints:
    """Return the stored points without some, (n,) ascending."""
    if not len(indices):
        return stored
    runs, counts = zip(*map_parts(partial(_run_without, stored, indices), stored.runs), strict=True)
    return replace(stored, runs=runs, counts=np.array(counts).sum(axis=0))


def _run_without(stored: StoredPoints, indices: Ints, run: Run) -> tuple[Run, Ints]:
    records = replace(stored, runs=(run,)).records([(run.first, run.last)])
    return write_run(stored.folder, run.name, stored.boxes, records.compress(~np.isin(records["row"], indices)))
