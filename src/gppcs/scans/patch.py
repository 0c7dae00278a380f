"""Patches: pieces of a surface given by formulas, with exact normals and curvatures; scans consist of patches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats
from gppcs.scans.jets import Jet

if TYPE_CHECKING:
    from gppcs.scans.implicit import Solid

Range = tuple[float, float]
Colour = tuple[int, int, int]
Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # its lower and upper corners
Attributes = dict[str, NDArray[Any]]
Paint = Callable[[Floats, np.random.Generator], Attributes]
Trim = Callable[[Floats, Floats], Flags]


class SurfacePoints(NamedTuple):
    """Points in mm and outward unit normals, (N, 3), mean curvatures, and areas per unit of area in (u, v), (N,)."""

    points: Floats
    normals: Floats
    curvature: Floats
    area_element: Floats


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

    def at(self, u: Floats, v: Floats) -> SurfacePoints:
        """Evaluate the patch at parameters, (N,) each, by its first and second fundamental forms."""
        position = np.stack([jet.parts for jet in self.surface(*Jet.variables(u, v))], axis=2)
        points, along_u, along_v, *second = position
        cross = np.cross(along_u, along_v)
        area_element = np.sqrt(_dot(cross, cross))
        normals = self.side * cross / area_element[:, None]
        e, f, g = _dot(along_u, along_u), _dot(along_u, along_v), _dot(along_v, along_v)
        l, m, n = (_dot(derivative, normals) for derivative in second)  # noqa: E741
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
        return SurfacePoints(*(values[kept] for values in drawn))


@dataclass(frozen=True)
class Scan:
    """A sample scan: patches or a solid with its whole surface, the corners of its box in mm, what paints points."""

    patches: tuple[Patch | Solid, ...]
    box: Box
    paint: Paint | None = None


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


def _in_order(axis: int, *jets: Jet) -> tuple[Jet, Jet, Jet]:
    """Return x, y and z, given the coordinate along an axis and those along the next two in cyclic order."""
    return jets[-axis], jets[1 - axis], jets[2 - axis]


def _dot(a: Floats, b: Floats) -> Floats:
    """Return the products, (N,), of vectors (N, 3)."""
    product: Floats = np.einsum("ni,ni->n", a, b)
    return product
