"""Time the rivals of the paper on the Dragon, in one process with the same methods of CGAL.

Needs the extra `cgal`. Times are the least of several runs with compiled kernels; both sides take turns. CGAL's times
are without the making of its point sets. The programs of PC-Simp and AIVS were not run: the table shows the
seconds that the paper reports for them on an i7-11800H.
"""

from __future__ import annotations

from functools import partial
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

import by_cgal
import gppcs
import report
from gppcs.methods.hc.clustering import hierarchical_clusters
from gppcs.methods.wlop.projection import project
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.queries import nearest_unused

RATIO = 0.03
REPEATS = 5
SIZE, VARIATION = 1000, 0.01  # the paper's for the Dragon
PAPER = {"pc-simp": 245.5, "aivs": 44.6}  # seconds, its Table 1


def our_wlop(points: NDArray[np.float64], n_points: int, radius: float) -> float:
    """Return the seconds of our WLOP, with tree and snapping."""
    start = perf_counter()
    tree = KdTree.build(points)
    first = points[np.random.default_rng(0).permutation(len(points))[:n_points]]
    nearest_unused(project(tree, first, radius), tree)
    return perf_counter() - start


def our_method(points: NDArray[np.float64], n_points: int, name: str) -> float:
    """Return the seconds of one of our methods, with all preparations."""
    start = perf_counter()
    gppcs.simplify(points, n_points=n_points, method=name)
    return perf_counter() - start


def our_clusters(points: NDArray[np.float64], n_points: int | None) -> float:
    """Return the seconds of our hierarchical clustering: for an exact number of points, or by the limits."""
    start = perf_counter()
    if n_points is None:
        hierarchical_clusters(points, SIZE, VARIATION)
    else:
        hierarchical_clusters(points, maximum=n_points)
    return perf_counter() - start


def main() -> None:
    """Print and write the table."""
    path = report.DATA / "dragon.ply"
    points = gppcs.read(path).points
    n_points = round(RATIO * len(points))
    radius = by_cgal.radius_of_wlop(points)
    works = {
        "hc by CGAL": lambda: by_cgal.clusters(points, SIZE, VARIATION),
        f"hc, limits ({SIZE}, {VARIATION})": lambda: our_clusters(points, None),
        f"hc, {n_points:,} points": lambda: our_clusters(points, n_points),
        "wlop by CGAL": lambda: by_cgal.wlop(points, RATIO, radius)[1],
        f"wlop, {n_points:,} points, CGAL's radius, snapped": lambda: our_wlop(points, n_points, radius),
        **{f"{name}, {n_points:,} points": partial(our_method, points, n_points, name) for name in PAPER},
    }
    for name, work in works.items():
        if "CGAL" not in name:
            work()
    seconds = dict(
        zip(works, np.array([[work() for work in works.values()] for _ in range(REPEATS)]).min(axis=0), strict=True)
    )
    rows = []
    for name, ours in seconds.items():
        method = name.split(",")[0]
        if not name.endswith("by CGAL"):
            rival, theirs = (
                ("the paper's figure", PAPER[method]) if method in PAPER else ("CGAL", seconds[f"{method} by CGAL"])
            )
            times = "" if method in PAPER else f"{theirs / ours:.1f}"  # the paper's seconds are of another machine
            rows.append((name, f"{ours:.3f}", rival, f"{theirs:.3f}", times))
    report.write(
        "rivals",
        "Rivals of the paper on the Dragon, 437,645 points",
        ("work", f"least seconds of {REPEATS}", "beside", "its seconds", "times as fast"),
        rows,
        [path],
    )


if __name__ == "__main__":
    main()
