"""A scene that a sensor measures by rays: its surfaces are known exactly, and what it hides casts shadows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import NORMALS
from gppcs.clouds.columns import COLOUR
from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.threads import on_ranges
from gppcs.scans.patch import Measured
from scans.surfaces import Surface

NO_SURFACE = -1
BLOCK = 1 << 16  # rays that are followed at once: their arrays stay in the processor's cache


class Rays(NamedTuple):
    """Rays of a sensor: origins and unit directions, (N, 3) each."""

    origins: Floats
    directions: Floats

    def at(self, indices: Ints) -> Rays:
        """Return the rays of these indices, as arrays whose columns are contiguous."""
        return Rays(*(vectors.T.take(indices, axis=1).T for vectors in self))


Seen = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8]]


@dataclass(frozen=True)
class Scene:
    """Surfaces, and the sensor that measures them: a grid of rays, in the order of time, and distances along them."""

    surfaces: tuple[Surface, ...]
    grid: Callable[[int], tuple[int, ...]]  # the shape of a grid of at least so many rays
    rays: Callable[[tuple[int, ...], Ints], Rays]  # of these numbers in the grid
    measured: Callable[[Rays, Floats, np.random.Generator], Floats]

    def measure(self, n_points: int, uneven: float, rng: np.random.Generator) -> Measured:
        """Return points as the sensor sees them, with their attributes."""
        points, normals, colours, classification = self.scan(n_points, rng)
        attributes = {
            **dict(zip(NORMALS, normals.T, strict=True)),
            "classification": classification,
            **dict(zip(COLOUR, colours.T, strict=True)),
        }
        lower, upper = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
        return points, attributes, (lower, upper)

    def scan(self, n_points: int, rng: np.random.Generator) -> Seen:
        """Return points, true normals towards the sensor (0 for leaves), colours and classes, in its order."""
        grid = self.grid(4096)
        _, met = self.follow(self.rays(grid, np.arange(math.prod(grid))), rng)
        count, hits = n_points / np.mean(met != NO_SURFACE), 0
        while hits < n_points:
            count = 1.02 * count + 1.0  # a few rays to spare
            blocks = self._blocks(self.grid(int(count)), rng)
            ends = np.cumsum([len(points) for points, *_ in blocks])
            hits = int(ends[-1])
        kept = np.ones(hits, bool)
        kept[rng.choice(hits, hits - n_points, replace=False, shuffle=False)] = False
        parts = np.split(kept, ends[:-1])
        points, normals, colours, classes = (
            np.concatenate([values[part] for values, part in zip(column, parts, strict=True)])
            for column in zip(*blocks, strict=True)
        )
        return points, normals, colours, classes

    def _blocks(self, grid: tuple[int, ...], rng: np.random.Generator) -> list[Seen]:
        """Return what the sensor measures with a grid of rays, block by block, each with random numbers of its own."""
        n_rays = math.prod(grid)
        generators = rng.spawn(-(-n_rays // BLOCK))
        blocks: dict[int, Seen] = {}

        def measure(first: int, last: int) -> None:
            for i in range(first, last):
                rays = self.rays(grid, np.arange(i * BLOCK, min((i + 1) * BLOCK, n_rays)))
                distances, met = self.follow(rays, generators[i])
                hits = np.flatnonzero(met != NO_SURFACE)
                blocks[i] = self._seen(rays.at(hits), distances[hits], met[hits], generators[i])

        on_ranges(measure, len(generators))
        return [blocks[i] for i in range(len(generators))]

    def follow(self, rays: Rays, rng: np.random.Generator) -> tuple[Floats, Ints]:
        """Return the distance to what each ray meets first, (N,), and the number of that surface, (N,)."""
        distances = np.full(len(rays.origins), np.inf)
        met = np.full(len(rays.origins), NO_SURFACE)
        centres = np.array([surface.centre for surface in self.surfaces])
        radii = np.array([surface.radius for surface in self.surfaces])
        waiting = [(np.arange(len(distances)), np.arange(len(radii)))]
        while waiting:
            indices, numbers = waiting.pop()
            bundle = rays.at(indices)
            middle = bundle.origins.mean(axis=0)
            numbers = numbers[_may_meet(bundle, middle, centres[numbers], radii[numbers])]
            # Halves meet fewer surfaces, but NumPy's calls cost time, too.
            if len(numbers) and len(indices) > max(1024, 16384 // len(numbers)):
                waiting += [(indices[half], numbers) for half in _halves(bundle, middle, centres[numbers])]
                continue
            nearest = np.full(len(indices), np.inf)
            first = np.full(len(indices), NO_SURFACE)
            for number in numbers:
                to_surface = self.surfaces[number].meet(*bundle, rng)
                np.copyto(first, number, where=to_surface < nearest)
                np.minimum(nearest, to_surface, out=nearest)
            distances[indices], met[indices] = nearest, first
        return distances, met

    def _seen(self, rays: Rays, distances: Floats, met: Ints, rng: np.random.Generator) -> Seen:
        """Return what the sensor measures of the points that its rays meet."""
        true = rays.origins + distances[:, None] * rays.directions
        normals = np.empty_like(true)
        for number in np.flatnonzero(np.bincount(met)):
            part = np.flatnonzero(met == number)
            normals[part] = self.surfaces[number].normals(true.T.take(part, axis=1).T)
        normals *= np.where(np.einsum("ni,ni->n", normals, rays.directions) > 0.0, -1.0, 1.0)[:, None]
        looks = [surface.look for surface in self.surfaces]
        colours = np.array([look.colour for look in looks], np.float64)[met]
        to_sun = np.array([0.36, 0.48, 0.8])
        # Faces that look away are darker.
        lightness = 0.45 + 0.55 * (1.0 + np.einsum("ni,i->n", normals, to_sun)) / 2.0
        points = rays.origins + self.measured(rays, distances, rng)[:, None] * rays.directions
        classification = np.array([look.classification for look in looks], np.uint8)[met]
        colours = (colours * lightness[:, None]).astype(np.uint8)
        return points.astype(np.float32, "C"), normals.astype(np.float32, "C"), colours, classification


def _may_meet(bundle: Rays, apex: Floats, centres: Floats, radii: Floats) -> Flags:
    """Return which balls, (S,), a cone around a bundle of rays meets; its apex is a ball around their origins."""
    axis = bundle.directions.mean(axis=0)
    axis /= max(float(np.linalg.norm(axis)), 1e-9)
    offset = bundle.origins - apex
    widths = radii + np.sqrt(np.einsum("ni,ni->n", offset, offset).max())
    half_angle = np.arccos(np.clip(np.einsum("ni,i->n", bundle.directions, axis).min(), -1.0, 1.0))
    far = np.linalg.norm(centres - apex, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        angles = np.arccos(np.clip((centres - apex) @ axis / far, -1.0, 1.0))
        meets: Flags = (far <= widths) | (angles <= half_angle + np.arcsin(np.minimum(widths / far, 1.0)) + 1e-9)
    return meets


def _halves(bundle: Rays, middle: Floats, centres: Floats) -> tuple[Ints, Ints]:
    """Return the indices of two parts of a bundle of rays, each half as wide in origin or direction."""
    radius = float(np.median(np.linalg.norm(centres - middle, axis=1)))
    coordinates = [*bundle.directions.T, *(bundle.origins.T / max(radius, 1e-9))]
    widest = max(coordinates, key=np.ptp)
    in_first = widest < (widest.min() + widest.max()) / 2.0
    if not in_first.any():  # all are equal
        in_first[::2] = True
    return np.flatnonzero(in_first), np.flatnonzero(~in_first)


def with_noise(sigma: float) -> Callable[[Rays, Floats, np.random.Generator], Floats]:
    """Return what a sensor measures whose distances have Gaussian noise."""
    return lambda rays, distances, rng: distances + sigma * rng.standard_normal(len(distances))


def from_the_air(
    flights: Sequence[float], swath: float, half: float, altitude: float
) -> tuple[Callable[[int], tuple[int, ...]], Callable[[tuple[int, ...], Ints], Rays]]:
    """Return a grid of rays in parallel scan lines, strip by strip, in the order of time.

    Each strip is seen from a line of flight along y, at its x and the altitude: `swath` to both sides, and in y from
    -half to half.
    """

    def grid(count: int) -> tuple[int, ...]:
        per_strip = count / len(flights)
        # Scan lines are 1.6 times as far from each other as points on a line.
        on_line = max(1, round(np.sqrt(per_strip * 1.6 * swath / half)))
        return len(flights), max(1, math.ceil(per_strip / on_line)), on_line

    def rays(grid: tuple[int, ...], numbers: Ints) -> Rays:
        strip, line, column = np.unravel_index(numbers, grid)
        y = half * midpoints(line, grid[1])
        # Half the rays look a little ahead, half back: so walls and trunks are seen, as by a plane that nods.
        ahead = np.where(numbers % 2, 0.08, -0.08) * altitude
        directions = np.array([swath * midpoints(column, grid[2]), ahead, np.full(len(numbers), -altitude)])
        directions /= np.sqrt(np.einsum("in,in->n", directions, directions))
        return Rays(np.array([np.take(flights, strip), y, np.full(len(numbers), altitude)]).T, directions.T)

    return grid, rays


def midpoints(parts: Ints, count: int) -> Floats:
    """Return the midpoints of parts of the range from -1 to 1, of `count` equal ones."""
    middle: Floats = (2.0 * parts + 1.0) / count - 1.0
    return middle
