"""Patches: pieces of a surface given by formulas, with exact normals and curvatures; scans consist of patches."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import NORMALS
from gppcs.clouds.columns import COLOUR
from gppcs.engine.arrays import Flags, Floats
from gppcs.scans.jets import Jet

Range = tuple[float, float]
Colour = tuple[int, int, int]
Place = tuple[float, float, float]
Box = tuple[Place, Place]  # its lower and upper corners
Attributes = dict[str, NDArray[Any]]
Paint = Callable[[Floats, np.random.Generator], Attributes]
Trim = Callable[[Floats, Floats], Flags]
Measured = tuple[NDArray[np.float32], Attributes, Box]  # points, (N, 3), and the box of the surface


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
    code: int | None = None  # of the LAS specification

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
        u, v = rng.uniform(*self.u, count), rng.uniform(*self.v, count)
        threshold = rng.uniform(0.0, self.stretch, count)
        if self.trim is not None:
            inside = self.trim(u, v)
            u, v, threshold = u[inside], v[inside], threshold[inside]
        drawn = self.at(u, v)
        kept = threshold < drawn.area_element
        return SurfacePoints(*(values[kept] for values in drawn))


@dataclass(frozen=True)
class Scan:
    """A sample scan: its parts, the corners of its box, and what paints points."""

    patches: tuple[Patch, ...]
    box: Box
    paint: Paint | None = None

    def measure(self, n_points: int, uneven: float, rng: np.random.Generator) -> Measured:
        """Draw points by rejection sampling."""
        points, normals = np.empty((n_points, 3), np.float32), np.empty((n_points, 3), np.float32)
        curvature, numbers = np.empty(n_points, np.float32), np.empty(n_points, np.int64)
        # Proposals in proportion to the upper bounds of the areas make the accepted points uniform over all patches.
        weights = np.array([patch.weight for patch in self.patches])
        # A scanner at such a distance from the low end of x makes the density at the far end 1 - uneven of the highest.
        growth, start, end = 1.0 / np.sqrt(1.0 - uneven) - 1.0, self.box[0][0], self.box[1][0]
        filled = 0
        while filled < n_points:
            # At most so many at once that their derivatives stay in the CPU cache.
            proposed = rng.multinomial(min(32_768, 64 + 4 * (n_points - filled)), weights / weights.sum())
            by_patch = [patch.draw(count, rng) for patch, count in zip(self.patches, proposed, strict=True)]
            drawn = SurfacePoints(*map(np.concatenate, zip(*by_patch, strict=True)))
            order = rng.permutation(len(drawn.points))
            density = (1.0 + growth * (drawn.points[order, 0] - start) / (end - start)) ** -2.0
            order = order[rng.uniform(0.0, 1.0, len(order)) < density][: n_points - filled]
            new = slice(filled, filled + len(order))
            points[new], normals[new], curvature[new] = (values[order] for values in drawn[:3])
            numbers[new] = np.repeat(np.arange(len(by_patch)), [len(part.points) for part in by_patch])[order]
            filled += len(order)
        # Hollows are darker and ridges brighter, like the patina of a used object.
        lightness = 1.0 + 0.3 * np.tanh(2.0 * curvature)
        base = np.array([patch.colour for patch in self.patches])[numbers]
        colours = np.clip(base * lightness[:, None], 0.0, 255.0).astype(np.uint8)
        attributes: Attributes = {
            **dict(zip(NORMALS, normals.T, strict=True)),
            "curvature": curvature,
            **dict(zip(COLOUR, colours.T, strict=True)),
        }
        if self.patches[0].code is not None:
            attributes["classification"] = np.array([patch.code for patch in self.patches], np.uint8)[numbers]
        if self.paint:
            attributes |= self.paint(points.astype(np.float64), rng)
        return points, attributes, self.box


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
    code: int | None = None,
) -> Patch:
    """Return the surface of revolution of a line segment: a cylinder, cone, disc or ring."""

    def surface(t: Jet, angle: Jet) -> tuple[Jet, Jet, Jet]:
        radius = t * (end[0] - start[0]) + start[0]
        height = t * (end[1] - start[1]) + start[1]
        return _in_order(axis, height, radius * angle.cos() + centre[0], radius * angle.sin() + centre[1])

    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    return Patch(surface, (0.0, 1.0), angle, length * max(start[0], end[0]), colour, 1, trim, code)


def zone(radius: float, height: float, along: Range, angle: Range, colour: Colour) -> Patch:
    """Return a zone of a sphere around the z axis: `along` it, in radii from the centre, which lies at a height."""

    def surface(t: Jet, angle: Jet) -> tuple[Jet, Jet, Jet]:
        ring = (1.0 - t.squared()).sqrt() * radius  # the area is uniform in height and angle (Archimedes)
        return ring * angle.cos(), ring * angle.sin(), t * radius + height

    # The area element is the squared radius; rounding can lift it slightly above.
    return Patch(surface, along, angle, radius**2 * (1.0 + 1e-9), colour, -1)


def _in_order(axis: int, *jets: Jet) -> tuple[Jet, Jet, Jet]:
    """Return x, y and z, given the coordinate along an axis and those along the next two in cyclic order."""
    return jets[-axis], jets[1 - axis], jets[2 - axis]


def _dot(a: Floats, b: Floats) -> Floats:
    """Return the products, (N,), of vectors (N, 3)."""
    return np.einsum("ni,ni->n", a, b)
