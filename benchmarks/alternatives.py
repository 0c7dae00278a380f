"""What people use to thin a cloud, beside gp: the same number of points, one evaluation, seconds.

Needs `pip install open3d pymeshlab` and CloudCompare's command; the table leaves out what is not installed.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from shutil import which
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

import gppcs
import report

POINTS, RATIO = 400_000, 0.03
REPEATS = 3
STEPS = 20  # halvings of the interval of a distance that yields the number of points
LONG = 15.0  # no more repeats after so many seconds

Array = NDArray[np.float64]
Thin = Callable[[float], Array]  # by a distance, or by the number of points


def for_count(thin: Thin, n_points: int, diagonal: float) -> float:
    """Return the smallest distance that keeps at most a number of points."""
    lower, upper = 0.0, diagonal / 10
    for _ in range(STEPS):
        middle = (lower + upper) / 2
        count = len(thin(middle))
        if 0.999 * n_points <= count <= n_points:
            return middle
        lower, upper = (middle, upper) if count > n_points else (lower, middle)
    return upper


def open3d_voxel(points: Array) -> Thin:
    """Return Open3D's grid, which averages the points of a cell."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    return lambda size: np.asarray(cloud.voxel_down_sample(size).points)


def open3d_farthest(points: Array) -> Thin:
    """Return Open3D's farthest points."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    return lambda n_points: np.asarray(cloud.farthest_point_down_sample(int(n_points)).points)


def meshlab_poisson_disk(points: Array) -> Thin:
    """Return MeshLab's choice of points by Poisson disks of a radius."""
    import pymeshlab

    def thin(radius: float) -> Array:
        meshes = pymeshlab.MeshSet(verbose=False)
        meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points))
        # its own option for an exact number yields up to 1.7 times as many
        meshes.apply_filter("generate_simplified_point_cloud", radius=pymeshlab.PureValue(radius))
        return np.asarray(meshes.current_mesh().vertex_matrix())

    return thin


def cloudcompare_spatial(points: Array) -> Thin:
    """Return CloudCompare's points with a least distance; its command reads and writes a file."""

    def thin(distance: float) -> Array:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "cloud.ply"
            gppcs.write(path, gppcs.PointCloud(points))
            words = ["-SILENT", "-AUTO_SAVE", "OFF", "-C_EXPORT_FMT", "PLY", "-NO_TIMESTAMP"]
            words += ["-O", path, "-SS", "SPATIAL", str(distance), "-SAVE_CLOUDS", "FILE", Path(folder) / "out.ply"]
            environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
            subprocess.run(["CloudCompare", *words], check=True, capture_output=True, env=environment)
            return gppcs.read(Path(folder) / "out.ply").points

    return thin


def ours(method: str) -> Callable[[Array], Thin]:
    """Return what makes a method of gppcs ready for a cloud."""
    return lambda points: lambda n_points: gppcs.simplify(points, n_points=int(n_points), method=method).cloud.points


TOOLS: dict[str, tuple[Callable[[Array], Thin], bool]] = {  # label: what prepares it, whether it takes a distance
    "gppcs": (ours("gp"), False),
    "gppcs, farthest points": (ours("fps"), False),
}
if find_spec("open3d"):
    TOOLS["Open3D, voxel grid"] = (open3d_voxel, True)
    TOOLS["Open3D, farthest points"] = (open3d_farthest, False)
if which("CloudCompare"):
    TOOLS["CloudCompare, minimum distance"] = (cloudcompare_spatial, True)
if find_spec("pymeshlab"):
    TOOLS["MeshLab, Poisson disks"] = (meshlab_poisson_disk, True)


def least_seconds(work: Callable[[], Array]) -> float:
    """Return the least time of some runs."""
    times: list[float] = []
    while len(times) < REPEATS and sum(times) < LONG:
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def section(heading: str, cloud: gppcs.PointCloud, n_points: int) -> report.Section:
    """Return the table of a cloud, errors in percent of the diagonal and beside that of gp."""
    points = cloud.points
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    rows, of_gp = [], 0.0
    for label, (prepare, by_distance) in TOOLS.items():
        thin = prepare(points)
        argument = for_count(thin, n_points, diagonal) if by_distance else float(n_points)
        kept = thin(argument)
        seconds = least_seconds(lambda thin=thin, argument=argument: thin(argument))
        figures = gppcs.evaluate(cloud, kept).figures()
        error, gap = figures["surface_mean"] / diagonal, figures["covering_radius"] / diagonal
        of_gp = of_gp or error
        change = f"{100 * (error / of_gp - 1):+.0f} %" if rows else ""
        rows.append((label, f"{len(kept):,}", f"{100 * error:.4f} %", change, f"{100 * gap:.2f} %", f"{seconds:.2g}"))
    header = ("tool", "points kept", "mean error", "more than gppcs", "largest gap", "seconds")
    return report.Section(heading, header, rows)


def main() -> None:
    """Print and write the tables."""
    path = report.DATA / "dragon.ply"
    medallion, dragon = gppcs.sample("medallion", n_points=POINTS), gppcs.read(path)
    sections = [
        section(f"{label}, {len(cloud):,} points", cloud, round(RATIO * len(cloud)))
        for label, cloud in (("The sample scan medallion", medallion), ("Dragon", dragon))
    ]
    notes = (
        "mean error: mean distance from an original point to the local surface of the kept points; largest gap: "
        "largest distance from an original point to a kept one. Both in percent of the diagonal, by gppcs.evaluate.",
        f"Each tool keeps as near to the same number of points as its setting allows. Seconds: the least of {REPEATS} "
        "runs with compiled kernels, without reading and writing but for CloudCompare, which reads and writes a file.",
        "A voxel grid of Open3D moves the points: it averages those of a cell.",
    )
    report.write_sections("alternatives", "What people use to thin a cloud, beside gp", sections, [path], notes)


if __name__ == "__main__":
    main()
