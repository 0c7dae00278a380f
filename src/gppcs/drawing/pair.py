"""Draws the picture of one simplification: the original beside the simplified cloud."""

from __future__ import annotations

from typing import BinaryIO

from gppcs.drawing.camera import Camera
from gppcs.drawing.cloud_images import ColouredCloud, Original, View
from gppcs.drawing.colours import Legend
from gppcs.drawing.viewpoint import GUESSED, Viewpoint
from gppcs.engine.extras import require_matplotlib

WIDTH, HEIGHT = 1600, 800  # pixels
GAP, ABOVE, BELOW = 12, 68, 74  # pixels beside, above and below the panels
MAX_POINT_RADIUS = 5.2  # supersampled pixels


def draw_pair(
    file: BinaryIO,
    title: str,
    original: ColouredCloud,
    simplified: ColouredCloud,
    viewpoint: Viewpoint = GUESSED,
    legend: Legend | None = None,
) -> None:
    """Write a PNG of the original, as a surface, and the simplified cloud, as points in front of a faint original.

    The original sets the camera and the colour scale of both.
    """
    require_matplotlib()
    from matplotlib.figure import Figure

    width, height = (WIDTH - 3 * GAP) // 2, HEIGHT - ABOVE - BELOW
    view = View(Original(original), Camera.towards(original.points, width, (height, height), viewpoint))
    legend = legend or Legend.of_amounts([original.values])
    surface = view.surface(original.colours_by(legend))
    points = view.points(simplified, simplified.colours_by(legend), MAX_POINT_RADIUS)
    n, m = len(original.points), len(simplified.points)
    panels = (surface, "original", f"{n:,} points"), (points, title, f"{m:,} points ({m / n:.1%})")
    figure = Figure(figsize=(WIDTH / 100, HEIGHT / 100), dpi=100, facecolor="white")
    for number, (image, name, counted) in enumerate(panels):
        left = GAP + number * (width + GAP)
        figure.figimage(image, left, BELOW, origin="upper")
        middle = (left + width / 2) / WIDTH
        figure.text(middle, 1 - 34 / HEIGHT, name, ha="center", size=15, weight="bold", color="0.15")
        figure.text(middle, 1 - 58 / HEIGHT, counted, ha="center", size=11.5, color="0.35")
    legend.add_bar(figure, (0.34, 48 / HEIGHT, 0.32, 12 / HEIGHT), 11.5)
    figure.savefig(file, format="png", dpi=100)
