"""An orthographic camera, and the side from which it looks at a cloud."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import ParameterError

Array = NDArray[np.float64]

SUPERSAMPLING = 2  # drawn larger by this factor and averaged down, for crisp round points
MARGIN = 0.04  # free share of a panel on each side
ELEVATION, ELEVATION_OF_LYING = 22.0, 55.0  # degrees over the horizon
LYING = 0.5  # of its lesser width: what is less high lies
AXES = "xyz"


class Square(NamedTuple):
    """A part of a picture: its upper left corner and its side, in supersampled pixels."""

    column: int
    row: int
    side: int


@dataclass(frozen=True)
class Viewpoint:
    """From where one looks; what is not given is guessed from the extent of the cloud.

    Parameters
    ----------
    up : str, optional
        The axis that points upwards: x, y, z, -x, -y or -z.
    direction : (azimuth, elevation), optional
        In degrees. At azimuth 0, x points to the right (y where x or -x is up); the viewer then goes to the right
        around the cloud, and up by the elevation, from -90 to 90.

    Raises
    ------
    ParameterError
        If there is no such axis or direction.
    """

    up: str | None = None
    direction: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.up is not None and self.up.removeprefix("-") not in tuple(AXES):
            raise ParameterError(f"expected x, y, z, -x, -y or -z as the axis that points upwards, found {self.up!r}")
        if self.direction is not None and not (abs(self.direction[0]) < np.inf and abs(self.direction[1]) <= 90.0):
            raise ParameterError(
                "expected a direction of view of an azimuth and an elevation from -90 to 90, in degrees, found "
                f"{self.direction[0]:g} and {self.direction[1]:g}"
            )


GUESSED = Viewpoint()


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
    def towards(cls, points: Array, width: int, heights: tuple[int, int], viewpoint: Viewpoint = GUESSED) -> Camera:
        """Return a camera that sees the whole cloud, strays apart, in a panel of a given width in pixels.

        The panel is as high as the cloud asks for, from the first to the second of `heights`.
        """
        axes = _axes(points, viewpoint)
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


def _axes(points: Array, viewpoint: Viewpoint) -> Array:
    """Return the axes of the view from a viewpoint, (3, 3), as `Camera` has them."""
    low, high = np.percentile(points, (1, 99), axis=0)
    extent = high - low
    up = viewpoint.up or _up(extent)
    along = AXES.index(up[-1])
    broad, deep = (axis for axis in range(3) if axis != along)
    upwards, right = np.eye(3)[along] * (-1.0 if up[0] == "-" else 1.0), np.eye(3)[broad]
    forward = np.cross(right, upwards)
    lying = extent[along] < LYING * min(extent[broad], extent[deep])
    azimuth, elevation = np.radians(viewpoint.direction or _direction(extent[broad] < extent[deep], lying))
    level = np.cos(azimuth) * forward + np.sin(azimuth) * right
    to_viewer = np.cos(elevation) * level + np.sin(elevation) * upwards
    sideways = np.cos(azimuth) * right - np.sin(azimuth) * forward
    return np.stack([sideways, np.cross(to_viewer, sideways), to_viewer])


def _up(extent: Array) -> str:
    """Return the axis that probably points upwards: z, or y for a solid thing that is thinnest along z."""
    lying = extent[2] < LYING * min(extent[0], extent[1])
    return "y" if extent[1] > extent[2] and not lying else "z"


def _direction(narrow: bool, lying: bool) -> tuple[float, float]:
    """Return azimuth and elevation of a view on the broad side, turned a little where the thing stands.

    People model with the front to -y where z is up, and to +z where y is up; both are azimuth 0.
    """
    if lying:
        return (90.0 if narrow else 0.0), ELEVATION_OF_LYING
    return (50.0 if narrow else 30.0), ELEVATION


def _frame(flat: Array) -> tuple[Array, Array]:
    """Return lower left and upper right of everything, unless strays lie so far out that the rest would be small."""
    low, inner_low, inner_high, high = np.percentile(flat, (0, 0.5, 99.5, 100), axis=0)
    reach = 0.25 * (inner_high - inner_low)
    return np.maximum(low, inner_low - reach), np.minimum(high, inner_high + reach)
