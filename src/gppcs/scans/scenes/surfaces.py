"""Surfaces of scenes, and what a ray meets first. All lengths are in metres.

Each surface has a `look`; a `ball` around it, as centre, (3,), and radius; `meet`, which returns the distances, (N,),
along unit rays, (N, 3), to the surface, infinite where they miss it; and `normals`, (N, 3), at points of the surface,
(N, 3), to either side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
Place = tuple[float, float, float]
NEWTON_STEPS = 12


class Look(NamedTuple):
    """The red, green and blue of a thing, from 0 to 255, and its code of the LAS specification, 64 for others."""

    colour: tuple[int, int, int]
    classification: int


class Polygon:
    """A convex plane polygon, which may have convex holes."""

    def __init__(self, corners: Sequence[Place], look: Look, holes: Sequence[Sequence[Place]] = ()) -> None:
        self.look = look
        self.corners = np.array(corners, np.float64)
        normal = np.cross(self.corners[1] - self.corners[0], self.corners[2] - self.corners[0])
        self.normal = normal / np.linalg.norm(normal)
        self._outline, *self._holes = (self._half_spaces(np.array(ring, np.float64)) for ring in (corners, *holes))

    @property
    def ball(self) -> tuple[Values, float]:
        """As in the module's description."""
        centre = self.corners.mean(axis=0)
        return centre, float(np.linalg.norm(self.corners - centre, axis=1).max())

    def meet(self, origins: Values, directions: Values, rng: np.random.Generator) -> Values:
        """As in the module's description."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distances = ((self.corners[0] - origins) @ self.normal) / (directions @ self.normal)
            ends = origins + distances[:, None] * directions
            inside = _inside(self._outline, ends)
            for hole in self._holes:
                inside &= ~_inside(hole, ends)
        return np.where(inside, _first_ahead(distances), np.inf)

    def normals(self, points: Values) -> Values:
        """As in the module's description."""
        return np.broadcast_to(self.normal, points.shape)

    def _half_spaces(self, ring: Values) -> tuple[Values, Values]:
        """Return the directions inwards from the edges of a ring of corners, (K, 3), and how far along they lie."""
        inwards = np.cross(self.normal, np.roll(ring, -1, axis=0) - ring)
        inwards *= np.sign(_dot(inwards, ring.mean(axis=0) - ring))[:, None]
        return inwards, _dot(inwards, ring)


@dataclass(frozen=True)
class Cylinder:
    """The open side of a cylinder."""

    start: Place
    end: Place
    radius: float
    look: Look

    @property
    def ball(self) -> tuple[Values, float]:
        """As in the module's description."""
        return np.add(self.start, self.end) / 2.0, float(np.hypot(self._axis[1] / 2.0, self.radius))

    @property
    def _axis(self) -> tuple[Values, float]:
        """The direction of the axis, (3,), and its length."""
        along = np.subtract(self.end, self.start)
        length = float(np.linalg.norm(along))
        return along / length, length

    def meet(self, origins: Values, directions: Values, rng: np.random.Generator) -> Values:
        """As in the module's description."""
        axis, length = self._axis
        offset = origins - self.start
        across, aside = _across(directions, axis), _across(offset, axis)
        roots = _roots(_dot(across, across), _dot(across, aside), _dot(aside, aside) - self.radius**2)
        heights = [(offset @ axis) + root * (directions @ axis) for root in roots]
        within = [(height >= 0.0) & (height <= length) for height in heights]
        return _first_ahead(*(np.where(ok, root, np.nan) for ok, root in zip(within, roots, strict=True)))

    def normals(self, points: Values) -> Values:
        """As in the module's description."""
        return _unit(_across(points - self.start, self._axis[0]))


@dataclass(frozen=True)
class Sphere:
    """A sphere."""

    centre: Place
    radius: float
    look: Look

    @property
    def ball(self) -> tuple[Values, float]:
        """As in the module's description."""
        return np.array(self.centre), self.radius

    def meet(self, origins: Values, directions: Values, rng: np.random.Generator) -> Values:
        """As in the module's description."""
        return _first_ahead(*self._ends(origins, directions))

    def normals(self, points: Values) -> Values:
        """As in the module's description."""
        return _unit(points - self.centre)

    def _ends(self, origins: Values, directions: Values) -> tuple[Values, Values]:
        """Return the distances, (N,) each, along rays at which these enter and leave; NaN where they miss."""
        offset = origins - self.centre
        return _roots(1.0, _dot(offset, directions), _dot(offset, offset) - self.radius**2)


@dataclass(frozen=True)
class Foliage(Sphere):
    """Leaves in a ball: a ray meets one after a random way, by the law of Beer and Lambert. They have no normals."""

    mean_way: float

    def meet(self, origins: Values, directions: Values, rng: np.random.Generator) -> Values:
        """As in the module's description."""
        enter, leave = self._ends(origins, directions)
        met = np.maximum(enter, 0.0) + rng.exponential(self.mean_way, len(origins))
        return np.where(met < leave, met, np.inf)

    def normals(self, points: Values) -> Values:
        """Return zeros."""
        return np.zeros(points.shape)


@dataclass(frozen=True)
class Relief:
    """The graph of a smooth height, given with its slopes, over the square from -half to half."""

    height: Callable[[Values, Values], tuple[Values, Values, Values]]
    half: float
    heights: tuple[float, float]
    look: Look

    @property
    def ball(self) -> tuple[Values, float]:
        """As in the module's description."""
        low, high = self.heights
        corner = (self.half, self.half, (high - low) / 2.0)
        return np.array([0.0, 0.0, (low + high) / 2.0]), float(np.linalg.norm(corner))

    def meet(self, origins: Values, directions: Values, rng: np.random.Generator) -> Values:
        """Return the distances, (N,), along rays from above, steeper than any slope."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distances = (np.mean(self.heights) - origins[:, 2]) / directions[:, 2]
            for _ in range(NEWTON_STEPS):
                x, y, z = (origins + distances[:, None] * directions).T
                height, along_x, along_y = self.height(x, y)
                fall = directions[:, 2] - along_x * directions[:, 0] - along_y * directions[:, 1]
                distances = distances - (z - height) / fall
            x, y, _ = (origins + distances[:, None] * directions).T
        within = np.maximum(np.abs(x), np.abs(y)) <= self.half
        return np.where(within, _first_ahead(distances), np.inf)

    def normals(self, points: Values) -> Values:
        """As in the module's description."""
        _, along_x, along_y = self.height(points[:, 0], points[:, 1])
        return _unit(np.stack([-along_x, -along_y, np.ones(len(points))], axis=1))


Surface = Polygon | Cylinder | Sphere | Foliage | Relief


def box(
    centre: tuple[float, float],
    size: tuple[float, float],
    heights: tuple[float, float],
    look: Look,
    angle: float = 0.0,
    top: tuple[float, float] | None = None,
) -> list[Polygon]:
    """Return the six faces of an upright box, or of a truncated pyramid if its top has another size."""
    c, s = np.cos(angle), np.sin(angle)

    def ring(size: tuple[float, float], z: float) -> list[Place]:
        half = [(x * size[0] / 2.0, y * size[1] / 2.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return [(float(centre[0] + c * x - s * y), float(centre[1] + s * x + c * y), z) for x, y in half]

    low, high = ring(size, heights[0]), ring(top or size, heights[1])
    return [Polygon(corners, look) for corners in (low, high, *joined(low, high))]


def joined(ring: Sequence[Place], other: Sequence[Place]) -> list[list[Place]]:
    """Return the corners of the faces between two rings of as many corners."""
    return [[ring[i - 1], ring[i], other[i], other[i - 1]] for i in range(len(ring))]


def _dot(a: Values, b: Values) -> Values:
    product: Values = np.einsum("...i,...i->...", a, b)
    return product


def _unit(vectors: Values) -> Values:
    unit: Values = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


def _across(vectors: Values, axis: Values) -> Values:
    """Return the parts of vectors, (N, 3), across a unit axis."""
    return vectors - (vectors @ axis)[:, None] * axis


def _inside(half_spaces: tuple[Values, Values], points: Values) -> NDArray[np.bool_]:
    """Return which points of a plane, (N, 3), are in all half spaces."""
    return np.logical_and.reduce([points @ inward >= least for inward, least in zip(*half_spaces, strict=True)])


def _first_ahead(*distances: Values) -> Values:
    """Return the least positive distance of each ray, infinite where there is none (NaN is none)."""
    return np.minimum.reduce([np.where(distance > 0.0, distance, np.inf) for distance in distances])


def _roots(a: Values | float, half_b: Values, c: Values) -> tuple[Values, Values]:
    """Return both roots of a t² + 2 half_b t + c, NaN where they are not real."""
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(half_b * half_b - a * c)
        return (-half_b - root) / a, (-half_b + root) / a
