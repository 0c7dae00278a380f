"""The picture of `modelnet.py`: an airplane, a glass and a toilet at two ratios, as the paper shows them.

The shapes are procedural, of the kinds that the learned methods were trained on, but training did not see them. The
terms of the ModelNet shapes do not say whether pictures of them may be passed on.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "learned"))

import gppcs
import training_set
from gppcs.drawing.camera import Camera, Viewpoint
from gppcs.drawing.cloud_images import ColouredCloud, Original, View
from gppcs_learned import APES, APESGlobal, Potamias

METHODS: tuple[str | gppcs.Method, ...] = ("gp", "gp-spectral", APES(), APESGlobal(), Potamias())
SHAPES = {  # kind of the training set, and from where it is seen
    "airplane": ("aircraft", Viewpoint("z", (35.0, 40.0))),
    "glass": ("glasses", Viewpoint("z", (0.0, 15.0))),
    "toilet": ("toilets", Viewpoint("z", (35.0, 25.0))),
}
UNSEEN = 10_000  # number of a shape that training did not see
POINTS, DENSE = 2048, 200_000  # of a cloud; of the grey surface behind it
WIDE, HIGH = 250, (130, 230)  # pixels of a panel; its least and greatest height
LEFT, ABOVE, GAP = 110, 40, 10  # pixels
GREY, MAX_POINT_RADIUS, COLOURS = 0.1, 3.2, 32  # of points; in supersampled pixels; of the palette

Images = list[NDArray[np.float64]]


class Row(NamedTuple):
    """A row of the picture: its title, and a panel for each method."""

    title: str
    images: Images


def draw(path: Path, ratios: Sequence[float]) -> None:
    """Write the picture: a row for each shape and ratio, a column for each method."""
    rows = [row for shape in SHAPES for row in rows_of(shape, ratios)]
    width = LEFT + len(METHODS) * (WIDE + GAP)
    height = ABOVE + sum(len(row.images[0]) + GAP for row in rows)
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
    lefts, bottom = [LEFT + column * (WIDE + GAP) for column in range(len(METHODS))], height - ABOVE
    for method, left in zip(METHODS, lefts, strict=True):
        figure.text(
            (left + WIDE / 2) / width, (bottom + 0.5 * ABOVE) / height, str(method), ha="center", va="center", size=15
        )
    for row in rows:
        bottom -= len(row.images[0]) + GAP
        figure.text(GAP / width, (bottom + len(row.images[0]) / 2) / height, row.title, va="center", size=13)
        for image, left in zip(row.images, lefts, strict=True):
            figure.figimage(image, left, bottom, origin="upper")
    whole = BytesIO()
    figure.savefig(whole, dpi=100)
    small = Image.open(whole).convert("RGB")
    small.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


def rows_of(shape: str, ratios: Sequence[float]) -> list[Row]:
    """Return the rows of a shape, one for each ratio."""
    name, viewpoint = SHAPES[shape]
    kind = list(training_set.KINDS).index(name)
    dense, _ = training_set.draw(kind, UNSEEN, DENSE, upright=True)
    view = View(Original(ColouredCloud(dense, np.zeros(DENSE))), Camera.towards(dense, WIDE, HIGH, viewpoint))
    return [
        Row(f"{shape}\nratio {ratio}", [panel(view, dense[:POINTS], ratio, method) for method in METHODS])
        for ratio in ratios
    ]


def panel(view: View, cloud: NDArray[np.float64], ratio: float, method: str | gppcs.Method) -> NDArray[np.float64]:
    """Return the picture of the points that a method keeps, on the visible side of the surface."""
    kept = gppcs.simplify(cloud, ratio=ratio, method=method).cloud.points
    return view.points(ColouredCloud(kept, np.zeros(len(kept))), np.full(kept.shape, GREY), MAX_POINT_RADIUS)
