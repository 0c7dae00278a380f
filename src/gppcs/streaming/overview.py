"""What the first pass finds out about a cloud."""

from __future__ import annotations

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.io.cloud_files import JointColumns
from gppcs.spatial.scaling import bounds


class Overview:
    """The number of points, the bounds of the finite ones, and the types of attributes.

    Attributes
    ----------
    count, bad, first_bad : int
        Number of points; of those that are not finite; and the row of the first of these.
    low, high : (3,) arrays
        Bounds of the finite points; infinite if there are none.
    columns : JointColumns
    parts : list of Overview
        Those that were merged.
    """

    def __init__(self) -> None:
        self.count = self.bad = self.first_bad = 0
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.columns = JointColumns()
        self.parts: list[Overview] = []

    @property
    def finite(self) -> int:
        """Number of finite points."""
        return self.count - self.bad

    def add(self, cloud: PointCloud) -> None:
        """Take note of the next points.

        Parameters
        ----------
        cloud : PointCloud
            At least one.

        Raises
        ------
        FileFormatError
            If they do not fit those before.
        """
        self.columns.add(cloud)
        low, high = bounds(cloud.points)
        if not np.isfinite([low, high]).all():
            bad = cloud.non_finite()
            self.first_bad = self.first_bad if self.bad else self.count + int(bad[0])
            self.bad += len(bad)
            finite = np.delete(cloud.points, bad, axis=0)
            low, high = bounds(finite) if len(finite) else (self.low, self.high)
        self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)
        self.count += len(cloud)

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
        self.count, self.bad = self.count + other.count, self.bad + other.bad
        self.low, self.high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
