"""An orthographic camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.drawing.viewpoint import AXES, GUESSED, Viewpoint

Array = NDArray[np.float64]

SUPERSAMPLING = 2  # pictures are drawn larger by this factor and averaged down, so that edges are smooth
MARGIN = 0.04  # empty share of a panel on each side
WIDEST = 3.0  # extent that is shown whole, as a multiple of that of nearly all points


class Square(NamedTuple):
    """A square part of a picture: its upper left corner and its edge length, in supersampled pixels."""

    column: int
    row: int
    side: int


@dataclass(frozen=True)
class Camera:
    """An orthographic camera for one panel of a picture."""

    axes: Array  # (3, 3), unit vectors as rows: right, up, and towards the viewer
    centre: Array  # (2,), coordinates along right and up of the middle of the panel, in the unit of the cloud
    scale: float  # supersampled pixels per unit of length
    shape: tuple[int, int]  # width and height of the panel in supersampled pixels
    enlargement: float = 1.0  # scale of a close-up, divided by the scale of the view of the whole cloud

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the panel in pixels of the finished picture."""
        return self.shape[0] // SUPERSAMPLING, self.shape[1] // SUPERSAMPLING

    @classmethod
    def towards(
        cls, points: Array, width: int, heights: tuple[int, int], viewpoint: Viewpoint = GUESSED, margin: float = 0.0
    ) -> Camera:
        """Return a camera that sees the whole of a cloud (N, 3), without distant outliers."""
        axes = _axes(points, viewpoint)
        low, high = _frame(points @ axes[:2].T)
        extent = high - low
        # For a line, one extent is zero; for a single point, both are.
        extent = np.maximum(extent, 1e-6 * extent.max() or 1.0)
        height = int(np.clip(width * min(extent[1] / extent[0], 1e3), *heights))
        shape = (width * SUPERSAMPLING, height * SUPERSAMPLING)
        empty = np.maximum(MARGIN * np.array(shape), margin * SUPERSAMPLING)
        return cls(axes, (low + high) / 2.0, float(np.min((shape - 2.0 * empty) / extent)), shape)

    def close_up(self, square: Square, size: int) -> Camera:
        """Return a camera that shows a square part of this camera's picture."""
        middle = np.array([square.column, square.row]) + square.side / 2.0
        centre = self.centre + (middle - np.array(self.shape) / 2.0) * (1.0, -1.0) / self.scale
        side = size * SUPERSAMPLING
        enlargement = side / square.side
        return Camera(self.axes, centre, self.scale * enlargement, (side, side), enlargement)

    def pixels(self, points: Array) -> tuple[NDArray[np.int64], Array]:
        """Return the places (N, 2) of points (N, 3) in the picture, and their depths (N,)."""
        seen = points @ self.axes.T
        place = (seen[:, :2] - self.centre) * self.scale * (1.0, -1.0) + np.array(self.shape) / 2.0
        # Distant outliers must not exceed the range of integers.
        return np.clip(place, -1e6, 1e6).astype(np.int64), -seen[:, 2] * self.scale

    def clipped(self, place: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows and columns (N,) of the pixels of the panel that are nearest to some places (N, 2)."""
        width, height = self.shape
        return np.clip(place[:, 1], 0, height - 1), np.clip(place[:, 0], 0, width - 1)


def averaged(image: Array) -> Array:
    """Reduce a supersampled picture to its final size (height, width, 3)."""
    height, width = image.shape[:2]
    blocks = (height // SUPERSAMPLING, SUPERSAMPLING, width // SUPERSAMPLING, SUPERSAMPLING, 3)
    return image.reshape(blocks).mean(axis=(1, 3))


def _axes(points: Array, viewpoint: Viewpoint) -> Array:
    """Return the axes (3, 3) of a camera at a viewpoint, as `Camera` has them."""
    up, direction = viewpoint.guessed(points)
    along = AXES.index(up[-1])
    upwards, right = np.eye(3)[along] * (-1.0 if up[0] == "-" else 1.0), np.eye(3)[1 if along == 0 else 0]
    forward = np.cross(right, upwards)
    azimuth, elevation = np.radians(direction)
    level = np.cos(azimuth) * forward + np.sin(azimuth) * right
    to_viewer = np.cos(elevation) * level + np.sin(elevation) * upwards
    sideways = np.cos(azimuth) * right - np.sin(azimuth) * forward
    return np.stack([sideways, np.cross(to_viewer, sideways), to_viewer])


def _frame(flat: Array) -> tuple[Array, Array]:
    """Return the lower left and upper right corner (2,) of the points (N, 2), without distant outliers."""
    low, inner_low, inner_high, high = np.percentile(flat, (0, 0.5, 99.5, 100), axis=0)
    inner = inner_high - inner_low
    reach = np.where(high - low <= WIDEST * inner, high - low, 0.25 * inner)
    return np.maximum(low, inner_low - reach), np.minimum(high, inner_high + reach)
