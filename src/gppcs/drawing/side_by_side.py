"""Draws the picture of a comparison: a row of clouds above a row of the meshes rebuilt from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.mesh import Mesh
from gppcs.drawing.camera import SUPERSAMPLING, Camera, Square
from gppcs.drawing.close_ups import feature_squares
from gppcs.drawing.cloud_images import ColouredCloud, Original, View
from gppcs.drawing.mesh_images import mesh_images
from gppcs.drawing.paint import SURFACE_VARIATION, Legend
from gppcs.drawing.viewpoint import GUESSED, Viewpoint
from gppcs.engine.extras import require_matplotlib, require_pyvista
from gppcs.errors import ParameterError

Array = NDArray[np.float64]

MAX_WIDTH, MAX_COLUMNS, MAX_COLUMN_WIDTH = 2400, 6, 560  # pixels, columns in a row, pixels
FLATTEST, TALLEST = 0.6, 1.3  # height of a panel, divided by its width
GAP, BETWEEN = 28, 8  # pixels between columns, and between a panel and its close-ups
TITLE, TEXT, BAR = 32, 25, 120  # pixels: letters of titles, letters of other text, height for the colour bar
LETTER = 0.66  # mean width of a letter, divided by its size
MAX_POINT_RADIUS = 6.5  # supersampled pixels
CLOSE_UPS = 2
CLOSE_UP_SHARE = 0.18  # edge length of a close-up's square, divided by the longer edge of the panel
FRAMES, FRAME_WIDTH = ("#d1495b", "#e8871e"), 3


@dataclass(frozen=True)
class Column:
    """One column of the picture: a cloud and the mesh rebuilt from it."""

    title: str
    points: Array
    surface_variation: Array
    caption: str
    mesh: Mesh | None
    counted: Literal["points", "vertices"] = "points"
    colours: Array | None = None


def draw_comparison(
    file: BinaryIO, columns: Sequence[Column], viewpoint: Viewpoint = GUESSED, legend: Legend | None = None
) -> None:
    """Write a PNG of clouds and, below each, its mesh, with the same camera and colour scale.

    The first column is the original. It is drawn as a closed surface, sets the camera, and hides points of the others
    on its far side. Below each cloud and mesh are close-ups of two squares, in which the original's mean surface
    variation is largest. If no column has a mesh, only clouds are drawn.
    """
    if not columns:
        raise ParameterError("expected at least one column to draw, found none; pass the original first")
    with_meshes = any(column.mesh for column in columns)
    require_matplotlib()
    if with_meshes:
        require_pyvista()
    clouds = [ColouredCloud(each.points, each.surface_variation, colours=each.colours) for each in columns]
    legend = legend or Legend.of_amounts(SURFACE_VARIATION, [cloud.values for cloud in clouds], root=True)
    per_row = math.ceil(len(columns) / math.ceil(len(columns) / MAX_COLUMNS))
    width = min(MAX_COLUMN_WIDTH, (MAX_WIDTH - GAP) // per_row - GAP)
    views, squares = _views(Original(clouds[0]), width, viewpoint)
    cameras = [view.camera for view in views]
    sheet = _Sheet(columns, per_row, [camera.size for camera in cameras], squares, with_meshes)
    for number, (column, cloud) in enumerate(zip(columns, clouds, strict=True)):
        colours = legend.colours_of(cloud)
        sheet.write(number, column)
        sheet.place(
            number,
            0,
            [view.surface(colours) if number == 0 else view.points(cloud, colours, MAX_POINT_RADIUS) for view in views],
        )
        if column.mesh:
            sheet.place(number, 1, mesh_images(column.mesh, cameras))
        elif with_meshes:
            sheet.leave_empty(number, "no mesh")
    bar_width = min(0.5, 600 / sheet.width)
    place = (0.5 - bar_width / 2.0, 80 / sheet.height, bar_width, 16 / sheet.height)
    legend.add_bar(sheet.figure, place, _points(TEXT))
    sheet.figure.savefig(file, format="png", dpi=100)


def _views(original: Original, width: int, viewpoint: Viewpoint) -> tuple[list[View], list[Square]]:
    """Return the view of the whole original, those of its close-ups, and the squares that the close-ups show."""
    heights = int(FLATTEST * width), int(TALLEST * width)
    camera = Camera.towards(original.cloud.points, width, heights, viewpoint)
    whole = View(original, camera)
    squares = feature_squares(whole.values(), round(CLOSE_UP_SHARE * max(camera.shape)), CLOSE_UPS)
    size = (width - BETWEEN * (CLOSE_UPS - 1)) // CLOSE_UPS
    return [whole, *(View(original, camera.close_up(square, size)) for square in squares)], squares


class _Sheet:
    """A matplotlib figure with columns of panels and their close-ups. Places are in pixels from the upper left."""

    def __init__(
        self,
        columns: Sequence[Column],
        per_row: int,
        sizes: list[tuple[int, int]],
        squares: list[Square],
        with_meshes: bool,
    ) -> None:
        from matplotlib.figure import Figure

        self.per_row, self.sizes, self.squares = per_row, sizes, squares
        self.panel_height = sum(height + BETWEEN for _, height in sizes[:2])  # close-ups stand side by side
        self.foot = self._panel_top(2 if with_meshes else 1)
        lines = max(column.caption.count("\n") + 1 for column in columns)
        self.row_height = self.foot + round(1.35 * TEXT * lines) + GAP
        self.width = GAP + per_row * (sizes[0][0] + GAP)
        self.height = math.ceil(len(columns) / per_row) * self.row_height + BAR
        self.figure = Figure(figsize=(self.width / 100, self.height / 100), dpi=100, facecolor="white")

    def corner(self, number: int) -> tuple[int, int]:
        """Return the left and top of a column, given its number."""
        row, place = divmod(number, self.per_row)
        return GAP + place * (self.sizes[0][0] + GAP), row * self.row_height

    def write(self, number: int, column: Column) -> None:
        """Write the title, the number of points and the caption of a column."""
        counted = f"{len(column.points):,} {column.counted}"
        self._text(number, round(1.6 * TITLE), column.title, TITLE, color="0.1", weight="bold")
        self._text(number, round(1.6 * TITLE + 1.4 * TEXT), counted, TEXT, color="0.35")
        for line, text in enumerate(column.caption.split("\n")):
            self._text(number, self.foot + round((0.9 + 1.35 * line) * TEXT), text, TEXT, color="0.1")

    def leave_empty(self, number: int, reason: str) -> None:
        """Write in place of a mesh why there is none."""
        below = self._panel_top(1) + self.sizes[0][1] // 2
        self._text(number, below, reason, TEXT, color="0.5", style="italic")

    def _panel_top(self, row: int) -> int:
        return 3 * TITLE + row * (self.panel_height + BETWEEN)

    def _text(self, number: int, below: int, text: str, size: float, **style: Any) -> None:
        left, top = self.corner(number)
        width = self.sizes[0][0]
        size = min(size, width / (LETTER * max(len(text), 1)))
        x, y = (left + width / 2) / self.width, 1.0 - (top + below) / self.height
        self.figure.text(x, y, text, ha="center", size=_points(size), **style)

    def place(self, number: int, row: int, images: list[Array]) -> None:
        """Place a panel and its close-ups: of a cloud in row 0, of a mesh in row 1."""
        left, top = self.corner(number)
        top += self._panel_top(row)
        self._image(left, top, images[0])
        for rank, (image, square) in enumerate(zip(images[1:], self.squares, strict=True)):
            side = square.side / SUPERSAMPLING
            self._frame(left + square.column / SUPERSAMPLING, top + square.row / SUPERSAMPLING, side, FRAMES[rank])
            size = image.shape[0]
            x, y = left + rank * (size + BETWEEN), top + images[0].shape[0] + BETWEEN
            self._image(x, y, image)
            self._frame(x, y, size, FRAMES[rank])

    def _image(self, left: int, top: int, image: Array) -> None:
        self.figure.figimage(image, left, self.height - top - image.shape[0], origin="upper")

    def _frame(self, left: float, top: float, side: float, colour: str) -> None:
        from matplotlib.patches import Rectangle
        from matplotlib.transforms import IdentityTransform

        inner = side - FRAME_WIDTH
        corner = (left + FRAME_WIDTH / 2, self.height - top - side + FRAME_WIDTH / 2)
        frame = Rectangle(corner, inner, inner, fill=False, color=colour, linewidth=_points(FRAME_WIDTH))
        frame.set_transform(IdentityTransform())
        self.figure.add_artist(frame)


def _points(pixels: float) -> float:
    """Return pixels in typographic points, the unit of matplotlib for letters and lines."""
    return 0.72 * pixels
