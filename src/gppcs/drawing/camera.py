"""An orthographic camera, and the side from which it looks at a cloud."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SUPERSAMPLING = 2  # drawn larger by this factor and averaged down, for crisp round points
MARGIN = 0.04  # free share of a panel on each side
ELEVATION, ELEVATION_OF_LYING = 22.0, 55.0  # degrees over the horizon


class Square(NamedTuple):
    """A part of a picture: its upper left corner and its side, in supersampled pixels."""

    column: int
    row: int
    side: int


@dataclass(frozen=True)
class Camera:
    """An orthographic camera.

    Attributes
    ----------
    axes : (3, 3) array
        Rows: right, up, and from the cloud to the viewer.
    centre : (2,) array
        What is in the middle, along right and up.
    scale : float
        Pixels, supersampled, per unit of length.
    shape : (width, height)
        Pixels of the panel, supersampled.
    enlargement : float
        Of a close-up over the view of the whole.
    """

    axes: Array
    centre: Array
    scale: float
    shape: tuple[int, int]
    enlargement: float = 1.0

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the finished panel, in pixels."""
        return self.shape[0] // SUPERSAMPLING, self.shape[1] // SUPERSAMPLING

    @classmethod
    def towards(cls, points: Array, width: int, heights: tuple[int, int]) -> Camera:
        """Return a camera that sees the whole cloud, strays apart, in a panel of a given width in pixels.

        The panel is as high as the cloud asks for, from the first to the second of `heights`.
        """
        axes = _axes(points)
        low, high = _frame(points @ axes[:2].T)
        extent = high - low
        # A line has one extent only, and a single place none.
        extent = np.maximum(extent, 1e-6 * extent.max() or 1.0)
        height = int(np.clip(width * min(extent[1] / extent[0], 1e3), *heights))
        shape = (width * SUPERSAMPLING, height * SUPERSAMPLING)
        scale = float(np.min(np.array(shape) * (1.0 - 2.0 * MARGIN) / extent))
        return cls(axes, (low + high) / 2.0, scale, shape)

    def close_up(self, square: Square, size: int) -> Camera:
        """Return a camera that sees a square of this one's picture in a square panel of `size` pixels."""
        middle = np.array([square.column, square.row]) + square.side / 2.0
        centre = self.centre + (middle - np.array(self.shape) / 2.0) * (1.0, -1.0) / self.scale
        side = size * SUPERSAMPLING
        enlargement = side / square.side
        return Camera(self.axes, centre, self.scale * enlargement, (side, side), enlargement)

    def pixels(self, points: Array) -> tuple[NDArray[np.int64], Array]:
        """Return columns and rows, (N, 2), and depths away from the viewer, (N,), in supersampled pixels."""
        seen = points @ self.axes.T
        place = (seen[:, :2] - self.centre) * self.scale * (1.0, -1.0) + np.array(self.shape) / 2.0
        # A stray must not leave the range of integers.
        return np.clip(place, -1e6, 1e6).astype(np.int64), -seen[:, 2] * self.scale

    def clipped(self, place: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return rows and columns of the pixels nearest to the given columns and rows."""
        width, height = self.shape
        return np.clip(place[:, 1], 0, height - 1), np.clip(place[:, 0], 0, width - 1)


def averaged(image: Array) -> Array:
    """Return a picture, (height, width, 3), at its final size, from a supersampled one."""
    height, width = image.shape[:2]
    blocks = (height // SUPERSAMPLING, SUPERSAMPLING, width // SUPERSAMPLING, SUPERSAMPLING, 3)
    small: Array = image.reshape(blocks).mean(axis=(1, 3))
    return small


def _axes(points: Array) -> Array:
    """Return the axes of a three-quarter view; upwards is z, or y for a solid thing that is thinnest along z."""
    low, high = np.percentile(points, (1, 99), axis=0)
    extent = high - low
    lying = extent[2] < 0.5 * min(extent[0], extent[1])
    up = 1 if extent[1] > extent[2] and not lying else 2
    # Broad side: people model with the front to -y where z is up, and to +z where y is up.
    across, front = (1, -1.0) if up == 2 else (2, 1.0)
    if extent[0] < extent[across]:
        across, front = 0, 1.0
    upwards, forward = np.eye(3)[up], front * np.eye(3)[across]
    right = np.cross(upwards, forward)
    # Turned towards the front where the broad side is not the front.
    azimuth = np.radians(0.0 if lying else -40.0 if across == 0 else 30.0)
    elevation = np.radians(ELEVATION_OF_LYING if lying else ELEVATION)
    level = np.cos(azimuth) * forward + np.sin(azimuth) * right
    to_viewer = np.cos(elevation) * level + np.sin(elevation) * upwards
    sideways = np.cos(azimuth) * right - np.sin(azimuth) * forward
    return np.stack([sideways, np.cross(to_viewer, sideways), to_viewer])


def _frame(flat: Array) -> tuple[Array, Array]:
    """Return lower left and upper right of everything, unless strays lie so far out that the rest would be small."""
    low, inner_low, inner_high, high = np.percentile(flat, (0, 0.5, 99.5, 100), axis=0)
    reach = 0.25 * (inner_high - inner_low)
    return np.maximum(low, inner_low - reach), np.minimum(high, inner_high + reach)
