"""Time a thousand small clouds, one after another and in a pool of threads: parts of the Dragon, as robots see them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from time import perf_counter

import numpy as np

import gppcs
import report
from clouds import DRAGON, Array
from gppcs.engine.threads import number_of_threads
from same_work import open3d_cloud

COUNT, SIZE, KEPT = 1000, 2000, 256


def samples() -> list[Array]:
    """Return random points of the Dragon, other ones for each cloud."""
    points, rng = gppcs.read(DRAGON).points, np.random.default_rng(0)
    return [points[rng.choice(len(points), SIZE, replace=False)] for _ in range(COUNT)]


def simplified(method: str, points: Array) -> object:
    """Simplify by one of our methods."""
    return gppcs.simplify(points, n_points=KEPT, method=method)


def fpsample(points: Array) -> object:
    """Choose farthest points with the buckets of a k-d tree, of the height that fpsample advises for so few."""
    from fpsample import bucket_fps_kdline_sampling

    return bucket_fps_kdline_sampling(points, KEPT, h=3, start_idx=0)


def open3d(points: Array) -> object:
    """Choose farthest points."""
    return open3d_cloud(points).farthest_point_down_sample(KEPT)


def milliseconds(work: Callable[[Array], object], threads: int, clouds: list[Array]) -> float:
    """Return the wall time for each cloud; the second of two runs, after kernels and packages are loaded."""
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(2):
            start = perf_counter()
            list(map(work, clouds) if threads == 1 else pool.map(work, clouds))
            seconds = perf_counter() - start
    return 1000 * seconds / len(clouds)


def section() -> report.Section:
    """Return the table; gppcs works in the thread that calls it."""
    clouds, most, rows = samples(), number_of_threads(), []
    gppcs.set_threads(1)
    for name, work in {
        "gp": partial(simplified, "gp"),
        "fps": partial(simplified, "fps"),
        "fpsample bucket_fps_kdline_sampling": fpsample,
        "Open3D farthest_point_down_sample": open3d,
    }.items():
        try:
            rows.append([name, *(f"{milliseconds(work, threads, clouds):.2f}" for threads in (1, most))])
        except (ImportError, OSError):  # OSError: a library of the system is missing
            rows.append([name, "not installed", ""])
    gppcs.set_threads(most)
    heading = f"{COUNT:,} clouds of {SIZE:,} points to {KEPT}, milliseconds for each"
    return report.Section(heading, ["method", "one after another", f"in a pool of {most} threads"], rows)
