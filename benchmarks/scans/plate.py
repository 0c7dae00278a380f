"""The plate: a slightly bent sheet with a slot, and with holes of two sizes."""

import numpy as np

from gppcs.engine.arrays import Floats
from scans.implicit import both, either, rounded, scan_of, slab

HALF, CORNER = (55.0, 35.0), 8.0
THICKNESS = 1.5
RADIUS = 400.0  # of the bend


def _plate(points: Floats) -> Floats:
    x, y, z = points.T
    sheet = both(rounded(x, y, HALF, CORNER), slab(z - x**2 / (2.0 * RADIUS), THICKNESS / 2.0) / 1.02)
    corners = np.hypot(np.abs(x) - 46.0, np.abs(y) - 26.0) - 3.0
    u, v = (np.clip(np.round(value / 8.0), -count, count) for value, count in ((x + 16.0, 2), (y, 2)))
    grid = np.hypot(x + 16.0 - 8.0 * u, y - 8.0 * v) - 2.5
    slot = rounded(x - 25.0, y, (5.0, 18.0), 5.0)
    return both(sheet, -either(corners, grid, slot))


PLATE = scan_of(_plate, ((-55.0, -35.0, -0.8), (55.0, 35.0, 4.6)), 1.5, (186, 188, 192))
