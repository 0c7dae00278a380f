"""Time reading and writing of a large PLY file with float32 coordinates, without and with colours.

Run `python benchmarks/reading.py [--points N] [--repeats R]`. It prints the least of the times.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

import report
from gppcs.clouds.cloud import PointCloud
from gppcs.io import read, write


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=14_000_000)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()

    rng = np.random.default_rng(0)
    points = rng.random((given.points, 3), dtype=np.float32)
    colours = {name: rng.integers(0, 256, given.points, dtype=np.uint8) for name in ("red", "green", "blue")}
    for label, attributes in (("float32 xyz", {}), ("float32 xyz + uchar rgb", colours)):
        cloud = PointCloud(points, attributes, points.dtype)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "cloud.ply"
            writing = report.least_time(lambda: write(path, cloud, force=True), given.repeats)  # noqa: B023 - used at once
            reading = report.least_time(lambda: read(path), given.repeats)  # noqa: B023
        print(f"{given.points:,} points, {label}: read {reading:.2f} s, write {writing:.2f} s")


if __name__ == "__main__":
    main()
