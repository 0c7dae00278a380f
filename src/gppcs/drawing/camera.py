"""An orthographic camera, and the direction from which it looks at a cloud, as set or guessed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.mesh import Mesh
from gppcs.engine.arrays import Floats, Ints
from gppcs.errors import ParameterError, number, shown

ELEVATIONS = (22.0, 35.0, STEEP := 55.0)  # degrees from which scenes are seen: the first that shows their ground
GROUND = 0.15  # fraction of the points that the lowest 4 % of the height hold at least, if they are a ground
WIDEST = 1.5  # extent that is shown whole, in that of nearly all points; the page has the same
BEYOND = 0.1  # of the latter, what is shown beyond them of a larger one
SUPERSAMPLING = 2  # pictures are drawn larger by this factor and averaged down, so that edges are smooth


@dataclass(frozen=True)
class Viewpoint:
    """The direction from which a camera looks. A value that is None is guessed from the cloud."""

    up: str | None = None
    direction: tuple[float, float] | None = None  # azimuth and elevation in degrees

    def __post_init__(self) -> None:
        if self.up is not None and not (isinstance(self.up, str) and self.up.removeprefix("-") in ("x", "y", "z")):
            raise ParameterError(f"expected x, y, z, -x, -y or -z as the axis that points up, found {shown(self.up)}")
        if self.direction is None:
            return
        angles = [number(angle) for angle in self.direction] if isinstance(self.direction, Iterable) else []
        if not (len(angles) == 2 and abs(angles[0]) < np.inf and abs(angles[1]) <= 90.0):
            expected = "a finite azimuth and an elevation from -90 to 90, in degrees"
            raise ParameterError(f"expected {expected}, found {shown(self.direction)}")

    def guessed(self, points: Floats) -> tuple[str, tuple[float, float]]:
        """Return the axis and the direction; those that are None are guessed from points (N, 3)."""
        lower, upper = np.percentile(points, (1, 99), axis=0)
        extent = upper - lower
        framed = _is_depth_image(points, lower, upper)
        up = self.up or ("-y" if framed else _up(points, extent))
        if self.direction or framed:
            return up, self.direction or (20.0, 20.0)  # beside the camera
        along = "xyz".index(up[-1])
        broad, deep = np.delete(extent, along)
        # On the broad side, if one is clearly broader: a cloud and its mesh are seen from the same side. Models usually
        # face -y if z is up, and +z if y is up: both are azimuth 0.
        is_deep = broad < 0.9 * deep
        if _lies(extent, along):
            return up, (90.0 if is_deep else 0.0, STEEP)
        azimuth = 50.0 if is_deep else 30.0  # turned a little
        return up, (azimuth, _elevation(points, up, azimuth))


GUESSED = Viewpoint()  # up and direction are guessed


@dataclass(frozen=True)
class Camera:
    """An orthographic camera for one panel of a picture."""

    axes: Floats  # (3, 3), unit vectors as rows: right, up, and towards the viewer
    centre: Floats  # (2,), coordinates along right and up of the middle of the panel, in the unit of the cloud
    scale: float  # supersampled pixels per unit of length
    shape: tuple[int, int]  # width and height of the panel in supersampled pixels
    enlargement: float = 1.0  # scale of a close-up, divided by the scale of the view of the whole cloud

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the panel in pixels of the finished picture."""
        return self.shape[0] // SUPERSAMPLING, self.shape[1] // SUPERSAMPLING

    @classmethod
    def towards(
        cls, points: Floats, width: int, heights: tuple[int, int], viewpoint: Viewpoint = GUESSED, margin: float = 0.0
    ) -> Camera:
        """Return a camera that sees the whole of a cloud (N, 3), without distant outliers."""
        axes = _axes(*viewpoint.guessed(points))
        lower, upper = _frame(points @ axes[:2].T)
        extent = upper - lower
        # For a line, one extent is zero; for a single point, both are.
        extent = np.maximum(extent, 1e-6 * extent.max() or 1.0)
        height = int(np.clip(width * min(extent[1] / extent[0], 1e3), *heights))
        shape = (width * SUPERSAMPLING, height * SUPERSAMPLING)
        empty = np.maximum(0.04 * np.array(shape), margin * SUPERSAMPLING)  # on each side
        return cls(axes, (lower + upper) / 2.0, float(np.min((shape - 2.0 * empty) / extent)), shape)

    def close_up(self, square: tuple[int, int, int], size: int) -> Camera:
        """Return a camera that shows a square of this camera's picture: column, row and side, supersampled."""
        column, row, side = square
        middle = np.array([column, row]) + side / 2.0
        centre = self.centre + (middle - np.array(self.shape) / 2.0) * (1.0, -1.0) / self.scale
        pixels = size * SUPERSAMPLING
        return Camera(self.axes, centre, self.scale * pixels / side, (pixels, pixels), pixels / side)

    def positions(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the positions (N, 2) of points (N, 3) in the picture, and their depths (N,), in pixels."""
        seen = points @ self.axes.T
        positions = (seen[:, :2] - self.centre) * self.scale * (1.0, -1.0) + np.array(self.shape) / 2.0
        return positions, -seen[:, 2] * self.scale

    def pixels(self, points: Floats) -> tuple[Ints, Floats]:
        """Return the pixels (N, 2) of points (N, 3) in the picture, and their depths (N,)."""
        positions, depth = self.positions(points)
        # Distant outliers must not exceed the range of integers.
        return np.clip(positions, -1e6, 1e6).astype(np.int64), depth

    def clipped(self, pixels: Ints) -> tuple[Ints, Ints]:
        """Return the rows and columns (N,) of the pixels of the panel that are nearest to some pixels (N, 2)."""
        width, height = self.shape
        return np.clip(pixels[:, 1], 0, height - 1), np.clip(pixels[:, 0], 0, width - 1)


def averaged(image: Floats) -> Floats:
    """Reduce a supersampled picture to its final size (height, width, 3)."""
    height, width = image.shape[:2]
    blocks = (height // SUPERSAMPLING, SUPERSAMPLING, width // SUPERSAMPLING, SUPERSAMPLING, 3)
    return image.reshape(blocks).mean(axis=(1, 3))


def spread_over(mesh: Mesh) -> Floats:
    """Return points (N, 3) spread evenly over a mesh, as a scan has them: its vertices can be few where it is flat."""
    with np.errstate(over="ignore", invalid="ignore"):
        sums = np.cumsum(mesh.face_areas())
    if not 0.0 < sums[-1] < np.inf:
        return mesh.vertices[np.unique(mesh.faces)]
    count = 20_000
    faces = np.searchsorted(sums, sums[-1] * (np.arange(count) + 0.5) / count)
    first, second = np.random.default_rng(0).random((2, count, 1))
    weights = np.hstack([1.0 - np.sqrt(first), np.sqrt(first) * (1.0 - second), np.sqrt(first) * second])
    return np.einsum("nc,ncx->nx", weights, mesh.vertices[mesh.faces[faces]])


def _axes(up: str, direction: tuple[float, float]) -> Floats:
    """Return the axes (3, 3) of a camera that looks from a direction, as `Camera` has them."""
    along = "xyz".index(up[-1])
    upwards, right = np.eye(3)[along] * (-1.0 if up[0] == "-" else 1.0), np.eye(3)[1 if along == 0 else 0]
    forward = np.cross(right, upwards)
    azimuth, elevation = np.radians(direction)
    horizontal = np.cos(azimuth) * forward + np.sin(azimuth) * right
    to_viewer = np.cos(elevation) * horizontal + np.sin(elevation) * upwards
    sideways = np.cos(azimuth) * right - np.sin(azimuth) * forward
    return np.stack([sideways, np.cross(to_viewer, sideways), to_viewer])


def _frame(flat: Floats) -> tuple[Floats, Floats]:
    """Return the lower left and upper right corner (2,) of the points (N, 2), without the few that lie far out."""
    lower, inner_lower, inner_upper, upper = np.percentile(flat, (0, 1, 99, 100), axis=0)
    inner = inner_upper - inner_lower
    margin = np.where(upper - lower <= WIDEST * inner, upper - lower, BEYOND * inner)
    return np.maximum(lower, inner_lower - margin), np.minimum(upper, inner_upper + margin)


def _is_depth_image(points: Floats, lower: Floats, upper: Floats) -> bool:
    """Return whether points, (N, 3), were probably seen by a depth camera at 0 with z ahead and y down, or by several.

    Those of one image fill its field of view. Those of several, in the frame of the first, lie all ahead of that.
    """
    x, y, z = points.T
    if z.min() <= 0.0 or upper[2] - lower[2] < 0.5 * (upper - lower).max():
        return False
    right, down = x / z, y / z
    size = np.ptp(right), np.ptp(down)
    if min(size) < 0.3 or max(size) > 3.0:
        return False
    cells, _, _ = np.histogram2d(right, down, 16)
    if np.mean(cells > 0) >= 0.9:
        return True
    return bool(lower[2] >= 0.25 * upper[2] and (lower[:2] < 0.0).all() and (upper[:2] > 0.0).all())


def _lies(extent: Floats, along: int) -> bool:
    """Return whether an object of an extent (3,) lies: its height is below half of its smaller width."""
    return bool(extent[along] < 0.5 * np.delete(extent, along).min())


def _up(points: Floats, extent: Floats) -> str:
    """Return the axis that probably points up, given the extent (3,) of nearly all points."""
    if _lies(extent, 2):
        return "z"
    for axis in (2, 1):
        if np.mean(_are_low(points[:, axis])) >= GROUND:
            return "xyz"[axis]
    return "y" if extent[1] > 1.2 * extent[2] else "z"


def _are_low(heights: Floats) -> NDArray[np.bool_]:
    """Return which heights (N,) are among the lowest 4 % of the range of nearly all."""
    lower, upper = np.percentile(heights, (1, 99))
    return heights <= lower + 0.04 * (upper - lower)


def _elevation(points: Floats, up: str, azimuth: float) -> float:
    """Return the lowest elevation from which half of the ground of a scene is seen; that of objects if there is none.

    Points (N, 3) hide others behind them in the same cell of a grid across the view.
    """
    seen = points[:: -(-len(points) // 20_000)]
    is_ground = _are_low(seen[:, "xyz".index(up[-1])] * (-1.0 if up[0] == "-" else 1.0))
    if is_ground.mean() < GROUND:
        return ELEVATIONS[0]
    for elevation in ELEVATIONS:
        across, upwards, nearness = _axes(up, (azimuth, elevation)) @ seen.T
        cell = max(np.ptp(across), np.ptp(upwards)) / 96.0 or 1.0
        columns, rows = (np.floor((values - values.min()) / cell).astype(np.int64) for values in (across, upwards))
        nearest = np.full((98, 98), -np.inf)
        np.maximum.at(nearest, (rows, columns), nearness)
        is_seen = nearness > nearest[rows, columns] - 4.0 * cell  # a ground slants away from the viewer
        if np.mean(is_seen[is_ground]) >= 0.5:
            return elevation
    return ELEVATIONS[0]
