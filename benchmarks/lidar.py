"""LiDAR scans: a sweep of a street and two airborne surveys, thinned by each method.

Run as `python benchmarks/lidar.py`; writes results/lidar.md. Such scans have no mesh, so figures compare the clouds.
"""

from __future__ import annotations

import gppcs
import report

RATIO = 0.03
SCANS = {
    "kitti_000000": "KITTI, one sweep of a street",
    "autzen_airborne": "Autzen, an airborne survey of a stadium",
    "lidr_topography_airborne": "lidR, an airborne survey of a wooded hill",
}
METHODS = (gppcs.LocalGP(), gppcs.LocalGP(feature_weight=0.0), *(name for name in gppcs.METHODS if name != "gp"))
FIGURES = {  # with their factors
    "surface_mean": ("mean distance to the local surface, 1e-4 diagonals", 1e4),
    "surface_max": ("largest, 1e-3 diagonals", 1e3),
    "feature_error": ("feature error, 1e-4 diagonals", 1e4),
    "covering_radius": ("covering radius, 1e-3 diagonals", 1e3),
}


def section(name: str, title: str) -> report.Section:
    """Return the table of one scan."""
    cloud = gppcs.read(report.DATA / f"{name}.ply")
    rows = []
    for entry in gppcs.compare(cloud, METHODS, ratio=RATIO):
        figures = entry.report.figures(relative=True)
        values = [f"{factor * figures[key]:.3g}" for key, (_, factor) in FIGURES.items()]
        rows.append((str(entry.method), *values, f"{entry.seconds:.2f}"))
    return report.Section(
        f"{title}, {len(cloud):,} points",
        ("method", *(heading for heading, _ in FIGURES.values()), "seconds"),
        rows,
    )


def main() -> None:
    """Write the tables."""
    report.write_sections(
        "lidar",
        f"LiDAR scans, ratio {RATIO:g}",
        [section(*scan) for scan in SCANS.items()],
        [report.DATA / f"{name}.ply" for name in SCANS],
        ["One run of each method. These scans helped to tell noise from detail; they decided nothing else."],
    )


if __name__ == "__main__":
    main()
