"""Prefixes of rankings as levels of detail: levels by `gp`, by `fps`, at random and by a grid.

The grid is the rule of PDAL's `writers.copc` and of untwine, made again here from their sources; it is not their
program. Points begin in the nodes of the deepest level. From there upwards, each node takes a random one of its
children's points in each cell of a grid: 222 cells along its edge in the first node, 148 in the others. A child with
less than 100 points, and children with less than 1,500 together, give them all. The clouds are small, so these
numbers and the size of nodes are scaled down, until the first levels hold as many points as wanted.

Needs the extra `picture`. It writes the table results/levels.md and the picture docs/levels.png.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import gppcs
import report
from gppcs.drawing.camera import Camera
from gppcs.drawing.cloud_images import ColouredCloud, Original, View
from gppcs.drawing.colours import Legend

CLOUDS = {  # scenes, then objects
    "autzen_airborne": "land from the air",
    "lidr_topography_airborne": "hills from the air",
    "nyu_basement": "room, depth camera",
    "lion_takanawa": "statue, photogrammetry",
    "dragon": "statue, laser",
}
SHARES = {0.01: 2, 0.1: 3}  # of the points, that the levels down to this one hold
FIGURES = {"surface_mean": "mean", "surface_p95": "p95", "feature_error": "features"}
WAYS = ("gp", "fps", "random", "grid")
BOUNDS = {"random": 0.8, "grid": 0.95}  # of the mean error of gp, divided by that of another way
ROOT_CELLS, CELLS = 128 * 3**0.5, 128 * 3**0.5 / 1.5  # of the grid, along the edge of the first node, and of others
FULL, FEW, FEW_TOGETHER = 100_000, 100, 1500  # points of a node, and of children that give them all
DEEPEST = 20  # octree level of the smallest cells
STEPS = 12  # of the search for the scale
PICTURE, DRAWN, LEVELS = Path(__file__).parents[1] / "docs" / "levels.png", ("autzen_airborne", "dragon"), (2, 3)
PANEL, ABOVE, BESIDE = 400, 34, 34  # pixels: width and height of a picture, and its captions
COLOURS = 128  # of its palette, which make the file small
MAX_RADIUS = 5.2  # of a drawn point, in supersampled pixels


def grid_levels(points: NDArray[np.float64], scale: float) -> NDArray[np.int64]:
    """Return the level of each point by PDAL's rule, with nodes that hold `scale` times as many points.

    Shapes: points (N, 3), in random order; returns (N,).
    """
    lower = points.min(axis=0)
    places = (points - lower) / np.ptp(points, axis=0).max()
    smallest = np.minimum(places * 2**DEEPEST, 2**DEEPEST - 1).astype(np.int64)
    level = np.zeros(len(points), np.int64)
    deepest = 0
    left = np.arange(len(points))
    while len(left):  # in nodes that hold too much
        deepest += 1
        level[left] = deepest
        _, node, counts = np.unique(at(smallest[left], deepest), return_inverse=True, return_counts=True)
        left = left[counts[node] > scale * FULL]
    for above in range(deepest - 1, -1, -1):
        pool = np.flatnonzero(level == above + 1)
        _, child, counts = np.unique(at(smallest[pool], above + 1), return_inverse=True, return_counts=True)
        _, node, together = np.unique(at(smallest[pool], above), return_inverse=True, return_counts=True)
        given = (counts[child] < scale * FEW) | (together[node] < scale * FEW_TOGETHER)
        cells = scale**0.5 * (CELLS if above else ROOT_CELLS)
        inside = (np.modf(places[pool] * 2**above)[0] * cells).astype(np.int64)
        key = node
        for axis in range(3):
            key = key * (int(cells) + 1) + inside[:, axis]
        rest = np.flatnonzero(~given)
        taken = rest[np.unique(key[rest], return_index=True)[1]]
        level[pool[given]] = level[pool[taken]] = above
    return level


def at(smallest: NDArray[np.int64], level: int) -> NDArray[np.int64]:
    """Return the number of the node on an octree level around each smallest cell (n, 3)."""
    return (smallest >> DEEPEST - level) @ np.array([1 << 2 * DEEPEST, 1 << DEEPEST, 1])


def by_grid(points: NDArray[np.float64], share: float, last: int) -> NDArray[np.int64]:
    """Return the level of each point, with about a share of the points on the levels down to the last."""
    order = np.random.default_rng(0).permutation(len(points))
    levels = np.empty(len(points), np.int64)
    low, high = 0.0, 1.0
    for _ in range(STEPS):
        scale = (low + high) / 2
        levels[order] = found = grid_levels(points[order], scale)
        low, high = (low, scale) if np.count_nonzero(found <= last) > share * len(points) else (scale, high)
    return levels


class Shown(NamedTuple):
    """A cloud, and which rows are shown on the levels down to each, by the way in which they were chosen."""

    cloud: gppcs.PointCloud
    rows: dict[tuple[float, int], dict[str, NDArray[np.int64]]]

    @classmethod
    def of(cls, name: str) -> Shown:
        """Read a cloud, rank a quarter of its points, and take as many on each level as the grid does."""
        cloud = gppcs.PointCloud(gppcs.read(report.DATA / f"{name}.ply").points)
        n = len(cloud) // 4
        ranking = {way: gppcs.simplify(cloud, n_points=n, method=way).indices for way in WAYS[:-1]}
        rows = {}
        for share, last in SHARES.items():
            grid = by_grid(cloud.points, share, last)
            for level in range(last + 1):
                taken = np.flatnonzero(grid <= level)
                rows[share, level] = {**{way: each[: len(taken)] for way, each in ranking.items()}, "grid": taken}
        return cls(cloud, rows)

    def errors(self, share: float, level: int, way: str) -> dict[str, float]:
        """Return the figures of what is shown, in 1e-4 diagonals."""
        found = gppcs.evaluate(self.cloud, self.cloud.take(self.rows[share, level][way]))
        return {figure: 1e4 * getattr(found, figure) / found.diagonal for figure in FIGURES}


def main() -> None:
    """Write the tables and the picture."""
    bounded: dict[float, list[tuple[str, ...]]] = {share: [] for share in SHARES}
    by_level, panels = [], list[NDArray[np.float64]]()
    for name, kind in CLOUDS.items():
        shown = Shown.of(name)
        for (share, level), rows in shown.rows.items():
            count = f"{len(rows['grid']):,}"
            ways = WAYS if level == SHARES[share] else ("gp", "random", "grid")
            if share == max(SHARES) or level == SHARES[share]:
                errors = {way: shown.errors(share, level, way) for way in ways}
            if share == max(SHARES):
                by_level.append((name, str(level), count, *(
                    f"{errors[way][figure]:.2f}" for figure in FIGURES for way in ("gp", "random", "grid")
                )))  # fmt: skip
            if level == SHARES[share]:
                for figure, title in FIGURES.items():
                    values = {way: errors[way][figure] for way in WAYS}
                    ratios = [f"{values['gp'] / values[way]:.2f}" for way in BOUNDS]
                    numbers = [f"{value:.2f}" for value in values.values()]
                    bounded[share].append((name, kind, count, title, *numbers, *ratios))
        if name in DRAWN:
            panels.append(drawn(shown))
    save(panels)
    header = ("cloud", "kind", "points", "figure", *WAYS, *(f"gp / {way}" for way in BOUNDS))
    sections = [
        report.Section(f"Levels that hold {share:.0%} of the points", header, rows) for share, rows in bounded.items()
    ]
    titles = (f"{title}: {way}" for title in FIGURES.values() for way in ("gp", "random", "grid"))
    sections.append(
        report.Section("Each level of a file whose levels 0 to 3 hold 10% of the points",
                       ("cloud", "down to level", "points", *titles), by_level)
    )  # fmt: skip
    report.write_sections(
        "levels",
        "Prefixes of rankings as levels of detail",
        sections,
        [report.DATA / f"{name}.ply" for name in CLOUDS],
        ["Figures of `gppcs.evaluate`, in 1e-4 diagonals: distance of all points to the local surface of those shown."],
        "`gp`, `fps` and random rank a quarter of the points; a level shows the first of them. The "
        "grid is the rule of PDAL's `writers.copc` and of untwine, made again from their sources, at a smaller scale.",
    )


def drawn(shown: Shown) -> NDArray[np.float64]:
    """Return a picture of a cloud: a row for each level, a column for each way."""
    original = ColouredCloud.by_surface_variation(shown.cloud.points)
    camera = Camera.towards(original.points, PANEL, (PANEL // 2, PANEL))
    view, legend = View(Original(original), camera), Legend.of_amounts([original.values])
    table = []
    for level in LEVELS:
        chosen = shown.rows[max(SHARES), level]
        kept = [ColouredCloud(original.points[chosen[way]], original.values[chosen[way]])
                for way in ("gp", "random", "grid")]  # fmt: skip
        table.append(np.hstack([view.points(each, each.colours_by(legend), MAX_RADIUS) for each in kept]))
    return np.vstack(table)


def save(panels: list[NDArray[np.float64]]) -> None:
    """Write the pictures of the clouds below each other, with the ways above and the levels beside."""
    from matplotlib.figure import Figure

    image = np.vstack(panels)
    height, width = image.shape[0] + ABOVE, image.shape[1] + BESIDE
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
    figure.figimage(image, BESIDE, 0, origin="upper")
    style = {"ha": "center", "size": 14, "weight": "bold", "color": "0.15"}
    for column, title in enumerate(("gp", "random", "grid")):
        figure.text((BESIDE + (column + 0.5) * PANEL) / width, 1 - 24 / height, title, **style)
    below = image.shape[0]
    for row in (len(panel) / len(LEVELS) for panel in panels):
        for level in LEVELS:
            figure.text(24 / width, (below - row / 2) / height, f"level {level}", rotation=90, va="center", **style)
            below -= row
    file = BytesIO()
    figure.savefig(file, format="png", dpi=100)
    Image.open(file).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
