"""What the first pass finds out about a cloud."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.guide import ChunkGuide, WeightRange
from gppcs.clouds.cloud import PointCloud
from gppcs.io.cloud_files import JointColumns
from gppcs.spatial.chunks import Places
from gppcs.spatial.scaling import Frame, bounds

NO_ROWS = np.empty(0, dtype=np.int64)


class Overview:
    """The number of points, the bounds of the finite ones, and the types of attributes.

    Attributes
    ----------
    count, bad, first_bad : int
        Number of points; of those that are not finite; and the row of the first of these.
    left_out : int
        Number of points that are left out. They are finite.
    low, high : (3,) arrays
        Bounds of the finite points that are not left out; infinite if there are none.
    columns : JointColumns
    guide : ChunkGuide or None
    weightless : int
        Number of the others that cannot be chosen: their weight is 0, and they are not to be kept.
    weights : WeightRange
        Of the finite points that are not left out.
    parts : list of Overview
        Those that were merged.

    Parameters
    ----------
    guide : ChunkGuide, optional
        What users know of the points.
    """

    def __init__(self, guide: ChunkGuide | None = None) -> None:
        self.guide = guide
        self._rows: list[NDArray[np.int64]] = [np.empty(0, dtype=np.int64)]  # of points to keep, among the usable
        self._places = [np.empty((0, 3))]
        self.count = self.bad = self.first_bad = self.left_out = self.weightless = 0
        self.weights = WeightRange()
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.columns = JointColumns()
        self.parts: list[Overview] = []

    @property
    def finite(self) -> int:
        """Number of finite points that are not left out."""
        return self.count - self.bad - self.left_out

    @property
    def weight(self) -> str | None:
        """The attribute that multiplies the density, if any."""
        return None if self.guide is None else self.guide.weight

    @property
    def usable(self) -> int:
        """Number of points among which is chosen."""
        return self.finite - self.weightless

    @property
    def keeps(self) -> bool:
        """Whether there are points that are kept whatever happens."""
        return any(map(len, self._rows))

    def to_keep(self, frame: Frame) -> Places:
        """Return the usable points that are kept whatever happens.

        Parameters
        ----------
        frame : Frame
            In which they are given.

        Returns
        -------
        Places
            Rows among the usable points.
        """
        rows = np.concatenate(self._rows)
        return Places(rows, frame.local(np.concatenate(self._places)), np.zeros(len(rows), dtype=np.float32))

    def add(self, cloud: PointCloud, left_out: NDArray[np.int64] = NO_ROWS) -> None:
        """Take note of the next points.

        Parameters
        ----------
        cloud : PointCloud
            At least one.
        left_out : (n,) array, int64
            Which of them are left out, ascending. They are finite.

        Raises
        ------
        FileFormatError
            If they do not fit those before.
        InputError, ParameterError
            As for `ChunkGuide.of_chunk`.
        """
        self.columns.add(cloud)  # the types of all: without outliers, the others keep theirs
        count, bad = len(cloud), NO_ROWS
        if not np.isfinite(bounds(cloud.points)).all():
            bad = cloud.non_finite()
            self.first_bad = self.first_bad if self.bad else self.count + int(bad[0])
        if len(left_out):
            cloud = cloud.take(np.delete(np.arange(len(cloud)), left_out))
        if self.guide is not None:
            rows, keep, weights = self.guide.of_chunk(cloud)
            self._rows.append(self.usable + keep)
            self._places.append(cloud.points[rows[keep]])
            if weights is not None:
                self.weights = self.weights.followed_by(WeightRange.of(weights))
                self.weightless += len(weights) - len(rows)
        finite = cloud.points[cloud.finite_rows()] if len(bad) else cloud.points
        if len(finite):
            low, high = bounds(finite)
            self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)
        self.count, self.bad, self.left_out = self.count + count, self.bad + len(bad), self.left_out + len(left_out)

    def merge(self, other: Overview) -> None:
        """Take note of the next points, of which there is an overview.

        Parameters
        ----------
        other : Overview

        Raises
        ------
        FileFormatError
            If they do not fit those before.
        """
        self.parts.append(other)
        self.columns.merge(other.columns)
        if other.bad and not self.bad:
            self.first_bad = self.count + other.first_bad
        self._rows += [self.usable + rows for rows in other._rows]
        self._places += other._places
        self.weights = self.weights.followed_by(other.weights)
        self.weightless += other.weightless
        self.count, self.bad = self.count + other.count, self.bad + other.bad
        self.left_out += other.left_out
        self.low, self.high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
