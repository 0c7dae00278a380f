"""The case: the lower half of a thin-walled housing, with ribs, bosses, slots and holes."""

import numpy as np

from gppcs.engine.arrays import Floats
from scans.implicit import both, either, rounded, scan_of, slab

HALF, HEIGHT, CORNER = (50.0, 32.0), 28.0, 7.0
WALL = 2.0


def _case(points: Floats) -> Floats:
    x, y, z = points.T
    inner = rounded(x, y, (HALF[0] - WALL, HALF[1] - WALL), CORNER - WALL)
    shell = both(rounded(x, y, HALF, CORNER), slab(z - HEIGHT / 2.0, HEIGHT / 2.0), -both(inner, WALL - z))
    ribs = [both(slab(x - at, 0.8), z - 9.0) for at in (-27.0, -9.0, 9.0, 27.0)] + [both(slab(y, 0.8), z - 7.0)]
    bosses = np.hypot(np.abs(x) - 41.0, np.abs(y) - 23.0)
    posts = both(bosses - 4.0, z - 20.0)
    inside = both(either(*ribs, posts), inner - 0.5, 1.0 - z)
    slots = [both(slab(x - at, 1.5), slab(z - 17.0, 6.0), y) for at in np.linspace(-30.0, 30.0, 9)]
    plug = both(np.hypot(y, z - 16.0) - 7.0, 40.0 - x)
    screws = both(bosses - 1.6, 4.0 - z)
    return both(either(shell, inside), -either(*slots, plug, screws))


CASE = scan_of(_case, ((-50.0, -32.0, 0.0), (50.0, 32.0, 28.0)), 1.5, (92, 104, 116))
