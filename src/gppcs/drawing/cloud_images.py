"""Draws clouds: the original as a closed surface, others as single points on the visible side."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.drawing.camera import Camera, averaged
from gppcs.drawing.colours import RGB, VARIATION, Colourable, Legend, kinds_of
from gppcs.drawing.estimates import disc_radii, estimates, thin_on_lines, tree_over
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import normalised
from gppcs.surface.surface_variation import features_of_nearest

NOISY = math.cos(math.radians(20.0))  # median cosine of normals of nearer and farther neighbours, at most
MAX_SURFACE_RADIUS = 28  # of discs in supersampled pixels; more in close-ups


@dataclass(frozen=True)
class ColouredCloud:
    """A cloud to draw."""

    points: Floats
    values: Floats
    normals: Floats | None = None
    colours: Floats | None = None

    @classmethod
    def by_surface_variation(cls, points: Floats) -> ColouredCloud:
        """Return points (N, 3) coloured by their own surface variation."""
        variation, normals, *_ = estimates(points)
        return cls(points, variation, normals)

    def at(self, points: Floats) -> ColouredCloud:
        """Return a simplified cloud: points (M, 3) with the values and colours of the nearest ones."""
        nearest = KdTree.build(self.points).nearest_of(points, 1)[0][:, 0]
        colours = None if self.colours is None else self.colours[nearest]
        return ColouredCloud(points, self.values[nearest], colours=colours)

    def colours_by(self, legend: Legend) -> Floats:
        """Return the colours (N, 3): its own if it has some, otherwise those of its values."""
        return legend.colours_of(self.values) if self.colours is None else self.colours


def painted(cloud: PointCloud, colour: str | None) -> tuple[ColouredCloud, Legend | None]:
    """Return a finite cloud coloured by RGB or an attribute, and its legend; or by surface variation, without one."""
    attributes = Colourable.from_cloud(cloud)
    coloured = ColouredCloud.by_surface_variation(cloud.points)
    if colour is None or (colour == VARIATION and VARIATION not in attributes.columns):
        return coloured, None
    attributes.require(colour)
    if colour == RGB and RGB not in attributes.columns:
        assert attributes.rgb is not None
        return replace(coloured, colours=attributes.rgb / 255.0), Legend("RGB")
    values = attributes.columns[colour]
    kinds = kinds_of(values, colour)
    legend = Legend.of_amounts([values], colour, root=False) if kinds is None else Legend.of_kinds(kinds, colour)
    return replace(coloured, colours=legend.colours_of(values)), legend


class Original:
    """The original cloud with a search tree. Other clouds take their normals from it."""

    def __init__(self, cloud: ColouredCloud) -> None:
        self.cloud, self.is_noisy = cloud, False
        points, self.frame = normalised(cloud.points)
        self.tree, same = tree_over(points)
        self.spacing = self.frame.lengths(disc_radii(self.tree))[same]

    @classmethod
    def with_relief(cls, cloud: ColouredCloud) -> Original:
        """Return a cloud whose normals are of nearer points than its own, which show less relief, but of noise."""
        original = cls(replace(cloud, normals=None))
        sampled = np.arange(0, len(cloud.points), -(-len(cloud.points) // 4096))
        if cloud.normals is not None:
            near = original.normals(original.cloud, sampled)
            cosines = np.abs(np.einsum("nx,nx->n", near, cloud.normals[sampled]))
            original.is_noisy = bool(np.median(cosines) < NOISY)
        if original.is_noisy:
            original.cloud = cloud
        return original

    def normals(self, cloud: ColouredCloud, indices: Ints) -> Floats:
        """Return normals of some points of a cloud: its own, or those of the original around them."""
        if cloud.normals is not None:
            return cloud.normals[indices]
        nearest, _ = self.tree.in_own_order().nearest_of(self.frame.near(cloud.points[indices]), 1)
        return self._normals_of_nearest[nearest[:, 0]]

    @cached_property
    def _normals_of_nearest(self) -> Floats:
        """The directions (K, 3) in which the twelve points around each point of the tree are thinnest, in its order."""
        return features_of_nearest(self.tree, 12).normals[self.tree.order]


class View:
    """The original cloud as a camera sees it."""

    def __init__(self, original: Original, camera: Camera, is_closed: bool = True) -> None:
        self.original, self.camera = original, camera
        # The sixth neighbour is 1.4 mean spacings away. Discs a little larger than that leave almost no gaps; others
        # reach half of the way to the neighbours.
        radii = (1.2 if is_closed else 0.5 / 1.4) * camera.scale * original.spacing
        # Outliers have no near neighbours, but must not become large discs.
        largest = np.clip(4.0 * np.median(radii), 1.0, MAX_SURFACE_RADIUS * camera.enlargement)
        radii = np.clip(radii, 1.0, largest)
        pixels, depth = camera.pixels(original.cloud.points)
        margin = math.ceil(largest)
        inside = np.flatnonzero(((pixels >= -margin) & (pixels < np.array(camera.shape) + margin)).all(axis=1))
        pixels, depth, radii = pixels[inside], depth[inside], radii[inside]
        # First draw small discs that face the viewer. They remove most of the far side, which then needs no normals.
        nearest, _ = _splat(pixels, depth, 0.4 * radii, None, camera.shape)
        covering = np.maximum(nearest[camera.clipped(pixels)], 0)
        front = depth <= depth[covering] + 4.0 * radii[covering]
        pixels, depth, radii = pixels[front], depth[front], radii[front]
        self.shown = inside[front]
        self.normals = self._facing(original.cloud, self.shown)
        self.nearest, self.depth = _splat(pixels, depth, radii, self.normals, camera.shape)
        if is_closed:
            _fill_pinholes(self.nearest, self.depth)
        covered = self.nearest >= 0
        # How far behind the surface points are seen: at least half of noisy ones lie behind those in front.
        self.depth[covered] += 1.0 + (4.0 if original.is_noisy else 0.8) * radii[self.nearest[covered]]

    def surface(self, colours: Floats) -> Floats:
        """Return the picture (height, width, 3) of the original as a closed surface, by its colours (N, 3)."""
        return averaged(_lit(self.nearest, colours[self.shown], self.normals, np.ones(3)))

    def values(self) -> Floats:
        """Return the value of the original in each pixel (height, width)."""
        values = np.append(np.nan_to_num(self.original.cloud.values[self.shown]), 0.0)
        return values[self.nearest]  # the last one, where nothing is seen

    def points(self, cloud: ColouredCloud, colours: Floats, max_radius: float) -> Floats:
        """Return the picture of another cloud, by its colours (M, 3): points in front of a faint grey original."""
        pixels, depth = self.camera.pixels(cloud.points)
        front = np.flatnonzero(depth <= self.depth[self.camera.clipped(pixels)])
        tree, frame = self.original.tree, self.original.frame
        spacing = thin_on_lines(Original(cloud).spacing, tree, frame.near(cloud.points))
        radii = np.clip(0.33 * self.camera.scale * spacing, 2.4, max_radius)[front]
        nearest, _ = _splat(pixels[front], depth[front], radii, None, self.camera.shape)
        grey = np.full((len(self.shown), 3), 0.8)
        opacity = 0.35
        ghost = 1.0 - opacity * (1.0 - _lit(self.nearest, grey, self.normals, np.ones(3)))
        return averaged(_lit(nearest, colours[front], self._facing(cloud, front), ghost))

    def _facing(self, cloud: ColouredCloud, indices: Ints) -> Floats:
        """Return normals (K, 3) in the axes of the camera, with the sign that points to the viewer."""
        seen = self.original.normals(cloud, indices) @ self.camera.axes.T
        return seen * np.where(seen[:, 2:] < 0.0, -1.0, 1.0)


def _lit(nearest: Ints, colours: Floats, normals: Floats, background: Floats) -> Floats:
    """Return the shaded picture (height, width, 3) of the points with the indices `nearest` (height, width)."""
    light = np.array([-0.35, 0.45, 0.82])  # right, up, to the viewer: from the upper left
    facing = np.clip(normals @ (light / np.linalg.norm(light)), 0.0, 1.0)
    lit = np.clip(colours * (0.52 + 0.63 * facing)[:, None], 0.0, 1.0)
    return np.where(nearest[..., None] < 0, background, np.append(lit, np.ones((1, 3)), axis=0)[nearest])


def _splat(
    pixels: Ints, depth: Floats, radii: Floats, normals: Floats | None, shape: tuple[int, int]
) -> tuple[Ints, Floats]:
    """Return the nearest point and its depth in each pixel, drawn as a disc that faces the viewer or has a normal."""
    nearest, depths = np.full(shape[::-1], -1), np.full(shape[::-1], np.inf)
    slopes = np.zeros((len(pixels), 2))
    if normals is not None:
        slopes = normals[:, :2] * (1.0, -1.0) / np.maximum(normals[:, 2:], 0.1)  # do not tilt further
    _draw_discs(pixels, depth, np.round(2.0 * radii).astype(np.int64), slopes, nearest, depths)
    return nearest, depths


def _fill_pinholes(nearest: Ints, depths: Floats) -> None:
    """Let empty pixels with at least three covered ones beside them show one of these, a few times over."""
    for _ in range(4):
        covered = np.pad(nearest >= 0, 1)
        beside = [covered[1:-1, :-2], covered[1:-1, 2:], covered[:-2, 1:-1], covered[2:, 1:-1]]
        rows, columns = np.nonzero(~covered[1:-1, 1:-1] & (np.sum(beside, axis=0) >= 3))
        left = np.where(beside[0][rows, columns], columns - 1, columns + 1)
        nearest[rows, columns], depths[rows, columns] = nearest[rows, left], depths[rows, left]


@kernel(allocates=False)
def _draw_discs(pixels, depth, sizes, slopes, nearest, depths):
    """Enter into each pixel the nearest disc, the first of several as near, and its depth there."""
    height, width = nearest.shape
    for index in range(len(pixels)):
        size = sizes[index]
        for dy in range(-(size // 2), size // 2 + 1):
            for dx in range(-(size // 2), size // 2 + 1):
                column, row = pixels[index, 0] + dx, pixels[index, 1] + dy
                deeper = slopes[index, 0] * dx + slopes[index, 1] * dy
                if not (0 <= column < width and 0 <= row < height):
                    continue
                is_covered = 4.0 * (dx * dx + dy * dy + deeper * deeper) <= size * size
                if is_covered and depth[index] + deeper < depths[row, column]:
                    nearest[row, column], depths[row, column] = index, depth[index] + deeper
