"""A scene that a sensor measures by rays: its surfaces are known exactly, and what it hides casts shadows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.scans.scenes.surfaces import Surface

NO_SURFACE = -1


class Rays(NamedTuple):
    """Rays of a sensor, in the order in which it measures: origins and unit directions, (N, 3) each."""

    origins: Floats
    directions: Floats


Measured = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8]]


@dataclass(frozen=True)
class Scene:
    """Surfaces, and the sensor that measures them: about as many rays as asked for, and distances along its rays."""

    surfaces: tuple[Surface, ...]
    rays: Callable[[int], Rays]
    measured: Callable[[Rays, Floats, np.random.Generator], Floats]

    def scan(self, n_points: int, rng: np.random.Generator) -> Measured:
        """Return points, true normals towards the sensor (0 for leaves), colours and classes, in its order."""
        fraction = np.mean(self.follow(self.rays(4096), rng)[1] != NO_SURFACE)
        count, hits = n_points / fraction, 0
        while hits < n_points:
            count = 1.02 * count + 1.0  # a few rays to spare
            rays = self.rays(int(count))
            distances, met = self.follow(rays, rng)
            hits = int(np.count_nonzero(met != NO_SURFACE))
        kept = np.sort(rng.permutation(np.flatnonzero(met != NO_SURFACE))[:n_points])
        return self._seen(Rays(rays.origins[kept], rays.directions[kept]), distances[kept], met[kept], rng)

    def follow(self, rays: Rays, rng: np.random.Generator) -> tuple[Floats, Ints]:
        """Return the distance to what each ray meets first, (N,), and the number of that surface, (N,)."""
        distances = np.full(len(rays.origins), np.inf)
        met = np.full(len(rays.origins), NO_SURFACE)
        centres = np.array([surface.centre for surface in self.surfaces])
        radii = np.array([surface.radius for surface in self.surfaces])
        waiting = [(rays, np.arange(len(distances)), np.arange(len(radii)))]
        while waiting:
            bundle, indices, numbers = waiting.pop()
            middle = bundle.origins.mean(axis=0)
            numbers = numbers[_may_meet(bundle, middle, centres[numbers], radii[numbers])]
            if len(indices) > 1024 and len(numbers):
                for half in _halves(bundle, middle, centres[numbers]):
                    waiting.append((Rays(bundle.origins[half], bundle.directions[half]), indices[half], numbers))
                continue
            for number in numbers:
                to_surface = self.surfaces[number].meet(*bundle, rng)
                nearer = to_surface < distances[indices]
                distances[indices[nearer]], met[indices[nearer]] = to_surface[nearer], number
        return distances, met

    def _seen(self, rays: Rays, distances: Floats, met: Ints, rng: np.random.Generator) -> Measured:
        """Return what the sensor measures of the points that its rays meet."""
        true = rays.origins + distances[:, None] * rays.directions
        normals = np.empty_like(true)
        by_surface = np.argsort(met.astype(np.uint16), kind="stable")
        for part in np.split(by_surface, np.flatnonzero(np.diff(met[by_surface])) + 1):
            normals[part] = self.surfaces[met[part[0]]].normals(true[part])
        normals *= np.where(np.einsum("ni,ni->n", normals, rays.directions) > 0.0, -1.0, 1.0)[:, None]
        looks = [surface.look for surface in self.surfaces]
        colours = np.array([look.colour for look in looks], np.uint8)[met]
        to_sun = np.array([0.36, 0.48, 0.8])
        lightness = 0.45 + 0.55 * (1.0 + normals @ to_sun) / 2.0  # faces that look away are darker
        measured = rays.origins + self.measured(rays, distances, rng)[:, None] * rays.directions
        classification = np.array([look.classification for look in looks], np.uint8)[met]
        colours = (colours * lightness[:, None]).astype(np.uint8)
        return measured.astype(np.float32), normals.astype(np.float32), colours, classification


def _may_meet(bundle: Rays, apex: Floats, centres: Floats, radii: Floats) -> Flags:
    """Return which balls, (S,), a cone around a bundle of rays meets; its apex is a ball around their origins."""
    axis = bundle.directions.mean(axis=0)
    axis /= max(float(np.linalg.norm(axis)), 1e-9)
    offset = bundle.origins - apex
    widths = radii + np.sqrt(np.einsum("ni,ni->n", offset, offset).max())
    half_angle = np.arccos(np.clip((bundle.directions @ axis).min(), -1.0, 1.0))
    far = np.linalg.norm(centres - apex, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        angles = np.arccos(np.clip((centres - apex) @ axis / far, -1.0, 1.0))
        meets: Flags = (far <= widths) | (angles <= half_angle + np.arcsin(np.minimum(widths / far, 1.0)) + 1e-9)
    return meets


def _halves(bundle: Rays, middle: Floats, centres: Floats) -> tuple[Ints, Ints]:
    """Return the indices of two halves of a bundle of rays, whose origins and directions are as like as possible."""
    radius = float(np.median(np.linalg.norm(centres - middle, axis=1)))
    coordinates = [*bundle.directions.T, *(bundle.origins.T / max(radius, 1e-9))]
    order = np.argsort(max(coordinates, key=np.ptp), kind="stable")
    return order[: len(order) // 2], order[len(order) // 2 :]


def with_noise(sigma: float) -> Callable[[Rays, Floats, np.random.Generator], Floats]:
    """Return what a sensor measures whose distances have Gaussian noise."""
    return lambda rays, distances, rng: distances + sigma * rng.standard_normal(len(distances))


def from_the_air(flights: Sequence[float], swath: float, half: float, altitude: float) -> Callable[[int], Rays]:
    """Return rays in parallel scan lines, strip by strip, in the order of time.

    Each strip is seen from a line of flight along y, at its x and the altitude: `swath` to both sides, and in y from
    -half to half.
    """

    def rays(count: int) -> Rays:
        per_strip = count / len(flights)
        # Scan lines are 1.6 times as far from each other as points on a line.
        on_line = max(1, round(np.sqrt(per_strip * 1.6 * swath / half)))
        lines = max(1, int(np.ceil(per_strip / on_line)))
        y, x = np.meshgrid(half * _midpoints(lines), swath * _midpoints(on_line), indexing="ij")
        strips = [np.stack([at + x.ravel(), y.ravel(), np.zeros(y.size)], axis=1) for at in flights]
        aims = np.concatenate(strips)
        origins = np.stack([np.repeat(flights, y.size), aims[:, 1], np.full(len(aims), altitude)], axis=1)
        # Half the rays look a little ahead, half back: so walls and trunks are seen, as by a plane that nods.
        aims[:, 1] += np.where(np.arange(len(aims)) % 2, 1.0, -1.0) * 0.08 * altitude
        directions = aims - origins
        return Rays(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True))

    return rays


def _midpoints(count: int) -> Floats:
    """Return the midpoints of equal parts of the range from -1 to 1."""
    midpoints: Floats = 2.0 * (np.arange(count) + 0.5) / count - 1.0
    return midpoints
