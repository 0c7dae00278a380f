"""Solids given by functions that are negative inside: points of their surfaces, and parts that they are made of.

Lengths are in millimetres. Where isotropic random lines meet a surface is uniform by area (Crofton).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gppcs.engine.arrays import Floats
from gppcs.scans.patch import Box, Colour, Scan, SurfacePoints

Function = Callable[[Floats], Floats]  # of points, (N, 3); returns (N,), with slopes of at most 1 near 0
Limb = Sequence[float]  # x, y, z and the radius of one end, then of the other

HALVINGS = 14  # of lines within cells; then one step of the secant
STEP = 1e-3  # of the differences that give normals and curvatures


@dataclass(frozen=True)
class Solid:
    """A solid in a box, and the edge length of the cells in which its surface is searched."""

    function: Function
    box: Box
    edge: float
    colour: Colour

    code = None
    weight = 1.0  # a solid is the only part of a scan, so the size of its area does not matter

    @cached_property
    def cells(self) -> Floats:
        """The centres, (C, 3), of all cells that the surface may cross."""
        axes = (np.arange(start, end + self.edge, self.edge) for start, end in zip(*self.box, strict=True))
        centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=3).reshape(-1, 3)
        return centres[np.abs(self.function(centres)) <= np.sqrt(0.75) * self.edge]

    def draw(self, count: int, rng: np.random.Generator) -> SurfacePoints:
        """Return where so many random lines, each near a cell, meet the surface in that cell."""
        centres = self.cells[rng.integers(len(self.cells), size=count)]
        directions, second = _unit(rng.standard_normal((2, count, 3)))
        aside = _unit(np.cross(directions, second)) * np.sqrt(rng.uniform(0.0, 0.75, (count, 1))) * self.edge
        ends = np.sort((np.array([[[-0.5]], [[0.5]]]) * self.edge - aside) / directions, axis=0)
        start, end = ends[0].max(axis=1), ends[1].min(axis=1)
        crosses = start < end
        lines = (centres + aside)[crosses], directions[crosses]
        return self._at(self._crossings(*lines, start[crosses], end[crosses]))

    def _crossings(self, origins: Floats, directions: Floats, start: Floats, end: Floats) -> Floats:
        """Return all points, (K, 3), where the surface meets parts of lines: halves that may hold one are halved."""
        number = np.arange(len(start))
        at_start, at_end = (self.function(origins + t[:, None] * directions) for t in (start, end))
        for _ in range(HALVINGS):
            middle = (start + end) / 2.0
            at_middle = self.function(origins[number] + middle[:, None] * directions[number])
            number = np.tile(number, 2)
            start, end = np.concatenate([start, middle]), np.concatenate([middle, end])
            at_start, at_end = np.concatenate([at_start, at_middle]), np.concatenate([at_middle, at_end])
            may = (at_start < 0.0) != (at_end < 0.0)
            may |= np.abs(at_start) + np.abs(at_end) < end - start
            number, start, end, at_start, at_end = (values[may] for values in (number, start, end, at_start, at_end))
        crosses = (at_start < 0.0) != (at_end < 0.0)
        number, start, end, at_start, at_end = (values[crosses] for values in (number, start, end, at_start, at_end))
        along = start + (end - start) * at_start / (at_start - at_end)
        points: Floats = origins[number] + along[:, None] * directions[number]
        return points

    def _at(self, points: Floats) -> SurfacePoints:
        """Return points of the surface with normals and mean curvatures by central differences."""
        steps = STEP * np.eye(3)
        ahead, behind = (np.stack([self.function(points + sign * step) for step in steps], axis=1) for sign in (1, -1))
        slopes = (ahead - behind) / (2.0 * STEP)
        lengths = np.linalg.norm(slopes, axis=1)
        normals, here = slopes / lengths[:, None], self.function(points)
        across = (ahead + behind - 2.0 * here[:, None]).sum(axis=1)
        across -= self.function(points + STEP * normals) + self.function(points - STEP * normals) - 2.0 * here
        return SurfacePoints(points, normals, across / (2.0 * STEP**2 * lengths), np.ones(len(points)))


def scan_of(function: Function, box: Box, edge: float, colour: Colour) -> Scan:
    """Return the scan of a solid."""
    return Scan((Solid(function, box, edge, colour),), box)


def limbs(ends: Sequence[Limb], blend: float) -> Function:
    """Return limbs that pass smoothly into each other."""
    start, r, end, q = np.split(np.array(ends, dtype=np.float64), (3, 4, 7), axis=1)
    along = end - start
    squared, offset, grows = (along**2).sum(axis=1), (start * along).sum(axis=1), (q - r)[:, 0]

    def function(points: Floats) -> Floats:
        from_start = (points @ along.T - offset) / squared
        t = np.clip(from_start, 0.0, 1.0)
        to_start = (points**2).sum(axis=1)[:, None] - 2.0 * points @ start.T + (start**2).sum(axis=1)
        gaps = np.sqrt(np.maximum(to_start + squared * t * (t - 2.0 * from_start), 0.0)) - r[:, 0] - grows * t
        gaps /= np.sqrt(1.0 + grows**2 / squared)
        smallest = gaps.min(axis=1, keepdims=True)
        total: Floats = smallest[:, 0] - blend * np.log(np.exp((smallest - gaps) / blend).sum(axis=1))
        return total

    return function


def mirrored(ends: Sequence[Limb]) -> list[Limb]:
    """Return ends of limbs at y and at -y."""
    other_side = [[-value if i in (1, 5) else value for i, value in enumerate(limb)] for limb in ends]
    return [*ends, *other_side]


def slab(value: Floats, half: float) -> Floats:
    """Return what is within a distance of 0."""
    return np.abs(value) - half


def rounded(x: Floats, y: Floats, half: tuple[float, float], radius: float) -> Floats:
    """Return a rectangle around the origin with round corners."""
    u, v = np.abs(x) - half[0] + radius, np.abs(y) - half[1] + radius
    return np.hypot(np.maximum(u, 0.0), np.maximum(v, 0.0)) + np.minimum(np.maximum(u, v), 0.0) - radius


def both(*parts: Floats) -> Floats:
    """Return what is in all parts."""
    return np.maximum.reduce(parts)


def either(*parts: Floats) -> Floats:
    """Return what is in any part."""
    return np.minimum.reduce(parts)


def _unit(vectors: Floats) -> Floats:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
