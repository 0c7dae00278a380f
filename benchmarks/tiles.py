"""The choice of `gp` tile by tile beside that in memory, on ten clouds in 16 tiles or more.

The clouds fit into memory: tiles of fewer points than usual are asked for. Figures are ratios to the choice in memory.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import gppcs
import report
import scans
from clouds import DRAGON, mesh_sample, scene
from gppcs.streaming import beyond_memory
from gppcs.streaming.tiles import Tiling

N_TILES = 16
PREFIXES = 0.75, 0.25, 0.05  # of the kept points
CLOSE = 0.5  # of the median distance to the nearest kept point


@dataclass(frozen=True)
class Trial:
    """A cloud, the fraction of its points to keep, and options."""

    name: str
    make: Callable[[], gppcs.PointCloud]
    ratio: float = 0.05
    options: Mapping[str, Any] = field(default_factory=dict)


def sampled(name: str, millions: float, ratio: float = 0.05, **options: Any) -> Trial:
    """Return a sample scan as a trial."""
    return Trial(name, partial(scans.sample, name, round(1e6 * millions)), ratio, options)


def dragon(millions: float, noise: float) -> Callable[[], gppcs.PointCloud]:
    """Return what makes points on the mesh of the Dragon."""
    return lambda: gppcs.PointCloud(mesh_sample(round(1e6 * millions), noise))


TRIALS = (
    sampled("terrain", 1.0),
    sampled("avenue", 1.0),
    sampled("village", 0.5),
    sampled("forest", 0.5),
    sampled("statue", 0.5),
    sampled("bracket", 0.5),
    sampled("fresco", 0.5, detail="rgb"),
    Trial("Dragon's mesh", dragon(1.0, 0.0), 0.03),
    Trial("Dragon's mesh, noise 1e-4", dragon(1.0, 1e-4)),
    Trial("flat scene of two densities", lambda: gppcs.PointCloud(scene(2_000_000)), 0.02),
)


def tiled(cloud: gppcs.PointCloud, n_points: int, options: Mapping[str, Any]) -> tuple[NDArray[np.intp], Tiling]:
    """Return the choice in tiles, and the tiles."""
    tilings = []

    def noted(survey: beyond_memory.Survey, *arguments: Any, **more: Any) -> Tiling:
        tilings.append(tiling_of(survey, *arguments, **more))
        return tilings[-1]

    tiling_of = beyond_memory.Survey.tiling
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch.object(beyond_memory, "TILE", len(cloud) // N_TILES),
        mock.patch.object(beyond_memory.Survey, "tiling", noted),
        mock.patch.object(gppcs.LocalGP, "memory", return_value=10**12),
    ):
        path = Path(folder, "cloud.ply")
        gppcs.write(path, cloud)
        return gppcs.simplify(path, n_points=n_points, **options).indices, tilings[-1]


def figures(points: NDArray[np.float64], indices: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the mean error, that by area, and the gap that 99.9 % of the points are within, (3,)."""
    result = gppcs.evaluate(points, points[indices])
    return np.array([result.surface_mean, result.surface_mean_by_area, result.covering_p999])


def close_pairs(points: NDArray[np.float64], indices: NDArray[np.intp], tiling: Tiling) -> float:
    """Return the fraction of close points within a spacing of the borders of tiles, over that elsewhere."""
    kept = points[indices]
    distances = cKDTree(kept).query(kept, 2)[0][:, 1]
    spacing = np.median(distances)
    own = tiling.tile_of(kept)
    steps = [sign * spacing * axis for axis in np.eye(3) for sign in (-0.5, 0.5)]
    near = np.any([tiling.tile_of(kept + step) != own for step in steps], axis=0)
    close = distances < CLOSE * spacing
    return close[near].mean() / max(close[~near].mean(), 1e-9)


def compared(trial: Trial) -> list[float]:
    """Return the ratios of a trial."""
    cloud = trial.make()
    n_points = round(trial.ratio * len(cloud))
    in_memory = gppcs.simplify(cloud, n_points=n_points, **trial.options).indices
    in_tiles, tiling = tiled(cloud, n_points, trial.options)
    assert len(in_tiles) == len(np.unique(in_tiles)) == n_points
    points = cloud.points
    ratios = list(figures(points, in_tiles) / figures(points, in_memory))
    for prefix in PREFIXES:
        n = round(prefix * n_points)
        ratios.append((figures(points, in_tiles[:n]) / figures(points, in_memory[:n]))[0])
    return [
        float(len(tiling.tiles)),
        *ratios,
        *(close_pairs(points, indices, tiling) for indices in (in_memory, in_tiles)),
    ]


def main() -> None:
    """Print the table and write it."""
    results = {trial.name: compared(trial) for trial in TRIALS}
    rows = [[name, f"{ratios[0]:.0f}", *(f"{ratio:.3f}" for ratio in ratios[1:])] for name, ratios in results.items()]
    means = np.exp(np.log([ratios[1:7] for ratios in results.values()]).mean(axis=0))
    rows.append(["geometric mean", "", *(f"{mean:.3f}" for mean in means), "", ""])
    header = (
        "cloud", "tiles", "mean error", "by area", "99.9 % gap", *(f"first {prefix:.0%}" for prefix in PREFIXES),
        "close pairs, in memory", "in tiles",
    )  # fmt: skip
    notes = (
        "The first points are judged by their mean error.",
        "Close pairs: kept points nearer to another one than half of the median distance, within half a spacing of a "
        "border, over those elsewhere.",
    )
    report.write_sections("tiles", "Tiles beside memory", [report.Section("", header, rows)], [DRAGON], notes)


if __name__ == "__main__":
    main()
