"""Fill gaps: add points, each the farthest from all others, until no point is too far from one."""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.stages import Stages
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.kdtree import KdTree

AT_ONCE = 1 << 18  # Points in gaps that are held at once; with more, it takes more passes.


class Filled(NamedTuple):
    """What `fill_gaps` returns.

    Attributes
    ----------
    rows : (n,) array, int64
        The points that are added, in the order chosen.
    places : (n, 3) array
    reached : float
        The largest distance from a point to one that is kept or added.
    """

    rows: NDArray[np.int64]
    places: NDArray[np.float64]
    reached: float


def fill_gaps(points: ChunkedPoints, kept: NDArray[np.float64], gap: float, stages: Stages) -> Filled:
    """Add points, each the farthest from all others, until no point is farther from one than a length.

    These are the points that `farthest_points` chooses from all. Those that are near enough are never chosen, so only
    the others are held. If they are too many, those nearest are left out, and the choice goes on only while it is
    farther from all others than these are. Then the next pass finds those that are still too far.

    Parameters
    ----------
    points : ChunkedPoints
        N points, which may repeat each other.
    kept : (M, 3) array
        At least one.
    gap : float
    stages : Stages
        Times "gaps". A step is a point read.

    Returns
    -------
    Filled
    """
    rows, places = np.empty(0, dtype=np.int64), kept
    least = float(np.nextafter(gap, math.inf))
    while True:
        with stages("gaps", len(points)) as advanced:
            tree, far = KdTree.build(places), _NONE
            for found in points.each(partial(_far_points, tree, least), advanced):
                far = far.joined(found)
        if not len(far.rows):
            return Filled(rows, places[len(kept) :], math.sqrt(far.greatest))
        with stages("gaps"):
            added = _farthest(far, places, least)
        rows, places = np.concatenate([rows, far.rows[added]]), np.concatenate([places, far.points[added]])


class _Far(NamedTuple):
    """Points that are too far from all others, with ascending rows and their squared distances.

    `left_out` is the largest squared distance of those that are too many, and `greatest` that of all points.
    """

    rows: NDArray[np.int64]
    points: NDArray[np.float64]
    squared: NDArray[np.float64]
    left_out: float
    greatest: float

    def joined(self, other: _Far) -> _Far:
        """Return these points and others behind them."""
        rows, points, squared = (np.concatenate(both) for both in zip(self[:3], other[:3], strict=True))
        left_out, greatest = max(self.left_out, other.left_out), max(self.greatest, other.greatest)
        return _Far(rows, points, squared, left_out, greatest).cut()

    def cut(self) -> _Far:
        """Return the farthest, if they are too many; of equally far ones the first."""
        if len(self.rows) <= AT_ONCE:
            return self
        order = np.lexsort([self.rows, -self.squared])
        held = np.sort(order[:AT_ONCE])
        left_out = max(self.left_out, float(self.squared[order[AT_ONCE]]))
        return _Far(self.rows[held], self.points[held], self.squared[held], left_out, self.greatest)


_NONE = _Far(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty(0), 0.0, 0.0)


def _far_points(tree: KdTree, least: float, first: int, chunk: NDArray[np.float64]) -> _Far:
    """Return the points of a chunk that are at least so far from those of a tree."""
    squared = tree.nearest_of(chunk, 1)[1][:, 0]
    far = np.flatnonzero(squared >= least * least)
    return _Far(first + far, chunk[far], squared[far], 0.0, float(squared.max())).cut()


def _farthest(far: _Far, others: NDArray[np.float64], least: float) -> NDArray[np.int64]:
    """Choose among far points those that would be chosen next among all points; at least one."""
    if far.left_out:
        least = float(np.nextafter(math.sqrt(far.left_out), math.inf))
        while least * least <= far.left_out:
            least = float(np.nextafter(least, math.inf))
    chosen, _ = farthest_points(far.points, len(far.points), others=others, least=least)
    return chosen if len(chosen) else farthest_points(far.points, 1, others=others)[0]
