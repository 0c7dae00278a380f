"""Rivals of the paper beside the same by CGAL, in one process, on the Dragon; CGAL comes with the extra `cgal`.

Minima of several warm runs, taken in turns; CGAL's times are without the making of its point sets.
"""

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

import gppcs
import report
from gppcs.hierarchical_clustering import clusters_by_variation, hierarchical_clusters
from gppcs.kdtree import KdTree
from gppcs.wlop import nearest_unused, project

RATIO = 0.03
REPEATS = 5
SIZE, VARIATION = 1000, 0.01  # the paper's for the Dragon


def point_set(points: NDArray[np.float64]) -> Point_set_3:
    """Return the points as CGAL's."""
    made = Point_set_3()
    for x, y, z in points.tolist():
        made.insert(Point_3(x, y, z))
    return made


def cgal_clusters(points: NDArray[np.float64]) -> float:
    """Return the seconds of CGAL's hierarchical clustering."""
    given = point_set(points)
    start = perf_counter()
    hierarchy_simplify_point_set(given, SIZE, VARIATION)
    return perf_counter() - start


def cgal_wlop(points: NDArray[np.float64], radius: float) -> float:
    """Return the seconds of CGAL's WLOP."""
    given, moved = point_set(points), Point_set_3()
    start = perf_counter()
    wlop_simplify_and_regularize_point_set(given, moved, 100 * RATIO, radius, 35, False)
    return perf_counter() - start


def our_wlop(points: NDArray[np.float64], n_points: int, radius: float) -> float:
    """Return the seconds of ours, tree and snapping included."""
    start = perf_counter()
    tree = KdTree.build(points)
    first = points[np.random.default_rng(0).permutation(len(points))[:n_points]]
    nearest_unused(project(points, first, radius, tree=tree), tree)
    return perf_counter() - start


def our_clusters(points: NDArray[np.float64], n_points: int | None) -> float:
    """Return the seconds of ours, for an exact number or the limits."""
    start = perf_counter()
    if n_points is None:
        hierarchical_clusters(points, SIZE, VARIATION)
    else:
        clusters_by_variation(points, n_points)
    return perf_counter() - start


def main() -> None:
    """Print and write the table."""
    path = report.DATA / "dragon.ply"
    points = gppcs.read(path).points
    n_points = round(RATIO * len(points))
    radius = 8 * compute_average_spacing(point_set(points), 6)  # CGAL's default
    our_clusters(points, None), our_clusters(points, n_points), our_wlop(points, n_points, radius)
    times = np.array(
        [
            (
                cgal_clusters(points),
                our_clusters(points, None),
                our_clusters(points, n_points),
                cgal_wlop(points, radius),
                our_wlop(points, n_points, radius),
            )
            for _ in range(REPEATS)
        ]
    ).min(axis=0)
    names = (
        f"hc, limits ({SIZE}, {VARIATION}), CGAL",
        f"hc, limits ({SIZE}, {VARIATION}), gppcs",
        f"hc, {n_points:,} points, gppcs",
        f"wlop, {n_points:,} points, CGAL's radius, CGAL",
        f"wlop, {n_points:,} points, CGAL's radius, gppcs, snapped",
    )
    of_cgal = times[[0, 0, 0, 3, 3]]
    rows = [
        (name, f"{seconds:.3f}", f"{base / seconds:.1f}")
        for name, seconds, base in zip(names, times, of_cgal, strict=True)
    ]
    report.write(
        "rivals",
        "Rivals beside CGAL on the Dragon, 437,645 points",
        ("work", f"least seconds of {REPEATS}", "times as fast as CGAL"),
        rows,
        [path],
    )


if __name__ == "__main__":
    main()
