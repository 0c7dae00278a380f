"""The terrain: hills, a stream, houses, trees and a power line, measured from an aeroplane."""

from itertools import pairwise

import numpy as np

from gppcs.engine.arrays import Floats
from scans.scene import Scene, from_the_air, with_noise
from scans.surfaces import Look, Place, Surface, cylinder, foliage, polygon, relief

HALF = 60.0  # half the side of the square, in x and y

WALL = Look((222, 212, 194), 6)


def ground(x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the height of the ground and its slopes along x and y, (N,) each."""
    height, along_x, along_y = 0.02 * x, np.full_like(x, 0.02), np.zeros_like(x)
    for centre, width, tall in (((-30.0, 25.0), 22.0, 7.0), ((35.0, -30.0), 18.0, 5.0), ((10.0, 50.0), 12.0, -2.5)):
        dx, dy = (x - centre[0]) / width, (y - centre[1]) / width
        hill = tall * np.exp(-(dx * dx + dy * dy))
        height += hill
        hill *= -2.0 / width
        along_x += hill * dx
        along_y += hill * dy
    bend = 8.0 * np.sin(x / 18.0)
    across = (y + 12.0 - bend) / 2.5  # of the stream, which winds along x
    bed = -1.6 * np.exp(-across * across)
    height += bed
    bed *= across * (-2.0 / 2.5)
    return height, along_x - (8.0 / 18.0) * np.cos(x / 18.0) * bed, along_y + bed


def _height(x: float, y: float) -> float:
    return float(ground(np.array([x]), np.array([y]))[0][0])


def _house(x: float, y: float, length: float, width: float, angle: float, roof: Look) -> list[Surface]:
    """Return a house with a gable roof."""
    foot, eaves, ridge = _height(x, y) - 1.5, _height(x, y) + 3.4, _height(x, y) + 3.4 + 0.42 * width
    c, s = np.cos(angle), np.sin(angle)

    def at(along: float, across: float, z: float) -> Place:
        u, v = along * length / 2, across * width / 2
        return x + c * u - s * v, y + s * u + c * v, z

    surfaces: list[Surface] = []
    for side in (-1, 1):
        gable = [at(side, -1, foot), at(side, 1, foot), at(side, 1, eaves), at(side, 0, ridge), at(side, -1, eaves)]
        surfaces += [
            polygon([at(-1, side, eaves), at(1, side, eaves), at(1, 0, ridge), at(-1, 0, ridge)], roof),
            polygon([at(-1, side, foot), at(1, side, foot), at(1, side, eaves), at(-1, side, eaves)], WALL),
            polygon(gable, WALL),
        ]
    return surfaces


def _houses() -> list[Surface]:
    plots = (
        (14.0, 12.0, 12.0, 8.0, 0.2),
        (32.0, 16.0, 10.0, 7.5, 1.7),
        (20.0, 30.0, 14.0, 9.0, 0.3),
        (44.0, 34.0, 11.0, 8.0, 0.9),
        (-44.0, -30.0, 16.0, 9.0, 0.0),
        (-22.0, -38.0, 9.0, 7.0, 1.2),
        (0.0, -44.0, 11.0, 8.0, 2.1),
    )
    roofs = (Look((168, 80, 62), 6), Look((116, 116, 122), 6))
    return [face for number, plot in enumerate(plots) for face in _house(*plot, roofs[number % 2])]


def _trees() -> list[Surface]:
    """Return a wood on one hill, and single trees."""
    rng = np.random.default_rng(7)
    wood = rng.normal((-32.0, 28.0), 11.0, (45, 2))
    single = np.array(
        [(5.0, 22.0), (26.0, 4.0), (38.0, 24.0), (-10.0, -30.0), (-34.0, -42.0), (12.0, -32.0), (48.0, -8.0)]
    )
    bark, leaves = Look((92, 76, 60), 5), (Look((84, 128, 60), 5), Look((58, 104, 62), 5))
    parts: list[Surface] = []
    for x, y in np.concatenate([wood[np.abs(wood).max(axis=1) < HALF - 4.0], single]):
        foot, tall, radius, look = _height(x, y), rng.uniform(6.0, 12.0), rng.uniform(1.6, 2.8), leaves[rng.integers(2)]
        top = foot + tall - radius
        parts.append(cylinder((x, y, foot - 0.3), (x, y, top), 0.18, bark))
        parts.append(foliage((x, y, top), radius, look, 2.4))
        parts.append(foliage((x, y, foot + tall - 0.2), 0.6 * radius, look, 2.4))
    return parts


def _power_line() -> list[Surface]:
    """Return three pylons and the wires between them."""
    feet = [(-55.0, -5.0), (2.0, -21.0), (56.0, -36.0)]
    tops = [np.array([x, y, _height(x, y) + 16.0]) for x, y in feet]
    parts: list[Surface] = [
        cylinder((x, y, _height(x, y) - 0.5), (x, y, top[2] + 0.5), 0.3, Look((140, 144, 148), 15))
        for (x, y), top in zip(feet, tops, strict=True)
    ]
    for start, end in pairwise(tops):
        sideways = np.cross(end - start, [0.0, 0.0, 1.0])
        sideways *= 1.8 / np.linalg.norm(sideways)
        fraction = np.linspace(0.0, 1.0, 21)[:, None]
        for offset in (-sideways, sideways):
            nodes = start + offset + fraction * (end - start) - [0.0, 0.0, 6.0] * fraction * (1.0 - fraction)
            parts += [cylinder(tuple(a), tuple(b), 0.06, Look((50, 50, 54), 14)) for a, b in pairwise(nodes)]
    return parts


TERRAIN = Scene(
    (relief(ground, HALF, (-5.0, 9.0), Look((120, 140, 80), 2)), *_houses(), *_trees(), *_power_line()),
    *from_the_air((-36.0, 0.0, 36.0), 40.0, HALF, 500.0),
    with_noise(0.03),
)
