"""Tubes, both of whose sheets are near each other everywhere: a horn, a cable's sleeve, a bar and a funnel."""

from itertools import pairwise

import numpy as np

from gppcs.engine.arrays import Floats
from scans.implicit import Function, Limb, both, limbs, scan_of, slab

WALL = 1.2
LEAD, COIL = 20.0, 18.0  # of the cable: height of a turn and radius, in the middle of the sleeve


def _horn(points: Floats) -> Floats:
    x, y, z = points.T
    flare = np.exp(0.09 * (np.clip(z, -50.0, 50.0) - 50.0))
    radius, slope = 5.0 + 22.0 * flare, 1.98 * flare
    return both(slab(np.hypot(x, y) - radius, WALL / 2.0) / np.sqrt(1.0 + slope**2), slab(z, 50.0))


def _bent(path: Floats, radius: float) -> Function:
    """Return a tube along a path, (n, 3), in the plane z = 0, which is open at both ends."""
    ends: list[Limb] = [[*start, radius, *end, radius] for start, end in pairwise(path)]
    around, (first, last) = limbs(ends, 0.3), (path[[0, -1]] - path[[1, -2]])
    caps = [(path[at], way / np.linalg.norm(way)) for at, way in ((0, first), (-1, last))]

    def function(points: Floats) -> Floats:
        beyond = [np.where(points @ way > end @ way - 3.0, (points - end) @ way, -1.0) for end, way in caps]
        near = [np.linalg.norm(points - end, axis=1) < 3.0 * radius for end, _ in caps]
        cut = [np.where(is_near, past, -1.0) for is_near, past in zip(near, beyond, strict=True)]
        return both(slab(around(points) + WALL / 2.0, WALL / 2.0), *cut)

    return function


def _cable(points: Floats) -> Floats:
    x, y, z = points.T
    turn = z / LEAD - np.arctan2(y, x) / (2.0 * np.pi)
    along = LEAD * (turn - np.round(turn)) / np.hypot(1.0, LEAD / (2.0 * np.pi * COIL))
    return both(slab(np.hypot(np.hypot(x, y) - COIL, along) - 4.0, WALL / 2.0) / 1.02, slab(z, 50.0))


def _funnel(points: Floats) -> Floats:
    x, y, z = points.T
    middle, slope = 5.0 + 0.6 * np.maximum(z, 0.0), np.where(z > 0.0, 0.6, 0.0)
    return both(slab(np.hypot(x, y) - middle, 0.7) / np.sqrt(1.0 + slope**2), slab(z - 5.0, 35.0))


BAR_PATH = np.array([
    [-36.0, -30.0, 0.0], [-47.0, -26.0, 0.0], [-48.0, -8.0, 0.0], [-30.0, 0.0, 0.0],
    [30.0, 0.0, 0.0], [48.0, -8.0, 0.0], [47.0, -26.0, 0.0], [36.0, -30.0, 0.0],
])  # fmt: skip

HORN = scan_of(_horn, ((-27.6, -27.6, -50.0), (27.6, 27.6, 50.0)), 1.5, (198, 160, 70))
CABLE = scan_of(_cable, ((-22.6, -22.6, -50.0), (22.6, 22.6, 50.0)), 1.5, (60, 60, 66))
HANDLEBAR = scan_of(_bent(BAR_PATH, 3.5), ((-53.0, -34.0, -3.6), (53.0, 4.0, 3.6)), 1.5, (140, 144, 150))
FUNNEL = scan_of(_funnel, ((-29.8, -29.8, -30.0), (29.8, 29.8, 40.0)), 1.5, (170, 60, 50))
