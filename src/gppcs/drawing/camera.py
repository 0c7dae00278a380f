"""An orthographic camera, and the direction from which it looks at a cloud."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import ParameterError

Array = NDArray[np.float64]

SUPERSAMPLING = 2  # pictures are drawn larger by this factor and averaged down, so that edges are smooth
MARGIN = 0.04  # empty share of a panel on each side
ELEVATION, ELEVATION_OF_LYING = 22.0, 55.0  # degrees above the horizon, for standing and for lying objects
LYING = 0.5  # an object lies if its height is below this share of its smaller width
AXES = "xyz"


class Square(NamedTuple):
    """A square part of a picture: its upper left corner and its edge length, in supersampled pixels."""

    column: int
    row: int
    side: int


@dataclass(frozen=True)
class Viewpoint:
    """The direction from which a camera looks. A value that is not given is guessed from the extent of the cloud.

    Parameters
    ----------
    up : str, optional
        The axis that points up: x, y, z, -x, -y or -z.
    direction : (azimuth, elevation), optional
        In degrees. At azimuth 0, x points right (y if x or -x is up). A larger azimuth moves the viewer to the right
        around the cloud. A larger elevation, from -90 to 90, moves the viewer up.

    Raises
    ------
    ParameterError
        If `up` is no axis, or `direction` is out of range.
    """

    up: str | None = None
    direction: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.up is not None and self.up.removeprefix("-") not in tuple(AXES):
            raise ParameterError(f"expected x, y, z, -x, -y or -z as the axis that points up, found {self.up!r}")
        if self.direction is not None and not (abs(self.direction[0]) < np.inf and abs(self.direction[1]) <= 90.0):
            raise ParameterError(
                "expected a finite azimuth and an elevation from -90 to 90, in degrees, found "
                f"{self.direction[0]:g} and {self.direction[1]:g}"
            )

    def completed(self, points: Array) -> Viewpoint:
        """Return this viewpoint with a guess for each value that is not given.

        Parameters
        ----------
        points : (N, 3) array, float64
            Finite coordinates, N at least 1.

        Returns
        -------
        Viewpoint
            With `up` and `direction`.
        """
        low, high = np.percentile(points, (1, 99), axis=0)
        extent = high - low
        up = self.up or _up(extent)
        along = AXES.index(up[-1])
        broad, deep = (axis for axis in range(3) if axis != along)
        lying = extent[along] < LYING * min(extent[broad], extent[deep])
        return Viewpoint(up, self.direction or _direction(bool(extent[broad] < extent[deep]), bool(lying)))


GUESSED = Viewpoint()  # up and direction are guessed


@dataclass(frozen=True)
class Camera:
    """An orthographic camera for one panel of a picture.

    Attributes
    ----------
    axes : (3, 3) array, float64
        Unit vectors as rows: right, up, and towards the viewer.
    centre : (2,) array, float64
        Coordinates along right and up of the middle of the panel, in the unit of the cloud.
    scale : float
        Supersampled pixels per unit of length.
    shape : (width, height)
        Size of the panel in supersampled pixels.
    enlargement : float
        Scale of a close-up, divided by the scale of the view of the whole cloud.
    """

    axes: Array
    centre: Array
    scale: float
    shape: tuple[int, int]
    enlargement: float = 1.0

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the panel in pixels of the finished picture."""
        return self.shape[0] // SUPERSAMPLING, self.shape[1] // SUPERSAMPLING

    @classmethod
    def towards(cls, points: Array, width: int, heights: tuple[int, int], viewpoint: Viewpoint = GUESSED) -> Camera:
        """Return a camera that sees the whole cloud, without distant outliers.

        Parameters
        ----------
        points : (N, 3) array, float64
            Finite coordinates, N at least 1.
        width : int
            Width of the panel in pixels.
        heights : (int, int)
            Least and greatest height of the panel in pixels; between them, it fits the cloud.
        viewpoint : Viewpoint
            The direction of the view.

        Returns
        -------
        Camera
        """
        axes = _axes(points, viewpoint)
        low, high = _frame(points @ axes[:2].T)
        extent = high - low
        # For a line, one extent is zero; for a single point, both are.
        extent = np.maximum(extent, 1e-6 * extent.max() or 1.0)
        height = int(np.clip(width * min(extent[1] / extent[0], 1e3), *heights))
        shape = (width * SUPERSAMPLING, height * SUPERSAMPLING)
        scale = float(np.min(np.array(shape) * (1.0 - 2.0 * MARGIN) / extent))
        return cls(axes, (low + high) / 2.0, scale, shape)

    def close_up(self, square: Square, size: int) -> Camera:
        """Return a camera that shows a square part of this camera's picture.

        Parameters
        ----------
        square : Square
            The part of the picture.
        size : int
            Edge length of the new panel in pixels.

        Returns
        -------
        Camera
        """
        middle = np.array([square.column, square.row]) + square.side / 2.0
        centre = self.centre + (middle - np.array(self.shape) / 2.0) * (1.0, -1.0) / self.scale
        side = size * SUPERSAMPLING
        enlargement = side / square.side
        return Camera(self.axes, centre, self.scale * enlargement, (side, side), enlargement)

    def pixels(self, points: Array) -> tuple[NDArray[np.int64], Array]:
        """Project points to the picture.

        Parameters
        ----------
        points : (N, 3) array, float64
            In the unit of the cloud.

        Returns
        -------
        place : (N, 2) array, int64
            Column and row in supersampled pixels; outside the panel for points that it does not show.
        depth : (N,) array, float64
            Distance away from the viewer in supersampled pixels, from an arbitrary origin.
        """
        seen = points @ self.axes.T
        place = (seen[:, :2] - self.centre) * self.scale * (1.0, -1.0) + np.array(self.shape) / 2.0
        # Distant outliers must not exceed the range of integers.
        return np.clip(place, -1e6, 1e6).astype(np.int64), -seen[:, 2] * self.scale

    def clipped(self, place: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the pixels of the panel that are nearest to the given places.

        Parameters
        ----------
        place : (N, 2) array, int64
            Column and row.

        Returns
        -------
        rows, columns : (N,) arrays, int64
            Within the panel.
        """
        width, height = self.shape
        return np.clip(place[:, 1], 0, height - 1), np.clip(place[:, 0], 0, width - 1)


def averaged(image: Array) -> Array:
    """Reduce a supersampled picture to its final size.

    Parameters
    ----------
    image : (SUPERSAMPLING height, SUPERSAMPLING width, 3) array
        The supersampled picture.

    Returns
    -------
    (height, width, 3) array
        Means of blocks of pixels.
    """
    height, width = image.shape[:2]
    blocks = (height // SUPERSAMPLING, SUPERSAMPLING, width // SUPERSAMPLING, SUPERSAMPLING, 3)
    small: Array = image.reshape(blocks).mean(axis=(1, 3))
    return small


def _axes(points: Array, viewpoint: Viewpoint) -> Array:
    """Return the axes (3, 3) of a camera at a viewpoint, as defined by `Camera`."""
    viewpoint = viewpoint.completed(points)
    assert viewpoint.up
    assert viewpoint.direction
    along = AXES.index(viewpoint.up[-1])
    broad = 1 if along == 0 else 0
    upwards, right = np.eye(3)[along] * (-1.0 if viewpoint.up[0] == "-" else 1.0), np.eye(3)[broad]
    forward = np.cross(right, upwards)
    azimuth, elevation = np.radians(viewpoint.direction)
    level = np.cos(azimuth) * forward + np.sin(azimuth) * right
    to_viewer = np.cos(elevation) * level + np.sin(elevation) * upwards
    sideways = np.cos(azimuth) * right - np.sin(azimuth) * forward
    return np.stack([sideways, np.cross(to_viewer, sideways), to_viewer])


def _up(extent: Array) -> str:
    """Return the axis that probably points up: y if the object stands and is longer along y than along z, else z."""
    lying = extent[2] < LYING * min(extent[0], extent[1])
    return "y" if extent[1] > extent[2] and not lying else "z"


def _direction(narrow: bool, lying: bool) -> tuple[float, float]:
    """Return azimuth and elevation of a view on the broad side, turned a little if the object stands.

    Models usually face -y if z is up, and +z if y is up. Both are azimuth 0.
    """
    if lying:
        return (90.0 if narrow else 0.0), ELEVATION_OF_LYING
    return (50.0 if narrow else 30.0), ELEVATION


def _frame(flat: Array) -> tuple[Array, Array]:
    """Return the lower left and upper right corner (2,) of the points (N, 2), without distant outliers."""
    low, inner_low, inner_high, high = np.percentile(flat, (0, 0.5, 99.5, 100), axis=0)
    reach = 0.25 * (inner_high - inner_low)
    return np.maximum(low, inner_low - reach), np.minimum(high, inner_high + reach)
