"""Ribbed cases with thin walls: a ventilated housing, a crate, a heat sink, an organizer and a louvre."""

import numpy as np

from gppcs.engine.arrays import Floats
from scans.implicit import both, either, rounded, scan_of, slab

WALL = 1.6


def _vents(points: Floats) -> Floats:
    x, y, z = points.T
    inner = both(rounded(x, y, (50.0 - WALL, 32.0 - WALL), 5.0), slab(z - 12.0, 12.0 - WALL))
    shell = both(rounded(x, y, (50.0, 32.0), 6.0), slab(z - 12.0, 12.0), -inner)
    slots = [both(slab(x - at, 1.4), slab(y, 22.0), 12.0 - z) for at in np.linspace(-40.0, 40.0, 13)]
    grid = [both(slab(x - at, 1.4), slab(z - 12.0, 7.0), -y) for at in np.linspace(-40.0, 40.0, 13)]
    return both(shell, -either(*slots, *grid))


def _crate(points: Floats) -> Floats:
    x, y, z = points.T
    half = 46.0, 28.0
    inner = both(rounded(x, y, (half[0] - WALL, half[1] - WALL), 3.0), WALL - z)
    shell = both(rounded(x, y, half, 4.5), slab(z - 18.0, 18.0), -inner)
    upright = either(
        *(slab(x - at, 0.8) for at in np.linspace(-36.0, 36.0, 7)), slab(y - 12.0, 0.8), slab(y + 12.0, 0.8)
    )
    ribs = both(rounded(x, y, (50.0, 32.0), 6.0), -rounded(x, y, (45.0, 27.0), 3.5), slab(z - 16.0, 16.0), upright)
    rim = both(rounded(x, y, (50.0, 32.0), 6.0), -rounded(x, y, (45.0, 27.0), 3.5), slab(z - 35.0, 1.0))
    handles = both(slab(y, 10.0), slab(z - 26.0, 4.0), 40.0 - np.abs(x))
    return both(either(shell, ribs, rim), -handles)


def _sink(points: Floats) -> Floats:
    x, y, z = points.T
    base = both(rounded(x, y, (50.0, 30.0), 2.0), slab(z - 1.5, 1.5))
    fins = [both(slab(x - at, 0.6), slab(y, 29.0), slab(z - 15.0, 13.0)) for at in np.linspace(-46.0, 46.0, 12)]
    screws = np.hypot(np.abs(x) - 41.8, np.abs(y) - 15.0) - 2.2
    return both(either(base, *fins), -both(screws, z - 5.0))


def _organizer(points: Floats) -> Floats:
    x, y, z = points.T
    inner = both(rounded(x, y, (50.0 - WALL, 32.0 - WALL), 4.0), WALL - z)
    shell = both(rounded(x, y, (50.0, 32.0), 5.5), slab(z - 10.0, 10.0), -inner)
    across = either(slab(x + 22.0, 0.7), both(slab(x - 14.0, 0.7), y))
    dividers = either(across, both(slab(y, 0.7), -22.0 - x), both(slab(y - 0.7, 0.7), -14.0 - x))
    return either(shell, both(dividers, rounded(x, y, (49.0, 31.0), 5.0), slab(z - 8.0, 8.0)))


def _louvre(points: Floats) -> Floats:
    x, y, z = points.T
    opening = rounded(x, y, (45.0, 27.0), 2.0)
    frame = both(rounded(x, y, (50.0, 32.0), 4.0), -opening, slab(z - 4.0, 4.0))
    u, v = 0.8 * y + 0.6 * (z - 4.0), 0.8 * (z - 4.0) - 0.6 * y
    slats = [both(slab(u - 5.2 * at, 0.6), slab(v + 3.9 * at, 4.4)) for at in range(-3, 4)]
    return either(frame, both(either(*slats), rounded(x, y, (46.0, 28.0), 3.0)))


VENTS = scan_of(_vents, ((-50.0, -32.0, 0.0), (50.0, 32.0, 24.0)), 1.5, (92, 104, 116))
CRATE = scan_of(_crate, ((-50.0, -32.0, 0.0), (50.0, 32.0, 36.0)), 1.5, (60, 104, 150))
SINK = scan_of(_sink, ((-50.0, -30.0, 0.0), (50.0, 30.0, 28.0)), 1.5, (170, 172, 176))
ORGANIZER = scan_of(_organizer, ((-50.0, -32.0, 0.0), (50.0, 32.0, 20.0)), 1.5, (206, 196, 170))
LOUVRE = scan_of(_louvre, ((-50.0, -32.0, -2.0), (50.0, 32.0, 10.0)), 1.5, (120, 132, 140))
