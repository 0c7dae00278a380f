"""The wood: a slope with trees, boulders and fallen trunks, measured from a drone and from two tripods."""

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from scans.scene import Rays, Scene, from_the_air, with_noise
from scans.surfaces import Look, Place, Surface, cylinder, foliage, polygon, sphere

HALF, SLOPE = 25.0, 0.25  # half the side of the square, and how the ground rises along x
TRIPODS = np.array([(-6.0, -4.0), (7.0, 6.0)])
SEEN = np.radians([-60.0, 75.0])  # the lowest and the highest elevation that a tripod's scanner sees

BARK, GREEN = Look((96, 78, 60), 5), Look((74, 122, 58), 5)
STONE = Look((140, 138, 132), 64)


def _above(place: Floats, height: float) -> Place:
    """Return the place so far above the ground at x and y."""
    return float(place[0]), float(place[1]), SLOPE * float(place[0]) + height


def _tree(foot: Floats, tall: float, rng: np.random.Generator) -> list[Surface]:
    """Return a trunk in two pieces, and branches that each carry leaves."""
    bend, thick = foot + rng.normal(0.0, 0.25, 2), 0.015 * tall
    top = bend + rng.normal(0.0, 0.25, 2)
    parts = [
        cylinder(_above(foot, -0.5), _above(bend, 0.5 * tall), thick, BARK),
        cylinder(_above(bend, 0.5 * tall), _above(top, 0.95 * tall), 0.6 * thick, BARK),
        foliage(_above(top, tall), 0.12 * tall, GREEN, 1.0),
    ]
    for number, at in enumerate(np.linspace(0.5, 0.9, 7)):
        angle, length = 2.4 * number + rng.uniform(0.0, 0.5), 0.22 * tall * (1.3 - at)
        start, end = (bend + length * far * np.array([np.cos(angle), np.sin(angle)]) for far in (0.0, 1.0))
        parts.append(cylinder(_above(start, at * tall), _above(end, (at + 0.05) * tall), 0.25 * thick, BARK))
        parts.append(foliage(_above(end, (at + 0.05) * tall), 0.07 * tall, GREEN, 1.0))
    return parts


def _surfaces() -> tuple[Surface, ...]:
    rng = np.random.default_rng(11)
    corners = np.array([(-HALF, -HALF), (HALF, -HALF), (HALF, HALF), (-HALF, HALF)])
    parts = [polygon([_above(corner, 0.0) for corner in corners], Look((116, 104, 74), 2))]
    feet = HALF * rng.uniform(-0.96, 0.96, (70, 2))
    for foot in feet[np.linalg.norm(feet[:, None] - TRIPODS, axis=2).min(axis=1) > 2.0]:
        parts += _tree(foot, rng.uniform(7.0, 18.0), rng)
    for place in HALF * rng.uniform(-0.9, 0.9, (25, 2)):
        radius = rng.uniform(0.25, 0.9)
        parts.append(sphere(_above(place, -0.3 * radius), radius, STONE))
    for place in HALF * rng.uniform(-0.7, 0.7, (6, 2)):
        end = place + rng.uniform(-5.0, 5.0, 2)
        parts.append(cylinder(_above(place, 0.15), _above(end, 0.25), 0.2, BARK))
    return tuple(parts)


def _grid(count: int) -> tuple[int, ...]:
    on_line = max(1, round(np.sqrt(count / len(TRIPODS) * np.ptp(SEEN) / (2.0 * np.pi))))
    return len(TRIPODS), -(-count // (len(TRIPODS) * on_line)), on_line


def _from_tripods(grid: tuple[int, ...], numbers: Ints) -> Rays:
    """Return the rays of a turning scanner, one upright line after the other, from each tripod."""
    tripod, line, on_line = np.unravel_index(numbers, grid)
    azimuth, elevation = 2.0 * np.pi * line / grid[1], np.linspace(SEEN[0], SEEN[1], grid[2])[on_line]
    around = np.array([np.cos(azimuth), np.sin(azimuth)]) * np.cos(elevation)
    origins = np.transpose([_above(place, 1.7) for place in TRIPODS])
    return Rays(origins.take(tripod, axis=1).T, np.array([*around, np.sin(elevation)]).T)


FOREST = Scene(_surfaces(), *from_the_air((-12.0, 12.0), 14.0, HALF, 120.0), with_noise(0.03))
PLOT = Scene(FOREST.surfaces, _grid, _from_tripods, with_noise(0.005))
