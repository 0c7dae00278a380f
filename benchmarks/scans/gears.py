"""The gears: two toothed wheels that mesh; one has a thin web with holes, the other a shaft."""

import numpy as np

from gppcs.engine.arrays import Floats
from scans.implicit import both, either, scan_of, slab

PITCH = 3.0  # mm of the pitch diameter per tooth
TEETH = 20, 12
APART = PITCH * sum(TEETH) / 2.0  # distance of the axes


def _toothed(x: Floats, y: Floats, teeth: int, phase: float) -> Floats:
    """Return the outline of a wheel; the phase is the place of a tooth, in turns of one tooth."""
    turn = teeth * np.arctan2(y, x) / (2.0 * np.pi) - phase
    from_tooth = np.abs(turn - np.round(turn))  # 0 in the middle of a tooth, 0.5 in that of a gap
    height = np.clip((0.36 - from_tooth) / 0.24, 0.0, 1.0) * 5.8 - 3.3
    return (np.hypot(x, y) - PITCH * teeth / 2.0 - height) / 4.2


def _gears(points: Floats) -> Floats:
    x, y, z = points.T
    r, around = np.hypot(x, y), np.arctan2(y, x)
    fifth = 2.0 * np.pi / 5.0
    fold = around - np.round(around / fifth) * fifth
    recess = both(9.0 - r, r - 22.0, 2.0 - np.abs(z))
    holes = np.hypot(r * np.cos(fold) - 15.5, r * np.sin(fold)) - 4.0
    bore = either(r - 4.0, both(slab(y, 1.2), slab(x - 3.0, 2.6)))
    wheel = both(_toothed(x, y, TEETH[0], 0.0), slab(z, 6.0), -either(recess, holes, bore))
    x = x - APART
    pinion = both(_toothed(x, y, TEETH[1], 0.5), slab(z, 7.0))
    shaft = both(np.hypot(x, y) - 5.0, slab(z - 3.0, 19.0))
    return either(wheel, pinion, shaft)


GEARS = scan_of(_gears, ((-32.5, -32.5, -16.0), (68.5, 32.5, 22.0)), 1.5, (170, 150, 110))
