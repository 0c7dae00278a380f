"""Surfaces of scenes, and what a ray meets first. All lengths are in metres."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Flags, Floats

Place = tuple[float, float, float]


class Look(NamedTuple):
    """The red, green and blue of a thing, from 0 to 255, and its code of the LAS specification, 64 for others."""

    colour: tuple[int, int, int]
    classification: int


class Surface(NamedTuple):
    """A surface, which lies in the ball around a centre, (3,)."""

    look: Look
    centre: Floats
    radius: float
    meet: Callable[[Floats, Floats, np.random.Generator], Floats]  # distances along unit rays, infinite beside it
    normals: Callable[[Floats], Floats]  # at points of the surface, (N, 3), to either side


def polygon(corners: Sequence[Place], look: Look, holes: Sequence[Sequence[Place]] = ()) -> Surface:
    """Return a convex plane polygon, which may have convex holes."""
    ring = np.array(corners, np.float64)
    normal = np.cross(ring[1] - ring[0], ring[2] - ring[0])
    normal = normal / np.linalg.norm(normal)
    outline, *gaps = (_half_spaces(np.array(outer, np.float64), normal) for outer in (corners, *holes))

    def meet(origins: Floats, directions: Floats, rng: np.random.Generator) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            distances = _dot(ring[0] - origins, normal) / _dot(directions, normal)
            ends = origins + distances[:, None] * directions
            inside = _inside(outline, ends)
            for gap in gaps:
                inside &= ~_inside(gap, ends)
        return np.where(inside, _first_ahead(distances), np.inf)

    centre = ring.mean(axis=0)
    radius = float(np.linalg.norm(ring - centre, axis=1).max())
    return Surface(look, centre, radius, meet, lambda points: np.broadcast_to(normal, points.shape))


def _half_spaces(ring: Floats, normal: Floats) -> tuple[Floats, Floats]:
    """Return the directions inwards from the edges of a ring of corners, (K, 3), and how far along they lie."""
    inwards = np.cross(normal, np.roll(ring, -1, axis=0) - ring)
    inwards *= np.sign(_dot(inwards, ring.mean(axis=0) - ring))[:, None]
    return inwards, _dot(inwards, ring)


def cylinder(start: Place, end: Place, radius: float, look: Look) -> Surface:
    """Return the open side of a cylinder."""
    along = np.subtract(end, start)
    length = float(np.linalg.norm(along))
    axis = along / length

    def meet(origins: Floats, directions: Floats, rng: np.random.Generator) -> Floats:
        offset = origins - start
        across, beside = _across(directions, axis), _across(offset, axis)
        roots = _roots(_dot(across, across), _dot(across, beside), _dot(beside, beside) - radius**2)
        heights = [_dot(offset + root[:, None] * directions, axis) for root in roots]
        within = [(height >= 0.0) & (height <= length) for height in heights]
        return _first_ahead(*(np.where(ok, root, np.nan) for ok, root in zip(within, roots, strict=True)))

    centre, extent = np.add(start, end) / 2.0, float(np.hypot(length / 2.0, radius))
    return Surface(look, centre, extent, meet, lambda points: _unit(_across(points - start, axis)))


def sphere(centre: Place, radius: float, look: Look) -> Surface:
    """Return a sphere."""

    def meet(origins: Floats, directions: Floats, rng: np.random.Generator) -> Floats:
        return _first_ahead(*_ends(centre, radius, origins, directions))

    return Surface(look, np.array(centre), radius, meet, lambda points: _unit(points - centre))


def foliage(centre: Place, radius: float, look: Look, mean_path: float) -> Surface:
    """Return leaves in a ball, without normals: a ray meets one after a random path (Beer and Lambert)."""

    def meet(origins: Floats, directions: Floats, rng: np.random.Generator) -> Floats:
        enter, leave = _ends(centre, radius, origins, directions)
        met = np.maximum(enter, 0.0) + rng.exponential(mean_path, len(origins))
        return np.where(met < leave, met, np.inf)

    return Surface(look, np.array(centre), radius, meet, lambda points: np.zeros(points.shape))


def _ends(centre: Place, radius: float, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """Return the distances, (N,) each, along rays at which these enter and leave a ball; NaN where they miss."""
    offset = origins - centre
    return _roots(1.0, _dot(offset, directions), _dot(offset, offset) - radius**2)


def relief(
    height: Callable[[Floats, Floats], tuple[Floats, Floats, Floats]],
    half: float,
    heights: tuple[float, float],
    look: Look,
) -> Surface:
    """Return the graph of a smooth height, given with its slopes, over a square; rays are steeper than any slope."""

    def meet(origins: Floats, directions: Floats, rng: np.random.Generator) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            dx, dy, dz = directions.T
            distances = (np.mean(heights) - origins[:, 2]) / dz
            for _ in range(12):  # Newton steps: after one of a micrometre, the error is less than 1e-10
                x, y, z = (origins + distances[:, None] * directions).T
                ground, along_x, along_y = height(x, y)
                step = (z - ground) / (dz - along_x * dx - along_y * dy)
                distances -= step
                if not (np.abs(step) > 1e-6).any():
                    break
            x, y, _ = (origins + distances[:, None] * directions).T
        within = np.maximum(np.abs(x), np.abs(y)) <= half
        return np.where(within, _first_ahead(distances), np.inf)

    def normals(points: Floats) -> Floats:
        _, along_x, along_y = height(points[:, 0], points[:, 1])
        return _unit(np.array([-along_x, -along_y, np.ones(len(points))]).T)

    lower, upper = heights
    radius = float(np.linalg.norm((half, half, (upper - lower) / 2.0)))
    return Surface(look, np.array([0.0, 0.0, (lower + upper) / 2.0]), radius, meet, normals)


def box(
    centre: tuple[float, float],
    size: tuple[float, float],
    heights: tuple[float, float],
    look: Look,
    angle: float = 0.0,
    top: tuple[float, float] | None = None,
) -> list[Surface]:
    """Return the six faces of an upright box, or of a truncated pyramid if its top has another size."""
    c, s = np.cos(angle), np.sin(angle)

    def ring(size: tuple[float, float], z: float) -> list[Place]:
        half = [(x * size[0] / 2.0, y * size[1] / 2.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return [(float(centre[0] + c * x - s * y), float(centre[1] + s * x + c * y), z) for x, y in half]

    bottom, lid = ring(size, heights[0]), ring(top or size, heights[1])
    return [polygon(corners, look) for corners in (bottom, lid, *joined(bottom, lid))]


def joined(ring: Sequence[Place], other: Sequence[Place]) -> list[list[Place]]:
    """Return the corners of the faces between two rings of as many corners."""
    return [[ring[i - 1], ring[i], other[i], other[i - 1]] for i in range(len(ring))]


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("...i,...i->...", a, b)


def _unit(vectors: Floats) -> Floats:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _across(vectors: Floats, axis: Floats) -> Floats:
    """Return the parts of vectors, (N, 3), across a unit axis."""
    return vectors - _dot(vectors, axis)[:, None] * axis


def _inside(half_spaces: tuple[Floats, Floats], points: Floats) -> Flags:
    """Return which points of a plane, (N, 3), are in all half spaces."""
    return np.logical_and.reduce([_dot(points, inward) >= offset for inward, offset in zip(*half_spaces, strict=True)])


def _first_ahead(*distances: Floats) -> Floats:
    """Return the smallest positive distance of each ray, infinite where there is none (NaN is none)."""
    return np.minimum.reduce([np.where(distance > 0.0, distance, np.inf) for distance in distances])


def _roots(a: Floats | float, half_b: Floats, c: Floats) -> tuple[Floats, Floats]:
    """Return both roots of a t² + 2 half_b t + c, NaN where they are not real."""
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(half_b * half_b - a * c)
        return (-half_b - root) / a, (-half_b + root) / a
