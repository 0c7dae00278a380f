"""Weighted Poisson-disk resampling (Jiao, Lv et al., AAAI 2025) beside `gp` and others, on a room of its authors.

The points that the authors published of the room stand beside ours, at their number. Their program is WPD of
github.com/vvvwo/Weighted-Poisson-disk-Resampling (MIT licence; C++ for Windows, with PCL and VCG). If it is installed,
it also runs here, on the room and on the Dragon. It takes a folder of PLY files, a folder for its results, and a number
of points. It moves the points.
"""

from __future__ import annotations

import subprocess
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

import data
import gppcs
import report

PROGRAM = "WPD"
METHODS = ("gp", "sample-elimination", "fps", "random")
RATIO = 0.03
FIGURES = {  # name: title, factor; lengths in diagonals
    "surface_mean": ("mean distance to the local surface, 1e-4 diagonals", 1e4),
    "covering_radius": ("covering radius, 1e-3 diagonals", 1e3),
    "feature_error": ("feature error, 1e-5 diagonals", 1e5),
    "mean_surface_variation": ("mean surface variation", 1.0),
}


def resampled(cloud: gppcs.PointCloud, n_points: int) -> gppcs.PointCloud:
    """Return the points that the authors' program makes of a cloud."""
    with TemporaryDirectory() as folder:
        before, after = Path(folder, "in"), Path(folder, "out")
        before.mkdir()
        after.mkdir()
        gppcs.write(before / "cloud.ply", gppcs.PointCloud(cloud.points))
        subprocess.run([PROGRAM, f"{before}/", f"{after}/", str(n_points)], check=True)
        return gppcs.read(after / "cloud.ply")


def section(name: str, cloud: gppcs.PointCloud, n_points: int, published: gppcs.PointCloud | None) -> report.Section:
    """Return the table of a cloud."""
    made = {} if published is None else {"weighted Poisson disks, published": published}
    if which(PROGRAM):
        made["weighted Poisson disks, run here"] = resampled(cloud, n_points)
    made |= {method: gppcs.simplify(cloud, n_points=n_points, method=method).cloud for method in METHODS}
    rows = []
    for label, kept in made.items():
        figures = gppcs.evaluate(cloud, kept)
        values = figures.values_in(figures.diagonal)
        rows.append((label, f"{len(kept):,}", *(f"{factor * values[of]:.3g}" for of, (_, factor) in FIGURES.items())))
    header = ("method", "points", *(title for title, _ in FIGURES.values()))
    return report.Section(f"{name}, {len(cloud):,} points", header, rows)


def main() -> None:
    """Print and write the tables."""
    paths = [data.path_of(file.name) for file in data.OF_WEIGHTED_POISSON]
    room, published = (gppcs.read(path) for path in paths)
    sections = [section("The authors' conference room", room, len(published), published)]
    if which(PROGRAM):
        paths.append(data.path_of("dragon"))
        dragon = gppcs.read(paths[-1])
        sections.append(section("Dragon", dragon, round(RATIO * len(dragon)), None))
    report.write_sections("weighted_poisson", "Weighted Poisson-disk resampling beside gp", sections, paths)


if __name__ == "__main__":
    main()
