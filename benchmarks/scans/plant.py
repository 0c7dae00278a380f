"""The plant: a pot of earth, a stem, and thin leaves that droop."""

import numpy as np

from gppcs.engine.arrays import Floats
from scans.implicit import both, either, limbs, scan_of, slab

THICKNESS = 0.7  # of a leaf
LEAVES = 11
STEM = [[0, 0, 20, 2.2, 1, -1, 60, 1.6], [1, -1, 60, 1.6, 0, 0, 104, 0.9]]
_stem = limbs(STEM, 0.5)


def _leaf(points: Floats, number: int) -> Floats:
    """Return a leaf; each is a golden angle from the one before, higher and smaller."""
    angle, foot, length = 2.39996 * number, 48.0 + 5.0 * number, 34.0 - 1.2 * number
    c, s = np.cos(angle), np.sin(angle)
    along, across = points[:, 0] * c + points[:, 1] * s, points[:, 1] * c - points[:, 0] * s
    at = np.clip(along / length, 0.0, 1.0)
    half = 0.25 * length * np.sin(np.pi * (0.08 + 0.92 * at)) + 0.4
    up = foot + 0.55 * along - 0.02 * along**2 + 0.012 * across**2
    outline = both(np.abs(across) - half, slab(along - length / 2.0, length / 2.0))
    return both(outline, slab(points[:, 2] - up, THICKNESS / 2.0)) / 2.0


def _plant(points: Floats) -> Floats:
    r, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    wide = r - 15.0 - 0.18 * z
    rim = both(slab(r - 19.0, 3.0), slab(z - 29.0, 3.0))
    pot = both(either(wide, rim), slab(z - 16.0, 16.0), -both(wide + 2.0, 26.0 - z)) / 1.02
    return either(pot, _stem(points), *(_leaf(points, number) for number in range(LEAVES)))


PLANT = scan_of(_plant, ((-29.5, -32.0, 0.0), (34.8, 27.0, 105.0)), 1.2, (88, 132, 74))
