"""Pictures of clouds side by side, drawn without a display or a graphics card."""

from __future__ import annotations

import importlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gppcs.errors import InputError, MissingExtraError, ParameterError

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SUPERSAMPLING = 2  # drawn larger by this factor and averaged down, for crisp round points
MARGIN = 0.04  # free share of a panel on each side
LIGHT = np.array([-0.35, 0.45, 0.82])  # to the right, up, towards the viewer: over the left shoulder
AMBIENT, DIFFUSE = 0.52, 0.63
STEEPEST = 0.1  # least share of a normal that points to the viewer: discs do not tilt more
MAX_SURFACE_RADIUS = 28.0  # supersampled pixels, as the next
POINT_RADIUS = (2.4, 5.2)
GHOST = 0.35
NO_VALUE = 0.6  # grey
NEIGHBOURS = 12
COLOURS, DARKEST = "viridis", 0.22  # without its darkest part, on which no shading is seen


@dataclass(frozen=True)
class Panel:
    """One cloud of a picture.

    Parameters
    ----------
    title : str
        What it is, above the panel.
    points : (N, 3) array
        Finite coordinates, N >= 1.
    values : (N,) array
        What the colour shows, such as surface variation, on a square root scale; NaN is drawn grey.
    normals : (N, 3) array, optional
        Unit normals of either sign, for the shading. Without them they are estimated from the first panel.

    Raises
    ------
    InputError
        If the shapes do not fit, or a coordinate is not finite.
    """

    title: str
    points: Array
    values: Array
    normals: Array | None = None

    def __post_init__(self) -> None:
        points = np.asarray(self.points, dtype=np.float64)
        values = np.asarray(self.values, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
            raise InputError(f"expected points of shape (N, 3) with N >= 1 to draw, found {points.shape}")
        if not np.isfinite(points).all():
            raise InputError("expected finite coordinates to draw, found NaN or infinity; leave those points out")
        if values.shape != (len(points),):
            raise InputError(f"expected one value for each of {len(points)} points, found shape {values.shape}")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "values", values)
        if self.normals is not None:
            normals = np.asarray(self.normals, dtype=np.float64)
            if normals.shape != points.shape:
                raise InputError(f"expected normals of shape {points.shape}, found {normals.shape}")
            object.__setattr__(self, "normals", normals)


def require_matplotlib() -> None:
    """Make sure that a picture can be drawn, before long work is done for it.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    try:
        importlib.import_module("matplotlib")
    except ImportError as error:
        raise MissingExtraError("a picture needs matplotlib: pip install 'gppcs[picture]'") from error


def draw(
    target: str | os.PathLike[str] | IO[bytes],
    panels: Sequence[Panel],
    *,
    view: tuple[float, float] | None = None,
    size: tuple[int, int] = (1600, 800),
    label: str = "surface variation",
) -> None:
    """Write a PNG of clouds side by side, seen by one camera and coloured on one scale.

    The first panel is the reference: it is drawn as a closed surface, sets the camera and the upper limit of
    the colours (its 98th percentile), and hides the points of the others that lie on its far side. Those are
    drawn one by one before a faint grey shade of the reference. Above a panel stands its number of points,
    and the share of the reference that this is.

    Parameters
    ----------
    target : path or binary file
        Where the PNG goes.
    panels : sequence of Panel
        At least one, the original first.
    view : (azimuth, elevation), optional
        Degrees. Azimuth 0 looks at the broad side of the reference and grows as the camera walks to the right
        around it; elevation is the height of the camera over the horizon, -90 to 90. Upwards is z, or y for a
        solid thing that is thinnest along z. Without it, a three-quarter view.
    size : (width, height)
        Pixels.
    label : str
        What the colours show, beside the colour bar.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    ParameterError
        If there is no panel, the elevation is out of range, or the picture is too small to hold its panels.
    """
    require_matplotlib()
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, PowerNorm
    from matplotlib.figure import Figure

    layout = _Layout.of(len(panels), size)
    reference = panels[0]
    scene = _Scene(reference, _Camera.towards(reference.points, view, layout.panel))
    shades = ListedColormap(colormaps[COLOURS](np.linspace(DARKEST, 1.0, 256)))
    # Most values are small: the root spreads them out.
    scale = ScalarMappable(PowerNorm(0.5, *_limits(reference.values), clip=True), shades)

    figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100, facecolor="white")
    for number, panel in enumerate(panels):
        colours = scale.to_rgba(panel.values)[:, :3]
        colours[np.isnan(panel.values)] = NO_VALUE
        image = scene.surface(colours) if number == 0 else scene.points(panel, colours)
        left, bottom = layout.corner(number)
        figure.figimage(image, left, bottom, origin="upper")
        counted = f"{len(panel.points):,} points"
        if number > 0:
            counted += f" ({len(panel.points) / len(reference.points):.1%})"
        middle = (left + layout.panel[0] / 2) / size[0]
        figure.text(middle, 1 - 34 / size[1], panel.title, ha="center", size=15, weight="bold", color="0.15")
        figure.text(middle, 1 - 58 / size[1], counted, ha="center", size=11.5, color="0.35")
    _add_bar(figure, layout, scale, label)
    figure.savefig(target, format="png", dpi=100)


def _add_bar(figure: Figure, layout: _Layout, scale: ScalarMappable, label: str) -> None:
    from matplotlib.ticker import MaxNLocator

    low, high = scale.get_clim()
    ticks = [tick for tick in MaxNLocator(4).tick_values(low, high) if low <= tick <= high]
    axes = figure.add_axes(layout.bar)
    bar = figure.colorbar(scale, cax=axes, orientation="horizontal", extend="max", ticks=ticks)
    bar.outline.set_visible(False)
    axes.tick_params(labelsize=9.5, color="0.5", labelcolor="0.35", length=3)
    bar.set_label(label, fontsize=11.5, color="0.25")


@dataclass(frozen=True)
class _Layout:
    """Where things stand on the picture, in pixels from the lower left; the bar in shares of the picture."""

    panel: tuple[int, int]
    gap: int
    below: int
    bar: tuple[float, float, float, float]

    @classmethod
    def of(cls, n_panels: int, size: tuple[int, int]) -> _Layout:
        if n_panels == 0:
            raise ParameterError("expected at least one panel to draw, found none; pass the original cloud first")
        width, height = size
        gap, above, below = 12, 68, 74
        panel = ((width - gap * (n_panels + 1)) // n_panels, height - above - below)
        if min(panel) < 64:
            raise ParameterError(
                f"expected room of 64 x 64 pixels or more for each of {n_panels} panels, "
                f"found {panel[0]} x {panel[1]} in a picture of {width} x {height}; make it larger"
            )
        return cls(panel, gap, below, (0.34, 48 / height, 0.32, 12 / height))

    def corner(self, number: int) -> tuple[int, int]:
        """Return the lower left corner of a panel."""
        return self.gap + number * (self.panel[0] + self.gap), self.below


@dataclass(frozen=True)
class _Camera:
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
    """

    axes: Array
    centre: Array
    scale: float
    shape: tuple[int, int]

    @classmethod
    def towards(cls, points: Array, view: tuple[float, float] | None, panel: tuple[int, int]) -> _Camera:
        """Return a camera that sees the cloud in a panel of the given pixels; `view` as in `draw`."""
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
        if view is None:
            # Turned towards the front where the broad side is not the front.
            view = (0.0, 55.0) if lying else (-40.0 if across == 0 else 30.0, 22.0)
        if not (np.isfinite(view[0]) and -90.0 <= view[1] <= 90.0):
            raise ParameterError(
                f"expected a view of azimuth and elevation in degrees, elevation from -90 to 90, found {view}"
            )
        azimuth, elevation = np.radians(view)
        level = np.cos(azimuth) * forward + np.sin(azimuth) * right
        to_viewer = np.cos(elevation) * level + np.sin(elevation) * upwards
        sideways = np.cos(azimuth) * right - np.sin(azimuth) * forward
        axes = np.stack([sideways, np.cross(to_viewer, sideways), to_viewer])
        return cls._framing(axes, points, (panel[0] * SUPERSAMPLING, panel[1] * SUPERSAMPLING))

    @classmethod
    def _framing(cls, axes: Array, points: Array, shape: tuple[int, int]) -> _Camera:
        flat = points @ axes[:2].T
        low, inner_low, inner_high, high = np.percentile(flat, (0, 0.5, 99.5, 100), axis=0)
        # Everything, unless strays lie so far out that the rest would be small.
        reach = 0.25 * (inner_high - inner_low)
        low, high = np.maximum(low, inner_low - reach), np.minimum(high, inner_high + reach)
        extent = high - low
        # A line has one extent only, and a single place none.
        extent = np.maximum(extent, 1e-6 * extent.max() or 1.0)
        scale = float(np.min(np.array(shape) * (1.0 - 2.0 * MARGIN) / extent))
        return cls(axes, (low + high) / 2.0, scale, shape)

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


class _Scene:
    """The reference cloud before the camera: it lends the others its normals and hides their far side."""

    def __init__(self, reference: Panel, camera: _Camera) -> None:
        self.camera = camera
        self.tree = cKDTree(reference.points, balanced_tree=False, compact_nodes=False)
        # The sixth neighbour lies 1.4 mean spacings away: discs a little larger leave next to no gaps.
        radii = 1.2 * camera.scale * _sixth_neighbour(self.tree)
        # Strays, which have no near neighbours, must not become large plates.
        radii = np.clip(radii, 1.0, np.clip(4.0 * np.median(radii), 1.0, MAX_SURFACE_RADIUS))
        place, depth = camera.pixels(reference.points)
        # Small flat discs first, to spare most of the far side the normals; then discs in the surface.
        nearest, _ = _splat(place, depth, 0.4 * radii, None, camera.shape)
        row, column = camera.clipped(place)
        covering = np.maximum(nearest[row, column], 0)
        self.shown = np.flatnonzero(depth <= depth[covering] + 4.0 * radii[covering])
        self.normals = self._normals(reference, self.shown)
        self.nearest, self.depth = _splat(
            place[self.shown], depth[self.shown], radii[self.shown], self.normals, camera.shape
        )
        self.depth += np.where(self.nearest >= 0, 1.0 + 0.8 * radii[self.shown][self.nearest], 0.0)

    def surface(self, colours: Array) -> Array:
        """Return the picture of the reference, closed, (height, width, 3), given (N, 3) colours, 0 to 1."""
        return _averaged(_lit(self.nearest, colours[self.shown], self.normals, np.ones(3)))

    def points(self, panel: Panel, colours: Array) -> Array:
        """Return the picture of another cloud: single points before a faint shade of the reference."""
        place, depth = self.camera.pixels(panel.points)
        front = np.flatnonzero(depth <= self.depth[self.camera.clipped(place)])
        radii = 0.33 * self.camera.scale * _sixth_neighbour(cKDTree(panel.points))
        radii = np.clip(radii, *POINT_RADIUS)[front]
        nearest, _ = _splat(place[front], depth[front], radii, None, self.camera.shape)
        grey = np.full((len(self.shown), 3), 0.8)
        ghost = 1.0 - GHOST * (1.0 - _lit(self.nearest, grey, self.normals, np.ones(3)))
        return _averaged(_lit(nearest, colours[front], self._normals(panel, front), ghost))

    def _normals(self, panel: Panel, indices: NDArray[np.int64]) -> Array:
        """Return normals in camera axes, turned to the viewer, as is all that one sees."""
        if panel.normals is None:
            normals = _estimated_normals(self.tree, panel.points[indices])
        else:
            normals = panel.normals[indices]
        seen = normals @ self.camera.axes.T
        turned: Array = seen * np.where(seen[:, 2:] < 0.0, -1.0, 1.0)
        return turned


def _lit(nearest: NDArray[np.int64], colours: Array, normals: Array, background: Array) -> Array:
    """Return a picture, (height, width, 3), of the points that `nearest` names, lit from the upper left."""
    facing = np.clip(normals @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    lit = np.clip(colours * (AMBIENT + DIFFUSE * facing)[:, None], 0.0, 1.0)
    image = np.empty((*nearest.shape, 3))
    image[...] = background
    image[nearest >= 0] = lit[nearest[nearest >= 0]]
    return image


def _averaged(image: Array) -> Array:
    height, width = image.shape[:2]
    blocks = (height // SUPERSAMPLING, SUPERSAMPLING, width // SUPERSAMPLING, SUPERSAMPLING, 3)
    small: Array = image.reshape(blocks).mean(axis=(1, 3))
    return small


def _sixth_neighbour(tree: cKDTree) -> Array:
    """Return the distance from each point to its sixth neighbour, or to the last where there are fewer."""
    distances, _ = tree.query(tree.data, k=[min(7, tree.n)], workers=-1)
    sixth: Array = distances[:, 0]
    return sixth


def _splat(
    place: NDArray[np.int64], depth: Array, radii: Array, normals: Array | None, shape: tuple[int, int]
) -> tuple[NDArray[np.int64], Array]:
    """Draw points as discs that face the viewer or, where normals are given, lie in the surface.

    Returns
    -------
    nearest : (height, width) array
        Index of the point nearest the viewer in each pixel; -1 where there is none.
    depth : (height, width) array
        Depth of the surface there; infinite where there is none.
    """
    width, height = shape
    empty = np.iinfo(np.int64).max
    buffer = np.full(height * width, empty)
    nearest_depth = depth.min(initial=np.inf) - 2.0 * MAX_SURFACE_RADIUS
    # Depth in the upper half and index in the lower half of one integer: the least is the nearest point.
    step = max(depth.max(initial=-np.inf) - nearest_depth, 1.0) + 4.0 * MAX_SURFACE_RADIUS
    sizes = np.round(2.0 * radii).astype(np.int64)
    for size in np.unique(sizes):
        members = np.flatnonzero(sizes == size)
        x, y, z = place[members, 0], place[members, 1], depth[members] - nearest_depth
        slope = np.zeros((len(members), 2))
        if normals is not None:
            slope = normals[members, :2] * (1.0, -1.0) / np.maximum(normals[members, 2:], STEEPEST)
        reach = np.arange(-(size // 2), size // 2 + 1)
        for dx, dy in ((dx, dy) for dy in reach for dx in reach if 4 * (dx * dx + dy * dy) <= size * size):
            deeper = slope @ (dx, dy)
            column, row = x + dx, y + dy
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            inside &= 4.0 * (dx * dx + dy * dy + deeper * deeper) <= size * size
            key = ((z + deeper)[inside] * (2**30 / step)).astype(np.int64) << 32 | members[inside]
            np.minimum.at(buffer, (row * width + column)[inside], key)
    image = buffer.reshape(height, width)
    covered = image != empty
    nearest = np.where(covered, image & (2**32 - 1), -1)
    return nearest, np.where(covered, (image >> 32) * (step / 2**30) + nearest_depth, np.inf)


def _estimated_normals(tree: cKDTree, points: Array) -> Array:
    """Return the direction in which the neighbourhood of each point in the reference is thinnest."""
    _, neighbours = tree.query(points, k=range(1, min(NEIGHBOURS, tree.n) + 1), workers=-1)
    patches = tree.data[neighbours]
    patches = patches - patches.mean(axis=1, keepdims=True)
    _, directions = np.linalg.eigh(np.einsum("nki,nkj->nij", patches, patches))
    normals: Array = directions[:, :, 0]
    return normals


def _limits(values: Array) -> tuple[float, float]:
    """Return the range of the colours: from 0, or the least value if that is less, to the 98th percentile."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return 0.0, 1.0
    low, high = min(0.0, float(finite.min())), float(np.percentile(finite, 98))
    return low, high if high > low else low + 1.0
