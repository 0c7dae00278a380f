"""The village: hills with a stream, houses, trees and a power line, with codes of the LAS specification; in metres."""

from itertools import pairwise

import numpy as np

from gppcs.engine.arrays import Flags, Floats
from gppcs.scans.jets import Jet
from gppcs.scans.patch import Colour, Patch, Place, Scan, Trim, turned

GROUND, TREE, BUILDING, WIRE, PYLON = 2, 5, 6, 14, 15  # codes
HALF = 60.0  # half the side of the square, in x and y
HILLS = ((-30.0, 25.0, 22.0, 7.0), (35.0, -30.0, 18.0, 5.0), (10.0, 50.0, 12.0, -2.5))  # x, y, width and height
HOUSES = (  # x, y, length, width and angle
    (14.0, 12.0, 12.0, 8.0, 0.2), (32.0, 16.0, 10.0, 7.5, 1.7), (20.0, 30.0, 14.0, 9.0, 0.3),
    (-44.0, -30.0, 16.0, 9.0, 0.0), (-22.0, -38.0, 9.0, 7.0, 1.2), (0.0, -44.0, 11.0, 8.0, 2.1),
)  # fmt: skip
TREES = np.random.default_rng(7).normal((-32.0, 28.0), 9.0, (30, 2))  # a wood on one of the hills
PYLONS = ((-55.0, -5.0), (2.0, -21.0), (56.0, -36.0))
EAVES, RIDGE, PYLON_HEIGHT, SAG, WIRE_RADIUS = 3.4, 6.5, 16.0, 1.5, 0.06
GREEN, WALL, ROOF, STEEL = (120, 140, 80), (222, 212, 194), (168, 80, 62), (140, 144, 148)


def _ground(x: Jet, y: Jet) -> tuple[Jet, Jet, Jet]:
    """Return the ground: hills, and a stream that winds along x."""
    from_stream = (y + 12.0 - (x * (1.0 / 18.0)).sin() * 8.0) * 0.4
    z = (-from_stream.squared()).exp() * -1.6
    for at_x, at_y, width, height in HILLS:
        z = z + (((x - at_x).squared() + (y - at_y).squared()) * -(width**-2)).exp() * height
    return x, y, z


def _height(x: float, y: float) -> float:
    return float(_ground(*Jet.variables(np.array([x]), np.array([y])))[2].value[0])


def _outdoors(x: Floats, y: Floats) -> Flags:
    outside = np.ones(len(x), dtype=np.bool_)
    for at_x, at_y, length, width, angle in HOUSES:
        c, s = np.cos(angle), np.sin(angle)
        along, across = c * (x - at_x) + s * (y - at_y), c * (y - at_y) - s * (x - at_x)
        outside &= (np.abs(along) > length / 2.0) | (np.abs(across) > width / 2.0)
    return outside


def _house(x: float, y: float, length: float, width: float, angle: float) -> list[Patch]:
    """Return the walls and the two slopes of the roof."""
    foot, c, s = _height(x, y), np.cos(angle), np.sin(angle)

    def at(along: float, across: float, z: float) -> Place:
        u, v = along * length / 2.0, across * width / 2.0
        return x + c * u - s * v, y + s * u + c * v, foot + z

    def face(start: Place, right: Place, top: Place, colour: Colour, trim: Trim | None = None) -> Patch:
        def surface(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
            x, y, z = (u * (b - a) + v * (c - a) + a for a, b, c in zip(start, right, top, strict=True))
            return x, y, z

        area = float(np.linalg.norm(np.cross(np.subtract(right, start), np.subtract(top, start))))
        return Patch(surface, (0.0, 1.0), (0.0, 1.0), area * (1.0 + 1e-9), colour, 1, trim, BUILDING)

    def below_roof(across: Floats, up: Floats) -> Flags:
        return up * (RIDGE + 1.5) - 1.5 < RIDGE - np.abs(2.0 * across - 1.0) * (RIDGE - EAVES)

    return [
        part
        for side in (-1.0, 1.0)
        for part in (
            face(at(-side, -side, -1.5), at(side, -side, -1.5), at(-side, -side, EAVES), WALL),
            face(at(side, -side, -1.5), at(side, side, -1.5), at(side, -side, RIDGE), WALL, below_roof),
            face(at(-side, -side, EAVES), at(side, -side, EAVES), at(-side, 0.0, RIDGE), ROOF),
        )
    ]


def _tree(x: float, y: float) -> list[Patch]:
    """Return a fir tree: the outlines of its crown and of its trunk, turned about its axis."""
    foot, outline = _height(x, y), [(0.0, 9.0), (2.2, 2.0), (0.2, 2.0), (0.2, -0.3)]
    return [
        turned(2, (x, y), (r, foot + z), (r_below, foot + below), (70, 104, 60), code=TREE)
        for (r, z), (r_below, below) in pairwise(outline)
    ]


def _wire(start: Floats, end: Floats) -> Patch:
    """Return a wire that sags between two places."""
    step = end - start
    sideways = np.array([-step[1], step[0]]) / np.hypot(step[0], step[1]) * WIRE_RADIUS

    def surface(t: Jet, angle: Jet) -> tuple[Jet, Jet, Jet]:
        x, y = (t * step[i] + start[i] + angle.cos() * sideways[i] for i in range(2))
        return x, y, t * step[2] + start[2] + (t.squared() - t) * (4.0 * SAG) + angle.sin() * WIRE_RADIUS

    stretch = WIRE_RADIUS * float(np.linalg.norm(step) + 4.0 * SAG)
    return Patch(surface, (0.0, 1.0), (0.0, 2.0 * np.pi), stretch, (50, 50, 54), -1, code=WIRE)


def _power_line() -> list[Patch]:
    tops = [(x, y, _height(x, y) + PYLON_HEIGHT) for x, y in PYLONS]
    masts = [turned(2, (x, y), (0.3, z), (0.3, z - PYLON_HEIGHT - 0.5), STEEL, code=PYLON) for x, y, z in tops]
    sides = np.array([[0.0, 1.8, -0.5], [0.0, -1.8, -0.5]])
    return masts + [_wire(a + side, b + side) for a, b in pairwise(tops) for side in sides]


VILLAGE = Scan(
    (
        Patch(_ground, (-HALF, HALF), (-HALF, HALF), 1.25, GREEN, trim=_outdoors, code=GROUND),
        *(part for house in HOUSES for part in _house(*house)),
        *(part for tree in TREES.tolist() for part in _tree(*tree)),
        *_power_line(),
    ),
    ((-HALF, -HALF, -2.6), (HALF, HALF, 17.2)),
)
