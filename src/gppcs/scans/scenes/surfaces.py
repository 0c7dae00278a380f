"""Surfaces of scenes: what a ray meets first, and the distance of any point. All lengths are in metres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
Place = tuple[float, float, float]
NEWTON_STEPS = 12


@dataclass(frozen=True)
class Look:
    """What kind of thing a surface belongs to.

    Attributes
    ----------
    colour : (red, green, blue)
        From 0 to 255.
    classification : int
        Code of the LAS specification (ASPRS): 2 ground, 5 high vegetation, 6 building, 11 road, 14 wire, 15 pole or
        pylon; 64, which the specification leaves to users, is everything else.
    """

    colour: tuple[int, int, int]
    classification: int


class Surface(Protocol):
    """A surface that rays can meet."""

    @property
    def look(self) -> Look:
        """What kind of thing it belongs to."""

    @property
    def ball(self) -> tuple[Values, float]:
        """Centre, (3,), and radius of a ball around the surface."""

    def meet(self, origins: Values, directions: Values, rng: np.random.Generator) -> Values:
        """Return the distances, (N,), along unit rays, (N, 3), to the surface; infinite where they miss it."""

    def normals(self, points: Values) -> Values:
        """Return unit normals, (N, 3), at points of the surface, (N, 3), to either side."""

    def distances(self, points: Values) -> Values:
        """Return the distances, (N,), of any points, (N, 3), from the surface."""


def _dot(a: Values, b: Values) -> Values:
    product: Values = np.einsum("...i,...i->...", a, b)
    return product


def _first_ahead(*distances: Values) -> Values:
    """Return the least positive distance of each ray, infinite where there is none (NaN is none)."""
    ahead = [np.where(distance > 0.0, distance, np.inf) for distance in distances]
    return np.minimum.reduce(ahead)


def _roots(a: Values | float, half_b: Values, c: Values) -> tuple[Values, Values]:
    """Return both roots of a t² + 2 half_b t + c, NaN where they are not real."""
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(half_b * half_b - a * c)
        return (-half_b - root) / a, (-half_b + root) / a


class Ring:
    """The half spaces that bound a convex polygon in its plane."""

    def __init__(self, corners: Values, normal: Values) -> None:
        self.corners = corners
        inwards = np.cross(normal, np.roll(corners, -1, axis=0) - corners).astype(np.float64)
        self.inwards = inwards * np.sign(_dot(inwards, corners.mean(axis=0) - corners))[:, None]
        self.offsets = _dot(self.inwards, corners)

    def contains(self, points: Values) -> NDArray[np.bool_]:
        """Return whether points of the plane, (N, 3), are inside, (N,)."""
        return np.logical_and.reduce(
            [points @ inward >= offset for inward, offset in zip(self.inwards, self.offsets, strict=True)]
        )

    def distances(self, points: Values) -> Values:
        """Return the distances, (N,), of points, (N, 3), from the edges."""
        nearest = np.full(len(points), np.inf)
        for start, end in zip(self.corners, np.roll(self.corners, -1, axis=0), strict=True):
            along = end - start
            share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
            nearest = np.minimum(nearest, np.linalg.norm(points - start - share[:, None] * along, axis=1))
        return nearest


class Polygon:
    """A convex plane polygon, which may have holes."""

    def __init__(self, corners: list[Place], look: Look, holes: list[list[Place]] | None = None) -> None:
        self.look = look
        places = np.array(corners, np.float64)
        normal = np.cross(places[1] - places[0], places[2] - places[0])
        self.normal = normal / np.linalg.norm(normal)
        self.outline = Ring(places, self.normal)
        self.holes = [Ring(np.array(hole, np.float64), self.normal) for hole in holes or []]

    @property
    def ball(self) -> tuple[Values, float]:
        """As in `Surface`."""
        corners = self.outline.corners
        centre = corners.mean(axis=0)
        return centre, float(np.linalg.norm(corners - centre, axis=1).max())

    def meet(self, origins: Values, directions: Values, rng: np.random.Generator) -> Values:
        """As in `Surface`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distances = ((self.outline.corners[0] - origins) @ self.normal) / (directions @ self.normal)
            there = self._contains(origins + distances[:, None] * directions)
        return np.where(there, _first_ahead(distances), np.inf)

    def normals(self, points: Values) -> Values:
        """As in `Surface`."""
        return np.broadcast_to(self.normal, points.shape)

    def distances(self, points: Values) -> Values:
        """As in `Surface`."""
        height = (points - self.outline.corners[0]) @ self.normal
        edges = np.minimum.reduce([ring.distances(points) for ring in (self.outline, *self.holes)])
        return np.where(self._contains(points - height[:, None] * self.normal), np.abs(height), edges)

    def _contains(self, points: Values) -> NDArray[np.bool_]:
        """Return whether points of the plane, (N, 3), are in the polygon and in no hole, (N,)."""
        inside = self.outline.contains(points)
        for hole in self.holes:
            inside &= ~hole.contains(points)
        return inside


class Faces:
    """Many polygons without holes, which rays meet all at once."""

    def __init__(self, polygons: list[Polygon]) -> None:
        most = max(len(polygon.outline.corners) for polygon in polygons)
        self._normals = np.array([polygon.normal for polygon in polygons])
        self._heights = np.array([polygon.normal @ polygon.outline.corners[0] for polygon in polygons])
        self._inwards = np.zeros((most, len(polygons), 3))
        self._offsets = np.full((most, len(polygons)), -1.0)  # of edges that are not there: all is inside
        for number, polygon in enumerate(polygons):
            edges = len(polygon.outline.corners)
            self._inwards[:edges, number], self._offsets[:edges, number] = (
                polygon.outline.inwards,
                polygon.outline.offsets,
            )

    def meet(self, origins: Values, directions: Values, numbers: NDArray[np.int64]) -> tuple[Values, NDArray[np.int64]]:
        """Return the distances, (N,), along rays to the first of some polygons, and its place in `numbers`, (N,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distances = self._heights[numbers] - origins @ self._normals[numbers].T
            distances /= directions @ self._normals[numbers].T
            inside = distances > 0.0
            for inwards, offsets in zip(self._inwards[:, numbers], self._offsets[:, numbers], strict=True):
                inside &= origins @ inwards.T + distances * (directions @ inwards.T) >= offsets
        distances[~inside] = np.inf
        first = distances.argmin(axis=1)
        return distances[np.arange(len(first)), first], first


@dataclass(frozen=True)
class Cylinder:
    """The open side of a cylinder."""

    start: Place
    end: Place
    radius: float
    look: Look

    @property
    def ball(self) -> tuple[Values, float]:
        """As in `Surface`."""
        start, end = np.array(self.start), np.array(self.end)
        return (start + end) / 2.0, float(np.hypot(np.linalg.norm(end - start) / 2.0, self.radius))

    @property
    def _axis(self) -> tuple[Values, float]:
        along = np.array(self.end) - np.array(self.start)
        length = float(np.linalg.norm(along))
        return along / length, length

    def meet(self, origins: Values, directions: Values, rng: np.random.Generator) -> Values:
        """As in `Surface`."""
        axis, length = self._axis
        offset = origins - np.array(self.start)
        across = directions - (directions @ axis)[:, None] * axis
        aside = offset - (offset @ axis)[:, None] * axis
        roots = _roots(_dot(across, across), _dot(across, aside), _dot(aside, aside) - self.radius**2)
        heights = [(offset @ axis) + root * (directions @ axis) for root in roots]
        within = [(height >= 0.0) & (height <= length) for height in heights]
        return _first_ahead(*(np.where(ok, root, np.nan) for ok, root in zip(within, roots, strict=True)))

    def normals(self, points: Values) -> Values:
        """As in `Surface`."""
        axis, _ = self._axis
        aside = points - np.array(self.start)
        aside = aside - (aside @ axis)[:, None] * axis
        normals: Values = aside / np.linalg.norm(aside, axis=1, keepdims=True)
        return normals

    def distances(self, points: Values) -> Values:
        """As in `Surface`."""
        axis, length = self._axis
        offset = points - np.array(self.start)
        height = offset @ axis
        aside = np.linalg.norm(offset - height[:, None] * axis, axis=1)
        distances: Values = np.hypot(aside - self.radius, np.maximum(0.0, np.maximum(-height, height - length)))
        return distances


@dataclass(frozen=True)
class Sphere:
    """A sphere."""

    centre: Place
    radius: float
    look: Look

    @property
    def ball(self) -> tuple[Values, float]:
        """As in `Surface`."""
        return np.array(self.centre), self.radius

    def meet(self, origins: Values, directions: Values, rng: np.random.Generator) -> Values:
        """As in `Surface`."""
        return _first_ahead(*self.ends(origins, directions))

    def ends(self, origins: Values, directions: Values) -> tuple[Values, Values]:
        """Return the distances, (N,) each, along rays at which these enter and leave; NaN where they miss."""
        offset = origins - np.array(self.centre)
        return _roots(1.0, _dot(offset, directions), _dot(offset, offset) - self.radius**2)

    def normals(self, points: Values) -> Values:
        """As in `Surface`."""
        outwards = points - np.array(self.centre)
        normals: Values = outwards / np.linalg.norm(outwards, axis=1, keepdims=True)
        return normals

    def distances(self, points: Values) -> Values:
        """As in `Surface`."""
        distances: Values = np.abs(np.linalg.norm(points - np.array(self.centre), axis=1) - self.radius)
        return distances


@dataclass(frozen=True)
class Foliage:
    """Leaves in a ball: a ray meets one after a random way, by the law of Beer and Lambert. They have no normals."""

    centre: Place
    radius: float
    mean_way: float
    look: Look

    @property
    def ball(self) -> tuple[Values, float]:
        """As in `Surface`."""
        return np.array(self.centre), self.radius

    def meet(self, origins: Values, directions: Values, rng: np.random.Generator) -> Values:
        """As in `Surface`."""
        enter, leave = Sphere(self.centre, self.radius, self.look).ends(origins, directions)
        met = np.maximum(enter, 0.0) + rng.exponential(self.mean_way, len(origins))
        return np.where(met < leave, met, np.inf)

    def normals(self, points: Values) -> Values:
        """Return zeros."""
        return np.zeros(points.shape)

    def distances(self, points: Values) -> Values:
        """Return the distances, (N,), from the ball, 0 inside it."""
        return np.maximum(0.0, np.linalg.norm(points - np.array(self.centre), axis=1) - self.radius)


@dataclass(frozen=True)
class Relief:
    """The graph of a smooth height over a rectangle."""

    height: Callable[[Values, Values], tuple[Values, Values, Values]]
    low: tuple[float, float]
    high: tuple[float, float]
    heights: tuple[float, float]
    look: Look = field(default=Look((120, 140, 80), 2))

    @property
    def ball(self) -> tuple[Values, float]:
        """As in `Surface`."""
        low, high = np.array([*self.low, self.heights[0]]), np.array([*self.high, self.heights[1]])
        return (low + high) / 2.0, float(np.linalg.norm(high - low) / 2.0)

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
        within = (x >= self.low[0]) & (x <= self.high[0]) & (y >= self.low[1]) & (y <= self.high[1])
        return np.where(within, _first_ahead(distances), np.inf)

    def normals(self, points: Values) -> Values:
        """As in `Surface`."""
        _, along_x, along_y = self.height(points[:, 0], points[:, 1])
        normals = np.stack([-along_x, -along_y, np.ones(len(points))], axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals

    def distances(self, points: Values) -> Values:
        """Return the distances, (N,), of points near the surface, to first order."""
        height, along_x, along_y = self.height(points[:, 0], points[:, 1])
        distances: Values = np.abs(points[:, 2] - height) / np.sqrt(1.0 + along_x**2 + along_y**2)
        return distances


def box(
    centre: tuple[float, float], size: tuple[float, float], heights: tuple[float, float], look: Look, angle: float = 0.0
) -> list[Polygon]:
    """Return the six faces of an upright box."""
    return prism(centre, size, size, heights, look, angle)


def prism(
    centre: tuple[float, float],
    base: tuple[float, float],
    top: tuple[float, float],
    heights: tuple[float, float],
    look: Look,
    angle: float = 0.0,
) -> list[Polygon]:
    """Return the six faces of an upright truncated pyramid; arguments as of `box`, with a size of its top."""
    c, s = np.cos(angle), np.sin(angle)

    def ring(size: tuple[float, float], z: float) -> list[Place]:
        half = [(x * size[0] / 2.0, y * size[1] / 2.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return [(float(centre[0] + c * x - s * y), float(centre[1] + s * x + c * y), z) for x, y in half]

    low, high = ring(base, heights[0]), ring(top, heights[1])
    sides = [[low[i - 1], low[i], high[i], high[i - 1]] for i in range(4)]
    return [Polygon(corners, look) for corners in (low, high, *sides)]
