"""The moth: a body with feelers and legs, and four wings that are thin curved sheets."""

import numpy as np

from gppcs.engine.arrays import Floats
from scans.implicit import Limb, both, either, limbs, mirrored, scan_of, slab

THICKNESS = 0.9  # of the wings
BODY: list[Limb] = [
    [18, 0, 1, 4.5, 8, 0, 1, 5],  # chest
    [4, 0, 0.5, 4.5, -30, 0, -2, 1.8],
    [24, 0, 1, 3.2, 25, 0, 1, 3.2],  # head
]
SIDE: list[Limb] = [
    [26, 1.5, 2, 0.7, 40, 12, 5, 0.5],  # feeler
    *([x, 2, -2, 0.9, x + lean, 11, -10, 0.7] for x, lean in ((17, 5), (12, 0), (7, -6))),  # legs
    *([x + lean, 11, -10, 0.7, x + 2 * lean, 14, -18, 0.6] for x, lean in ((17, 5), (12, 0), (7, -6))),
]
WINGS = ((13.0, 27.0, 14.0, 27.0, -0.35, 7.0), (-9.0, 20.0, 14.0, 19.0, 0.5, 4.0))  # middle, half axes, turn, rise
_body = limbs([*BODY, *mirrored(SIDE)], 0.6)


def _wing(points: Floats, x: float, y: float, wide: float, long: float, turn: float, rise: float) -> Floats:
    u, v = points[:, 0] - x, np.abs(points[:, 1]) - y
    u, v = np.cos(turn) * u - np.sin(turn) * v, np.sin(turn) * u + np.cos(turn) * v
    outline = (np.hypot(u / wide, v / long) - 1.0) * min(wide, long)
    bend = rise * (points[:, 1] / 50.0) ** 2 + 0.6 * np.sin(0.7 * u) * np.exp(-((u / 12.0) ** 2))
    return both(outline, slab(points[:, 2] - 1.5 - bend, THICKNESS / 2.0) / 1.3)


def _moth(points: Floats) -> Floats:
    return either(_body(points), *(_wing(points, *wing) for wing in WINGS))


MOTH = scan_of(_moth, ((-32.2, -53.3, -19.0), (40.9, 53.3, 10.6)), 1.5, (176, 152, 118))
