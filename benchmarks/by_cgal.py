"""CGAL's methods on arrays of points, timed without the making of its point sets. Needs the extra `cgal`."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from CGAL.CGAL_Kernel import Point_3
from CGAL.CGAL_Point_set_3 import Point_set_3
from CGAL.CGAL_Point_set_processing_3 import (
    compute_average_spacing,
    hierarchy_simplify_point_set,
    wlop_simplify_and_regularize_point_set,
)
from numpy.typing import NDArray

Array = NDArray[np.float64]


def point_set(points: Array) -> Point_set_3:
    """Return the points as a set of CGAL."""
    made = Point_set_3()
    for x, y, z in points.tolist():
        made.insert(Point_3(x, y, z))
    return made


def radius_of_wlop(points: Array) -> float:
    """Return CGAL's default."""
    return 8 * compute_average_spacing(point_set(points), 6)


def clusters(points: Array, size: int, variation: float) -> float:
    """Return the seconds of hierarchical clustering."""
    given = point_set(points)
    start = perf_counter()
    hierarchy_simplify_point_set(given, size, variation)
    return perf_counter() - start


def wlop(points: Array, share: float, radius: float | None = None) -> tuple[Array, float]:
    """Return the points that WLOP moves, and the seconds, with those for the radius if it is not given."""
    given, moved = point_set(points), Point_set_3()
    start = perf_counter()
    radius = radius or 8 * compute_average_spacing(given, 6)
    wlop_simplify_and_regularize_point_set(given, moved, 100 * share, radius, 35, False)
    seconds = perf_counter() - start
    return np.array([[point.x(), point.y(), point.z()] for point in moved.points()]), seconds
