"""Why not thin by voxels: the sample scan `medallion`, thinned to the same number of points by `voxel` and by `gp`.

Run as `python benchmarks/why_not_voxels.py`; needs the extras `evaluate` and `picture`, no data. It writes the table
results/why_not_voxels.md and the picture docs/why-not-voxels.png, which docs/results.md shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import gppcs
import report
from gppcs.drawing.camera import SUPERSAMPLING, Camera, Viewpoint
from gppcs.drawing.cloud_images import ColouredCloud, Original, View
from gppcs.drawing.colours import Legend
from gppcs.drawing.mesh_images import mesh_images
from gppcs.evaluation.comparison import Entry

PICTURE = Path(__file__).parents[1] / "docs" / "why-not-voxels.png"
POINTS, RATIO = 400_000, 0.03  # the scan of `make demo`
METHODS = (gppcs.Voxel(), gppcs.LocalGP())
ALL = (*METHODS, gppcs.Voxel(keep="mean"), gppcs.FarthestPoint(), gppcs.Random())
MICROMETRES = 1000.0  # the scan is in millimetres
FIGURES = {
    "surface_mean": "mean error",
    "surface_max": "largest error",
    "feature_error": "feature error",
    "covering_radius": "largest gap",
}

VIEW = Viewpoint("z", (-45.0, 75.0))  # the word POINTS stands upright
FOCUS = (23.0, 23.0, 4.0)  # mm, the middle of the close-up
WIDTH = 46.0  # mm, of the close-up
PANEL = (560, 330)  # pixels
GAP, ABOVE = 12, 64  # pixels
MAX_POINT_RADIUS = 7.0  # supersampled pixels


def rows(entries: Sequence[Entry]) -> list[tuple[str, ...]]:
    """Return the figures of two methods in micrometres, and by how much the second differs from the first."""
    first, second = (entry.report.figures() for entry in entries)
    return [
        (
            meaning,
            rounded(MICROMETRES * first[name]),
            rounded(MICROMETRES * second[name]),
            f"{100 * (second[name] / first[name] - 1):+.0f} %",
        )
        for name, meaning in FIGURES.items()
    ]


def rounded(value: float) -> str:
    """Return a number with at least three digits."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def draw(original: gppcs.PointCloud, entries: Sequence[Entry]) -> None:
    """Draw close-ups of the original and of what some methods kept: points above, below the meshes through them.

    Points have the colour of the original's surface variation at their places. The meshes are those of
    `gppcs mesh --keep-points`; that of the original has a quarter of its points.
    """
    everything = ColouredCloud.by_surface_variation(original.points)
    whole = Camera.towards(original.points, PANEL[0], (PANEL[1], PANEL[1]), VIEW)
    shape = (SUPERSAMPLING * PANEL[0], SUPERSAMPLING * PANEL[1])
    scale = shape[0] / WIDTH
    camera = Camera(whole.axes, whole.axes[:2] @ np.array(FOCUS), scale, shape, scale / whole.scale)
    view = View(Original(everything), camera)
    shades = Legend.of_amounts([everything.values])
    titles, above = [f"original: {len(original):,} points"], [view.surface(shades.colours_of(everything.values))]
    for entry in entries:
        values = everything.values[entry.result.indices]
        kept = ColouredCloud(entry.result.cloud.points, values)
        titles.append(f"{entry.method.name}: {len(values):,} points")
        above.append(view.points(kept, shades.colours_of(values), MAX_POINT_RADIUS))
    meshes = [gppcs.mesh(original, ratio=0.25), *(gppcs.mesh(original, keep=entry.result.indices) for entry in entries)]
    compose(titles, [above, [mesh_images(result.mesh, [camera])[0] for result in meshes]])


def compose(titles: Sequence[str], images: Sequence[Sequence[NDArray[np.float64]]]) -> None:
    """Write rows of panels under their titles to `PICTURE`."""
    width = len(titles) * (PANEL[0] + GAP) + GAP
    height = len(images) * (PANEL[1] + GAP) + ABOVE
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
    for column, title in enumerate(titles):
        left = GAP + column * (PANEL[0] + GAP)
        middle = (left + PANEL[0] / 2) / width
        figure.text(middle, 1 - 0.5 * ABOVE / height, title, ha="center", va="center", size=22, weight="bold")
        for row, line in enumerate(images):
            figure.figimage(line[column], left, height - ABOVE - (row + 1) * PANEL[1] - row * GAP, origin="upper")
    figure.savefig(PICTURE, dpi=100)


def main() -> None:
    """Thin, measure, draw, and write the table."""
    original = gppcs.sample("medallion", n_points=POINTS)
    entries = gppcs.compare(original, ALL, ratio=RATIO)
    draw(original, entries[: len(METHODS)])
    kept = len(entries[0].result.indices)
    relative = [entry.report.figures(relative=True) for entry in entries]
    report.write_sections(
        "why_not_voxels",
        f"Why not by voxels: {kept:,} of {POINTS:,} points of the medallion",
        [
            report.Section(
                "Voxels and gp",
                ("micrometres, on a medallion of 100 mm", "voxel", "gp", "change"),
                rows(entries[: len(METHODS)]),
            ),
            report.Section(
                "Other ways to thin, in 1e-4 diagonals",
                ("method", *(name.replace("_", " ") for name in FIGURES)),
                [
                    (str(entry.method), *(f"{1e4 * figures[name]:.3g}" for name in FIGURES))
                    for entry, figures in zip(entries, relative, strict=True)
                ],
            ),
        ],
        notes=[
            "The scan is that of `make demo`. Figures are by gppcs.evaluate.",
            "error: distance from an original point to the local surface of the kept points (surface mean, surface "
            "max). feature error: mean of the error times the angle, in radians, between the normals. largest distance "
            "to a kept point: covering radius. docs/evaluation.md defines each of them.",
        ],
    )


if __name__ == "__main__":
    main()
