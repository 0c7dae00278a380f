"""Measure the time and the memory of the methods on the Dragon (437,645 points to 13,129), beside jakteristics.

Times are the least of several runs with compiled kernels. Peak memory is that of a whole process that reads, simplifies
and writes a file. jakteristics computes surface variation and normals.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from multiprocessing import get_context
from pathlib import Path

import jakteristics

import gppcs
import report
from gppcs.engine.threads import number_of_threads
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import paper_radius
from gppcs.surface.surface_variation import features_in_radius

RATIO = 0.03


def peak_memory(path: Path, method: str) -> float:
    """Return the peak memory in GB of a new process that simplifies the file."""
    with get_context("spawn").Pool(1) as pool:
        return pool.apply(_simplify_file, (path, method))


def _simplify_file(path: Path, method: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        gppcs.write(Path(folder) / "out.ply", gppcs.simplify(gppcs.read(path), ratio=RATIO, method=method).cloud)
    # not getrusage: its peak includes that of the parent before the exec
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9


def main() -> None:
    """Print and write the table."""
    path = report.DATA / "dragon.ply"
    cloud = gppcs.read(path)
    points = cloud.points
    radius = paper_radius(points)
    threads = number_of_threads()
    rows = []
    for method in gppcs.METHODS:
        seconds = report.least_time(lambda method=method: gppcs.simplify(cloud, ratio=RATIO, method=method))
        rows.append((f"simplify, {method}", f"{seconds:.3f}", f"{peak_memory(path, method):.2f}"))
    flat = gppcs.sample("bracket", n_points=len(cloud))  # half of its points are exactly flat, and tie
    for method in ("gp", "gp-spectral"):
        seconds = report.least_time(lambda method=method: gppcs.simplify(flat, ratio=RATIO, method=method))
        rows.append((f"simplify, {method}, the sample scan bracket of as many points", f"{seconds:.3f}", ""))
    ours = report.least_time(lambda: features_in_radius(KdTree.build(points), radius))
    theirs = report.least_time(
        lambda: jakteristics.compute_features(
            points, search_radius=radius, num_threads=threads, feature_names=["surface_variation", "nx", "ny", "nz"]
        )
    )
    rows.append(("surface variation and normals, tree included", f"{ours:.3f}", ""))
    rows.append((f"the same by jakteristics, {theirs / ours:.1f} times our seconds", f"{theirs:.3f}", ""))
    rows.append(
        (
            "13,129 farthest points, tree included",
            f"{report.least_time(lambda: farthest_points(points, 13_129)):.3f}",
            "",
        )
    )
    command = Path(sys.executable).with_name("gppcs")
    help_time = report.least_time(lambda: subprocess.run([command, "--help"], capture_output=True, check=True))
    rows.append(("gppcs --help, a whole process", f"{help_time:.3f}", ""))
    report.write(
        "main_job",
        "Dragon, 437,645 points to 13,129",
        ("work", "least seconds of 5", "peak memory of the process, GB"),
        rows,
        [path],
    )


if __name__ == "__main__":
    main()
