"""What a viewer shows of a COPC file at its levels: levels by `gp`, by `fps`, at random and by a grid.

The grid is made here by the rule of PDAL's `writers.copc` and of untwine: each level halves the edge of its cells, and
takes one point, here a random one, for each cell in which no coarser level has any. It is not their program.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import gppcs
import report
from gppcs.io.copc_writing import ranked_of

CLOUDS = {  # scenes, then objects
    "autzen_airborne": "land from the air",
    "lidr_topography_airborne": "hills from the air",
    "nyu_basement": "room, depth camera",
    "lion_takanawa": "statue, photogrammetry",
    "dragon": "statue, laser",
}
SHARES = (0.01, 0.1)
FIGURES = {"surface_mean": "mean", "surface_p95": "p95", "feature_error": "features"}
HALVINGS = 3  # levels above the one that is shown
STEPS = 20  # of the search for the edge with which so many points are shown


def grid_level(points: NDArray[np.float64], edge: float) -> NDArray[np.int64]:
    """Return the rows down to the level with an edge: one of each cell of all coarser levels, then of this one.

    Shapes: points (N, 3), in random order; returns (M,).
    """
    shown = np.zeros(len(points), np.bool_)
    for halvings in range(HALVINGS, -1, -1):
        cells = np.floor((points - points.min(axis=0)) / (edge * 2**halvings)).astype(np.int64)
        _, cell = np.unique(cells, axis=0, return_inverse=True)
        cell = cell.ravel()
        free = np.ones(cell.max() + 1, np.bool_)
        free[cell[shown]] = False
        left = np.flatnonzero(free[cell])
        shown[left[np.unique(cell[left], return_index=True)[1]]] = True
    return np.flatnonzero(shown)


def by_grid(points: NDArray[np.float64], share: float) -> NDArray[np.int64]:
    """Return the rows of the level of a grid that holds about a share of the points."""
    order = np.random.default_rng(0).permutation(len(points))
    shuffled = points[order]
    low, high = 0.0, float(np.ptp(points, axis=0).max())
    for _ in range(STEPS):
        edge = (low + high) / 2
        rows = grid_level(shuffled, edge)
        low, high = (edge, high) if len(rows) > share * len(points) else (low, edge)
    return order[rows]


def main() -> None:
    """Write the table."""
    sections = []
    for share in SHARES:
        rows = []
        for name, kind in CLOUDS.items():
            cloud = gppcs.PointCloud(gppcs.read(report.DATA / f"{name}.ply").points)
            grid = by_grid(cloud.points, share)
            shown = {
                method: gppcs.simplify(cloud, n_points=ranked_of(len(cloud)), method=method).cloud[: len(grid)]
                for method in ("gp", "fps", "random")
            }
            found = {by: gppcs.evaluate(cloud, some) for by, some in {**shown, "grid": cloud.take(grid)}.items()}
            for figure, title in FIGURES.items():
                values = {by: 1e4 * getattr(each, figure) / each.diagonal for by, each in found.items()}
                ratios = [f"{values['gp'] / values[by]:.2f}" for by in ("random", "grid")]
                rows.append(
                    (name, kind, f"{len(grid):,}", title, *(f"{value:.2f}" for value in values.values()), *ratios)
                )
        title = f"Levels that hold {share:.0%} of the points"
        sections.append(
            report.Section(
                title,
                ("cloud", "kind", "points", "figure", "gp", "fps", "random", "grid", "gp / random", "gp / grid"),
                rows,
            )
        )
    report.write_sections(
        "levels",
        "What a viewer shows of a COPC file at its levels",
        sections,
        [report.DATA / f"{name}.ply" for name in CLOUDS],
        ("Figures of `gppcs.evaluate`, in 1e-4 diagonals: distance to the local surface of those shown.",),
        "`gp`, `fps` and random rank a quarter of the points, as in a COPC file; a level shows the first of them.",
    )


if __name__ == "__main__":
    main()
