"""Draws the picture of a comparison: a row of clouds, and below it one of the meshes rebuilt from them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from gppcs.drawing.camera import GUESSED, SUPERSAMPLING, Camera, Viewpoint
from gppcs.drawing.cloud_images import ColouredCloud, Original, View
from gppcs.drawing.colours import Legend
from gppcs.drawing.mesh_images import mesh_images
from gppcs.drawing.web.layers import Named
from gppcs.engine.arrays import Floats
from gppcs.engine.extras import require_matplotlib

GAP, BETWEEN = 28, 8  # pixels between columns, and between a panel and its close-ups
TITLE, TEXT, BAR = 32, 25, 120  # pixels: letters of titles, letters of other text, height for the colour bar
POINT = 0.72  # typographic points, the unit of matplotlib for letters and lines, in a pixel
CLOSE_UPS = 2

Square = tuple[int, int, int]  # column and row of the upper left corner, and side, in supersampled pixels


@dataclass(frozen=True)
class Column:
    """One column of the picture: a cloud and its mesh, or that in its place, in the colours of points."""

    named: Named
    cloud: ColouredCloud
    caption: str = ""


def draw_comparison(
    file: BinaryIO,
    columns: Sequence[Column],
    viewpoint: Viewpoint = GUESSED,
    legend: Legend | None = None,
    close_ups: int = CLOSE_UPS,
) -> None:
    """Write a PNG of clouds and, below each, its mesh if any column has one, with the same camera and colour scale.

    The first column is the original: a closed surface, which sets the camera and hides points on its far side.
    Close-ups show the squares in which its mean surface variation is largest.
    """
    require_matplotlib()
    with_meshes = any(column.named.mesh and not column.named.is_mesh for column in columns)
    legend = legend or Legend.of_amounts([column.cloud.values for column in columns])
    per_row = math.ceil(len(columns) / math.ceil(len(columns) / 6))  # at most six
    width = min(560 if close_ups else 776, (2400 - GAP) // per_row - GAP)  # pixels
    views, squares = _views(Original.with_relief(columns[0].cloud), width, viewpoint, close_ups)
    cameras = [view.camera for view in views]
    sheet = _Sheet(columns, per_row, [camera.size for camera in cameras], squares, with_meshes, bool(legend.scale))
    for number, column in enumerate(columns):
        cloud, colours = column.cloud, column.cloud.colours_by(legend)
        sheet.write(number, column)
        mesh = column.named.mesh
        if mesh and column.named.is_mesh:
            sheet.add(number, 0, mesh_images(mesh, cameras, cloud.at(mesh.vertices).colours_by(legend)))
            continue
        drawn = [view.points(cloud, colours, 6.5) if number else view.surface(colours) for view in views]
        sheet.add(number, 0, drawn)
        if mesh:
            sheet.add(number, 1, mesh_images(mesh, cameras))
    bar_width = min(0.5, 600 / sheet.width)
    box = (0.5 - bar_width / 2.0, 80 / sheet.height, bar_width, 16 / sheet.height)
    legend.add_bar(sheet.figure, box, POINT * TEXT)
    sheet.figure.savefig(file, format="png", dpi=100)


def _views(original: Original, width: int, viewpoint: Viewpoint, close_ups: int) -> tuple[list[View], list[Square]]:
    """Return the view of the whole original, those of its close-ups, and the squares that the close-ups show."""
    heights = int(0.6 * width), int(1.3 * width)
    overview = View(original, Camera.towards(original.cloud.points, width, heights, viewpoint))
    squares = feature_squares(overview.values(), round(0.18 * max(overview.camera.shape)), close_ups)
    size = (width - BETWEEN * (CLOSE_UPS - 1)) // CLOSE_UPS
    return [overview, *(View(original, overview.camera.close_up(square, size)) for square in squares)], squares


def feature_squares(variation: Floats, side: int, count: int) -> list[Square]:
    """Return the squares of a picture in which the mean of a quantity is largest, at a distance from each other."""
    # The sum over a square, from cumulative sums at its corners.
    corner = np.pad(variation.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    sums = corner[side:, side:] - corner[:-side, side:] - corner[side:, :-side] + corner[:-side, :-side]
    squares: list[Square] = []
    featureless = 1e-3 * sums.max()
    while len(squares) < count:
        row, column = np.unravel_index(sums.argmax(), sums.shape)
        if sums[row, column] <= featureless:
            break
        squares.append((int(column), int(row), side))
        near = math.ceil(1.5 * side)  # the smallest distance of two corners along one axis
        sums[max(row - near, 0) : row + near, max(column - near, 0) : column + near] = 0.0
    return squares


class _Sheet:
    """A matplotlib figure with columns of panels and their close-ups. Positions are in pixels from the upper left."""

    def __init__(
        self,
        columns: Sequence[Column],
        per_row: int,
        sizes: list[tuple[int, int]],
        squares: list[Square],
        meshes: bool,
        has_bar: bool,
    ) -> None:
        from matplotlib.figure import Figure

        self.squares, self.panel, self.with_meshes = squares, sizes[0], meshes
        panel_height = sum(height + BETWEEN for _, height in sizes[:2])  # close-ups stand side by side
        self.tops = [3 * TITLE + row * (panel_height + BETWEEN) for row in range(3 if meshes else 2)]
        lines = max(column.caption.count("\n") + 1 for column in columns)
        row_height = self.tops[-1] + round(1.35 * TEXT * lines) + GAP
        cells = [divmod(number, per_row) for number in range(len(columns))]
        self.corners = [(GAP + column * (self.panel[0] + GAP), row * row_height) for row, column in cells]
        self.width = GAP + per_row * (self.panel[0] + GAP)
        self.height = (cells[-1][0] + 1) * row_height + (BAR if has_bar else GAP)
        self.figure = Figure(figsize=(self.width / 100, self.height / 100), dpi=100, facecolor="white")

    def write(self, number: int, column: Column) -> None:
        """Write the title, the size and the caption of a column, and "no mesh" in place of one."""
        self._text(number, round(1.6 * TITLE), column.named.name, TITLE, color="0.1", weight="bold")
        self._text(number, round(1.6 * TITLE + 1.4 * TEXT), column.named.size_text, TEXT, color="0.35")
        for line, text in enumerate(column.caption.split("\n")):
            self._text(number, self.tops[-1] + round((0.9 + 1.35 * line) * TEXT), text, TEXT, color="0.1")
        if self.with_meshes and not column.named.mesh:
            self._text(number, self.tops[1] + self.panel[1] // 2, "no mesh", TEXT, color="0.5", style="italic")

    def _text(self, number: int, below: int, text: str, size: float, **style: Any) -> None:
        left, top = self.corners[number]
        size = min(size, self.panel[0] / (0.66 * max(len(text), 1)))  # the mean width of a letter is 0.66 of its size
        x, y = (left + self.panel[0] / 2) / self.width, 1.0 - (top + below) / self.height
        self.figure.text(x, y, text, ha="center", size=POINT * size, **style)

    def add(self, number: int, row: int, images: list[Floats]) -> None:
        """Add a panel and its close-ups: of a cloud in row 0, of a mesh in row 1."""
        left, top = self.corners[number]
        top += self.tops[row]
        for rank, (image, square) in enumerate(zip(images[1:], self.squares, strict=True)):
            size, colour = image.shape[0], ((0.82, 0.29, 0.36), (0.91, 0.53, 0.12))[rank]
            column, line, side = (length // SUPERSAMPLING for length in square)
            _draw_frame(images[0], column, line, side, colour)
            _draw_frame(image, 0, 0, size, colour)
            self._image(left + rank * (size + BETWEEN), top + images[0].shape[0] + BETWEEN, image)
        self._image(left, top, images[0])

    def _image(self, left: int, top: int, image: Floats) -> None:
        self.figure.figimage(image, left, self.height - top - image.shape[0], origin="upper")


def _draw_frame(image: Floats, left: int, top: int, side: int, colour: tuple[float, float, float]) -> None:
    """Draw the frame of a square, three pixels wide, into a picture."""
    inner = image[top + 3 : top + side - 3, left + 3 : left + side - 3].copy()
    image[top : top + side, left : left + side] = colour
    image[top + 3 : top + side - 3, left + 3 : left + side - 3] = inner
