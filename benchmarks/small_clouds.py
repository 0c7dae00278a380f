"""Time small clouds, as robots see them: parts of the Dragon, one after another and in a pool of threads."""

from __future__ import annotations

import sys
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

SIZES = ((1000, 128, 1000), (2000, 256, 1000), (10_000, 1000, 100))  # points, points to keep, number of clouds
LONG, BATCH = 10.0, 100  # Seconds after which no other clouds are taken, and how many are taken at once.
NOTES = (
    "Milliseconds are wall time for each cloud, the mean over so many clouds, or over those of the first 10 seconds, "
    "with compiled kernels. gppcs works in the thread that calls it.",
)


def samples(size: int, count: int) -> list[Array]:
    """Return random points of the Dragon, other ones for each cloud."""
    points, rng = gppcs.read(DRAGON).points, np.random.default_rng(0)
    return [points[rng.choice(len(points), size, replace=False)] for _ in range(count)]


def simplified(method: str, points: Array, kept: int) -> object:
    """Simplify by one of our methods."""
    return gppcs.simplify(points, n_points=kept, method=method)


def fpsample(points: Array, kept: int) -> object:
    """Choose farthest points with the buckets of a k-d tree, of the height that fpsample advises for so few."""
    from fpsample import bucket_fps_kdline_sampling

    return bucket_fps_kdline_sampling(points, kept, h=3, start_idx=0)


def open3d(points: Array, kept: int) -> object:
    """Choose farthest points."""
    return open3d_cloud(points).farthest_point_down_sample(kept)


def milliseconds(work: Callable[[Array], object], threads: int, clouds: list[Array]) -> float:
    """Return the wall time for each cloud, after one that loads kernels and packages."""
    work(clouds[0])
    done, start = 0, perf_counter()
    with ThreadPoolExecutor(threads) as pool:
        for begin in range(0, len(clouds), BATCH):
            batch = clouds[begin : begin + BATCH]
            list(map(work, batch) if threads == 1 else pool.map(work, batch))
            done += len(batch)
            if perf_counter() - start > LONG:
                break
    return 1000 * (perf_counter() - start) / done


def section(size: int, kept: int, count: int) -> report.Section:
    """Return the table of clouds of one size."""
    clouds, most, rows = samples(size, count), number_of_threads(), []
    print(f"{size:,} points to {kept:,}", file=sys.stderr)
    gppcs.set_threads(1)
    for name, work in {
        "gp": partial(simplified, "gp"),
        "fps": partial(simplified, "fps"),
        "fpsample bucket_fps_kdline_sampling": fpsample,
        "Open3D farthest_point_down_sample": open3d,
    }.items():
        keep = partial(work, kept=kept)
        try:
            rows.append([name, *(f"{milliseconds(keep, threads, clouds):.2f}" for threads in (1, most))])
        except (ImportError, OSError):  # OSError: a library of the system is missing
            rows.append([name, "not installed", ""])
    gppcs.set_threads(most)
    header = ["method", "one after another", f"in a pool of {most} threads"]
    return report.Section(f"{count:,} clouds of {size:,} points to {kept:,}, milliseconds for each", header, rows)


def main() -> None:
    """Print the tables and write them."""
    report.write_sections("small_clouds", "Small clouds", [section(*size) for size in SIZES], [DRAGON], NOTES)


if __name__ == "__main__":
    main()
