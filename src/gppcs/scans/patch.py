"""Patches: pieces of a surface given by formulas, with exact normals and curvatures; scans consist of patches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.scans.jets import Jet

Range = tuple[float, float]
Colour = tuple[int, int, int]
Trim = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]]


@dataclass(frozen=True)
class SurfacePoints:
    """Points of a surface, with its exact normals and curvatures.

    Attributes
    ----------
    points : (N, 3) array, float64
        Coordinates in mm.
    normals : (N, 3) array, float64
        Outward unit normals.
    curvature : (N,) array, float64
        Mean curvature in 1/mm, positive where the surface bulges outward: 1/r on a sphere of radius r.
    area_element : (N,) array, float64
        Area on the surface per unit of area in the parameters (u, v).
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    curvature: NDArray[np.float64]
    area_element: NDArray[np.float64]


@dataclass(frozen=True)
class Patch:
    """A piece of a surface S(u, v): the image of a rectangle of the parameters u and v."""

    surface: Callable[[Jet, Jet], tuple[Jet, Jet, Jet]]
    u: Range
    v: Range
    stretch: float
    colour: Colour
    side: int = 1
    trim: Trim | None = None

    @property
    def weight(self) -> float:
        """Upper bound of the area of the patch in mm²."""
        return self.stretch * (self.u[1] - self.u[0]) * (self.v[1] - self.v[0])

    def at(self, u: NDArray[np.float64], v: NDArray[np.float64]) -> SurfacePoints:
        """Evaluate the patch by its first and second fundamental forms.

        Shapes: u, v (N,).
        """
        position = np.stack([jet.parts for jet in self.surface(*Jet.variables(u, v))], axis=2)
        points, along_u, along_v, *second = position
        cross = np.cross(along_u, along_v)
        area_element = np.sqrt(np.einsum("ni,ni->n", cross, cross))
        normals = self.side * cross / area_element[:, None]
        e, f, g = (np.einsum("ni,ni->n", a, b) for a, b in ((along_u, along_u), (along_u, along_v), (along_v, along_v)))
        l, m, n = (np.einsum("ni,ni->n", derivative, normals) for derivative in second)  # noqa: E741
        curvature = -(e * n - 2.0 * f * m + g * l) / (2.0 * area_element**2)
        return SurfacePoints(points, normals, curvature, area_element)

    def draw(self, count: int, rng: np.random.Generator) -> SurfacePoints:
        """Draw points that are uniform by area, by rejection sampling."""
        u = rng.uniform(*self.u, count)
        v = rng.uniform(*self.v, count)
        threshold = rng.uniform(0.0, self.stretch, count)
        if self.trim is not None:
            inside = self.trim(u, v)
            u, v, threshold = u[inside], v[inside], threshold[inside]
        drawn = self.at(u, v)
        kept = threshold < drawn.area_element
        return SurfacePoints(drawn.points[kept], drawn.normals[kept], drawn.curvature[kept], drawn.area_element[kept])


@dataclass(frozen=True)
class Scan:
    """A sample scan, whose surface is known exactly.

    Attributes
    ----------
    description : str
        One line.
    patches : tuple of Patch
        The whole surface, without overlaps.
    box : ((x, y, z), (x, y, z))
        Lowest and highest corner of the bounding box, in mm.
    residual : callable
        Takes points, (N, 3), and returns signed residuals, (N,), in mm. It is a second, implicit description of the
        same surface: zero on the surface and positive outside. Near smooth parts it is the distance, to first order.
    """

    description: str
    patches: tuple[Patch, ...]
    box: tuple[tuple[float, float, float], tuple[float, float, float]]
    residual: Callable[[NDArray[np.float64]], NDArray[np.float64]]


def flat(axis: int, at: float, u: Range, v: Range, side: int, colour: Colour, trim: Trim | None = None) -> Patch:
    """Return a plane face orthogonal to a coordinate axis."""

    def surface(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
        return _in_order(axis, u * 0.0 + at, u, v)

    return Patch(surface, u, v, 1.0, colour, side, trim)


def turned(
    axis: int,
    centre: tuple[float, float],
    start: tuple[float, float],
    end: tuple[float, float],
    colour: Colour,
    angle: Range = (0.0, 2.0 * np.pi),
    trim: Trim | None = None,
) -> Patch:
    """Return the surface of revolution of a line segment: a cylinder, cone, disc or ring."""

    def surface(t: Jet, angle: Jet) -> tuple[Jet, Jet, Jet]:
        radius = t * (end[0] - start[0]) + start[0]
        height = t * (end[1] - start[1]) + start[1]
        return _in_order(axis, height, radius * angle.cos() + centre[0], radius * angle.sin() + centre[1])

    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    return Patch(surface, (0.0, 1.0), angle, length * max(start[0], end[0]), colour, 1, trim)


def _in_order(axis: int, along: Jet, first: Jet, second: Jet) -> tuple[Jet, Jet, Jet]:
    """Return x, y and z, given the coordinate along an axis and those along the next two in cyclic order."""
    coordinates = {axis: along, (axis + 1) % 3: first, (axis + 2) % 3: second}
    return coordinates[0], coordinates[1], coordinates[2]
