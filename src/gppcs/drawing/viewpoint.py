"""The direction from which a camera looks at a cloud, given or guessed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.mesh import Mesh
from gppcs.errors import ParameterError, number, shown

Array = NDArray[np.float64]

AXES = "xyz"
ELEVATION, ELEVATION_OF_LYING = 22.0, 55.0  # degrees above the horizon, for standing and for lying objects
LYING = 0.5  # an object lies if its height is below this share of its smaller width
TALLER = 1.2  # an object stands along y if it is taller than along z by this factor
GROUND_HEIGHT, GROUND_SHARE = 0.04, 0.15  # the lowest 4 % of the height are a ground if they hold 15 % of the points
# A depth camera looks along z with y down. It sees one point in each direction of a rectangular field of view.
FIELD_OF_VIEW = 0.3, 3.0  # least and greatest width and height of the field, at distance 1
DIRECTIONS, FILLED = 16, 0.9  # the field has 16 by 16 cells, of which 90 % hold points
SPREAD = 20_000  # points spread over a mesh
BESIDE_THE_CAMERA = (20.0, 20.0)  # azimuth and elevation for the image of a depth camera, in degrees


@dataclass(frozen=True)
class Viewpoint:
    """The direction from which a camera looks. A value that is not given is guessed from the cloud."""

    up: str | None = None
    direction: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.up is not None and (not isinstance(self.up, str) or self.up.removeprefix("-") not in tuple(AXES)):
            raise ParameterError(f"expected x, y, z, -x, -y or -z as the axis that points up, found {shown(self.up)}")
        given = self.direction
        if given is None:
            return
        angles = [number(angle) for angle in given] if isinstance(given, Iterable) else []
        if not (len(angles) == 2 and abs(angles[0]) < np.inf and abs(angles[1]) <= 90.0):
            expected = "a finite azimuth and an elevation from -90 to 90, in degrees"
            raise ParameterError(f"expected {expected}, found {shown(given)}")

    def guessed(self, points: Array) -> tuple[str, tuple[float, float]]:
        """Return the axis and the direction, as far as they are not given guessed from points (N, 3)."""
        low, high = np.percentile(points, (1, 99), axis=0)
        extent = high - low
        framed = _is_depth_image(points, extent)
        up = self.up or ("-y" if framed else _up(points, low, extent))
        if self.direction or framed:
            return up, self.direction or BESIDE_THE_CAMERA
        along = AXES.index(up[-1])
        broad, deep = np.delete(extent, along)
        # On the broad side. Models usually face -y if z is up, and +z if y is up: both are azimuth 0.
        if extent[along] < LYING * min(broad, deep):
            return up, (90.0 if broad < deep else 0.0, ELEVATION_OF_LYING)
        return up, (50.0 if broad < deep else 30.0, ELEVATION)  # turned a little


GUESSED = Viewpoint()  # up and direction are guessed


def spread_over(mesh: Mesh) -> Array:
    """Return points (N, 3) spread evenly over a mesh, as a scan has them: its vertices can be few where it is flat."""
    with np.errstate(over="ignore", invalid="ignore"):
        sums = np.cumsum(mesh.face_areas())
    if not 0.0 < sums[-1] < np.inf:
        return mesh.vertices[np.unique(mesh.faces)]
    faces = np.searchsorted(sums, sums[-1] * (np.arange(SPREAD) + 0.5) / SPREAD)
    first, second = np.random.default_rng(0).random((2, SPREAD, 1))
    shares = np.hstack([1.0 - np.sqrt(first), np.sqrt(first) * (1.0 - second), np.sqrt(first) * second])
    return np.einsum("nc,ncx->nx", shares, mesh.vertices[mesh.faces[faces]])


def _is_depth_image(points: Array, extent: Array) -> bool:
    """Return whether points, (N, 3), are probably what one image of a depth camera at the origin shows."""
    x, y, z = points.T
    if z.min() <= 0.0 or extent[2] < LYING * extent.max():
        return False
    right, down = x / z, y / z
    size = np.ptp(right), np.ptp(down)
    if min(size) < FIELD_OF_VIEW[0] or max(size) > FIELD_OF_VIEW[1]:
        return False
    cells, _, _ = np.histogram2d(right, down, DIRECTIONS)
    return bool(np.mean(cells > 0) >= FILLED)


def _up(points: Array, low: Array, extent: Array) -> str:
    """Return the axis that probably points up, given the lower corner and the extent (3,) of nearly all points."""
    if extent[2] < LYING * min(extent[0], extent[1]):
        return "z"
    for axis in (2, 1):
        if np.mean(points[:, axis] <= low[axis] + GROUND_HEIGHT * extent[axis]) >= GROUND_SHARE:
            return AXES[axis]
    return "y" if extent[1] > TALLER * extent[2] else "z"
