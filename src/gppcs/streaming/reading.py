"""The passes over the files of a cloud, one chunk after another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.guide import ChunkGuide, WeightRange, weights_of
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.simplification import rows_without
from gppcs.spatial.chunks import ChunkedPoints, ChunkedValues
from gppcs.spatial.scaling import Frame, bounds
from gppcs.streaming.overview import NO_ROWS, Overview

Advanced = Callable[[int], None]


class Kept(NamedTuple):
    """Some points of a cloud.

    Attributes
    ----------
    rows : (n,) array, int64
        Ascending.
    clouds : list of PointCloud
        These points with their attributes, in parts.
    """

    rows: NDArray[np.int64]
    clouds: list[PointCloud]


@dataclass(frozen=True)
class FilePasses:
    """Passes over some files.

    Attributes
    ----------
    files : CloudFiles
    rows : int
        Points of a chunk at most.
    left_out : (n,) array, int64
        Rows of points that are left out, ascending. They are finite.
    """

    files: CloudFiles
    rows: int
    left_out: NDArray[np.int64] = field(default_factory=lambda: NO_ROWS)

    def overview(self, advanced: Advanced, guide: ChunkGuide | None = None) -> Overview:
        """Read the bounds, the number of points, the types of attributes, the points to keep, and the range of weights.

        Parameters
        ----------
        advanced : callable
            Called with the number of points read since the last call.
        guide : ChunkGuide, optional
            What users know of the points.

        Returns
        -------
        Overview
        """
        seen = Overview(guide)
        for cloud in self.files.chunks(True, self.rows):
            seen.add(cloud, self._left_out_of(seen.count, len(cloud)))
            advanced(len(cloud))
        return seen

    def points(self, seen: Overview, frame: Frame) -> ChunkedPoints:
        """Return the usable points.

        Parameters
        ----------
        seen : Overview
            Of these files.
        frame : Frame
            In which the points are given.

        Returns
        -------
        ChunkedPoints
        """

        def chunks() -> Iterator[NDArray[np.float64]]:
            for part in self._usable_parts(seen, attributes=False):
                yield frame.local(part.cloud.points)

        return ChunkedPoints(seen.usable, chunks)

    def weights(self, seen: Overview, known: WeightRange) -> ChunkedValues:
        """Return the weights of the usable points.

        Parameters
        ----------
        seen : Overview
            Of these files, with a guide that has weights.
        known : WeightRange
            Of all weights.

        Returns
        -------
        ChunkedValues
            As shares of the largest one; 0 or at least `LEAST_WEIGHT`.
        """

        def chunks() -> Iterator[NDArray[np.float64]]:
            for part in self._usable_parts(seen, attributes=True):
                yield known.shares(weights_of(part.cloud, seen.weight))

        return ChunkedValues(seen.usable, chunks)

    def kept(self, seen: Overview, usable: NDArray[np.int64], advanced: Advanced) -> Kept:
        """Read some points with all their attributes.

        Parameters
        ----------
        seen : Overview
            Of these files.
        usable : (n,) array, int64
            Their rows among the usable points, ascending.
        advanced : callable
            Called with the number of usable points read since the last call.

        Returns
        -------
        Kept
            Rows among all points of these files.
        """
        rows: list[NDArray[np.int64]] = [np.empty(0, dtype=np.int64)]
        clouds: list[PointCloud] = []
        first = 0
        for part in self._usable_parts(seen, attributes=True):
            begin, end = np.searchsorted(usable, [first, first + len(part.cloud)])
            taken = usable[begin:end] - first
            rows.append(part.rows[taken])
            clouds.append(part.cloud.take(taken))
            first += len(part.cloud)
            advanced(len(part.cloud))
        return Kept(np.concatenate(rows), clouds)

    def _usable_parts(self, seen: Overview, attributes: bool) -> Iterator[_Part]:
        """Yield the usable points of all chunks; raise an error if there are not as many points as at first."""
        first = 0
        for cloud in self.files.chunks(attributes or seen.weightless > 0, self.rows):
            here = np.arange(first, first + len(cloud))
            usable = self._usable_of(seen, cloud, first)
            first += len(cloud)
            if usable is not None:
                cloud, here = cloud.take(usable), here[usable]
            if len(cloud):
                yield _Part(cloud, here)
        if first != seen.count:
            raise InputError(
                f"expected {seen.count:,} points again, found {first:,}: the files have changed meanwhile; start anew"
            )

    def _usable_of(self, seen: Overview, cloud: PointCloud, first: int) -> NDArray[np.int64] | None:
        """Return which points of a chunk are usable; None if all are."""
        usable = None
        if seen.guide is not None and seen.weightless:
            usable = seen.guide.of_chunk(cloud).rows
        elif not np.isfinite(bounds(cloud.points)).all():
            usable = cloud.finite_rows()
        return rows_without(self._left_out_of(first, len(cloud)), usable, len(cloud))

    def _left_out_of(self, first: int, count: int) -> NDArray[np.int64]:
        """Return which points of a chunk are left out."""
        begin, end = np.searchsorted(self.left_out, [first, first + count])
        return self.left_out[begin:end] - first


class _Part(NamedTuple):
    """The usable points of a chunk, and their rows in the whole cloud."""

    cloud: PointCloud
    rows: NDArray[np.int64]
