"""Fill gaps: add points, each the farthest from all others, until no point is too far from one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.kdtree import KdTree


def fill_gaps(points: NDArray[np.float64], kept: NDArray[np.float64], gap: float) -> tuple[NDArray[np.int64], float]:
    """Add the farthest points, (N, 3), until none is beyond a gap; return rows and the largest distance left."""
    least = float(np.nextafter(gap, math.inf))
    squared = KdTree.build(kept).nearest_of(points, 1)[1][:, 0]
    far = np.flatnonzero(squared >= least * least)
    if not len(far):
        return far, math.sqrt(squared.max())
    places = points[far]
    chosen, _ = farthest_points(places, len(far), others=kept, least=least)
    if len(chosen):
        squared = np.minimum(squared, KdTree.build(places[chosen]).nearest_of(points, 1)[1][:, 0])
    return far[chosen], math.sqrt(squared.max())
