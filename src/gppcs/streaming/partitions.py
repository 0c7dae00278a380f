"""The passes over the files of a cloud as tasks of a cluster: a partition is a file, or a part of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.guide import ChunkGuide, WeightRange
from gppcs.io.cloud_files import CloudFiles
from gppcs.spatial.cells import first_occurrences, greatest_in_cells
from gppcs.spatial.chunks import Advanced, ChunkedPoints, ChunkedValues, Places, SparseValues, joined_places
from gppcs.spatial.scaling import Frame
from gppcs.streaming.cluster import Cluster
from gppcs.streaming.overview import NO_ROWS, Overview
from gppcs.streaming.reading import FilePasses, Kept


class LeftOut(NamedTuple):
    """Points of a cloud in files that are left out.

    Attributes
    ----------
    rows : (n,) array, int64
        Ascending.
    starts : list of int
        The row of the first point of each file.
    """

    rows: NDArray[np.int64]
    starts: list[int]

    def divided(self, parts: Sequence[CloudFiles]) -> list[NDArray[np.int64]]:
        """Return the rows of each part of the files, counted from its first point.

        Parameters
        ----------
        parts : sequence of CloudFiles
            What `CloudFiles.each` returns.

        Returns
        -------
        list of (m,) array, int64
        """
        of_file = np.cumsum([part.first == 0 for part in parts]) - 1
        begins = [self.starts[file] + part.first for file, part in zip(of_file, parts, strict=True)]
        some = np.split(self.rows, np.searchsorted(self.rows, begins[1:]))
        return [rows - begin for rows, begin in zip(some, begins, strict=True)]


class ClusterPasses:
    """Passes over files, each or each part of one by a task of its own.

    Parameters
    ----------
    files : CloudFiles
    rows : int
        Points of a chunk at most.
    cluster : Cluster
    part : int
        Points of a part of a file at least.
    left_out : LeftOut, optional
        Points that are left out.
    """

    def __init__(
        self, files: CloudFiles, rows: int, cluster: Cluster, part: int, left_out: LeftOut | None = None
    ) -> None:
        self._whole, self._cluster = FilePasses(files, rows, NO_ROWS if left_out is None else left_out.rows), cluster
        parts = files.each(part)
        out = [NO_ROWS] * len(parts) if left_out is None else left_out.divided(parts)
        self._passes = [FilePasses(each, rows, some) for each, some in zip(parts, out, strict=True)]

    def starts(self, seen: Overview) -> list[int]:
        """Return the row of the first point of each file.

        Parameters
        ----------
        seen : Overview
            Of these files.

        Returns
        -------
        list of int
        """
        begins = np.concatenate([[0], np.cumsum([own.count for own in seen.parts])]).tolist()
        return [begin for begin, passes in zip(begins, self._passes, strict=False) if passes.files.first == 0]

    def overview(self, advanced: Advanced, guide: ChunkGuide | None = None) -> Overview:
        """As `FilePasses.overview`.

        Parameters
        ----------
        advanced : callable
        guide : ChunkGuide, optional

        Returns
        -------
        Overview
        """
        whole = Overview(guide)
        for seen in self._cluster.each(partial(_overview, guide), self._passes):
            whole.merge(seen)
            advanced(seen.count)
        return whole

    def points(self, seen: Overview, frame: Frame) -> ChunkedPoints:
        """As `FilePasses.points`.

        Parameters
        ----------
        seen : Overview
        frame : Frame

        Returns
        -------
        ClusterPoints
        """
        local = self._whole.points(seen, frame)
        parts = self._parts(seen, partial(FilePasses.points, frame=frame))
        return ClusterPoints(local.count, local.chunks, parts, self._cluster)

    def weights(self, seen: Overview, known: WeightRange) -> ClusterValues:
        """As `FilePasses.weights`.

        Parameters
        ----------
        seen : Overview
        known : WeightRange

        Returns
        -------
        ClusterValues
        """
        local = self._whole.weights(seen, known)
        parts = self._parts(seen, partial(FilePasses.weights, known=known))
        return ClusterValues(local.count, local.chunks, parts, self._cluster)

    def _parts(self, seen: Overview, values: Callable[..., ChunkedValues]) -> list[Partition]:
        """Return the partitions with usable points, of which `values` returns what is wanted."""
        parts, first = [], 0
        for passes, own in zip(self._passes, seen.parts, strict=True):
            if own.usable:
                parts.append(Partition(passes, own, values, first))
            first += own.usable
        return parts

    def kept(self, seen: Overview, usable: NDArray[np.int64], advanced: Advanced) -> Kept:
        """As `FilePasses.kept`.

        Parameters
        ----------
        seen : Overview
        usable : (n,) array, int64
        advanced : callable

        Returns
        -------
        Kept
        """
        asked, first = [], 0
        for passes, own in zip(self._passes, seen.parts, strict=True):
            begin, end = np.searchsorted(usable, [first, first + own.usable])
            asked.append((passes, own, usable[begin:end] - first))
            first += own.usable
        rows, clouds, before = [], [], 0
        for (_, own, _), found in zip(asked, self._cluster.each(_kept, asked), strict=True):
            rows.append(before + found.rows)
            clouds += found.clouds
            before += own.count
            advanced(own.usable)
        return Kept(np.concatenate(rows), clouds)


class Partition(NamedTuple):
    """The usable points of a file, or of a part of one.

    Attributes
    ----------
    passes : FilePasses
    seen : Overview
    values : callable(FilePasses, Overview) -> ChunkedValues
        Returns what of the points is wanted.
    first : int
        Row of its first point among the usable points of all files.
    """

    passes: FilePasses
    seen: Overview
    values: Callable[..., ChunkedValues]
    first: int

    def slice(self, rows: NDArray[np.int64]) -> slice:
        """Return which of some ascending rows of all files lie in this one."""
        begin, end = np.searchsorted(rows, [self.first, self.first + self.seen.usable])
        return slice(int(begin), int(end))

    def opened(self, work: Callable[[Any], Any]) -> Any:
        """Do some work on the values."""
        with self.passes.files:
            return work(self.values(self.passes, self.seen))


@dataclass(frozen=True, eq=False)
class ClusterValues(ChunkedValues):
    """Values of points in files. Its passes are tasks; `chunks` reads in this process.

    Attributes
    ----------
    parts : sequence of Partition
    cluster : Cluster
    """

    parts: Sequence[Partition]
    cluster: Cluster

    def each(
        self, work: Callable[[int, NDArray[np.float64]], Any], advanced: Advanced = lambda steps: None
    ) -> Iterator[Any]:
        """As `ChunkedValues.each`; all chunks of a partition are one task."""
        for part, found in zip(self.parts, self.cluster.each(partial(_each, work), self.parts), strict=True):
            yield from found
            advanced(part.seen.usable)

    def take(self, rows: NDArray[np.int64], advanced: Advanced = lambda steps: None) -> NDArray[np.float64]:
        """As `ChunkedValues.take`."""
        return self._joined(
            _taken, [(part, _gaps(rows[part.slice(rows)] - part.first)) for part in self.parts], advanced
        )

    def every(self, step: int, advanced: Advanced = lambda steps: None) -> NDArray[np.float64]:
        """As `ChunkedValues.every`."""
        return self._joined(_taken_every, [(part, step) for part in self.parts], advanced)

    def _joined(self, work: Callable[[Any], Any], asked: Sequence[Any], advanced: Advanced) -> NDArray[np.float64]:
        found = []
        for part, values in zip(self.parts, self.cluster.each(work, asked), strict=True):
            found.append(values)
            advanced(part.seen.usable)
        return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class ClusterPoints(ClusterValues, ChunkedPoints):
    """Points in files."""

    def greatest_in_cells(self, edge: float, values: SparseValues, advanced: Advanced = lambda steps: None) -> Places:
        """As `ChunkedPoints.greatest_in_cells`; the finds of two partitions are merged by a task, and so on."""
        asked = []
        for part in self.parts:
            own = part.slice(values.rows)
            asked.append((part, edge, _gaps(values.rows[own] - part.first), values.values[own]))
        return self._merged(_greatest, asked, partial(_greatest_of, edge), advanced)

    def distinct(self, advanced: Advanced = lambda steps: None) -> Places:
        """As `ChunkedPoints.distinct`, merged as by `greatest_in_cells`."""
        return self._merged(_distinct, [(part,) for part in self.parts], _distinct_of, advanced)

    def _merged(
        self,
        find: Callable[[Any], Places],
        asked: Sequence[Any],
        merge: Callable[[Places, Places], Places],
        advanced: Advanced,
    ) -> Places:
        counts = iter(part.seen.usable for part in self.parts)
        found: Places = self.cluster.merged(find, asked, merge, lambda: advanced(next(counts)))
        return found


def _overview(guide: ChunkGuide | None, passes: FilePasses) -> Overview:
    with passes.files:
        return passes.overview(lambda steps: None, guide)


def _kept(asked: tuple[FilePasses, Overview, NDArray[np.int64]]) -> Kept:
    passes, seen, usable = asked
    with passes.files:
        rows, clouds = passes.kept(seen, usable, lambda steps: None)
        return Kept(rows, [seen.columns.joined(clouds)] if len(rows) else [])


def _each(work: Callable[[int, NDArray[np.float64]], Any], part: Partition) -> list[Any]:
    def done(first: int, chunk: NDArray[np.float64]) -> Any:
        return work(part.first + first, chunk)

    return cast("list[Any]", part.opened(lambda points: list(points.each(done))))


def _gaps(rows: NDArray[np.int64]) -> NDArray[Any]:
    """Return ascending rows by their differences, which take few bytes on their way over the scheduler."""
    gaps = np.diff(rows, prepend=0)
    return gaps.astype(np.min_scalar_type(int(gaps.max(initial=0))))


def _rows(gaps: NDArray[Any]) -> NDArray[np.int64]:
    return np.cumsum(gaps, dtype=np.int64)


def _taken(asked: tuple[Partition, NDArray[Any]]) -> Any:
    part, gaps = asked
    return part.opened(lambda points: points.take(_rows(gaps)))


def _taken_every(asked: tuple[Partition, int]) -> Any:
    part, step = asked
    return part.opened(lambda points: points.take(np.arange(-part.first % step, part.seen.usable, step)))


def _greatest(asked: tuple[Partition, float, NDArray[Any], NDArray[np.float32]]) -> Places:
    part, edge, gaps, values = asked
    sparse = SparseValues(_rows(gaps), values)
    return _shifted(part, part.opened(lambda points: points.greatest_in_cells(edge, sparse)))


def _distinct(asked: tuple[Partition]) -> Places:
    [part] = asked
    return _shifted(part, part.opened(lambda points: points.distinct()))


def _shifted(part: Partition, found: Places) -> Places:
    return found._replace(rows=part.first + found.rows)


def _greatest_of(edge: float, one: Places, other: Places) -> Places:
    both = joined_places([one, other])
    return both.take(greatest_in_cells(both.points, edge, both.values))


def _distinct_of(one: Places, other: Places) -> Places:
    both = joined_places([one, other])
    return both.take(np.flatnonzero(first_occurrences(both.points)))
