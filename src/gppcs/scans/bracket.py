"""The bracket: a closed machine part with sharp edges, holes, a boss and a fillet.

A horizontal plate has its front at -y. A vertical wall with a round top and a bored boss stands at its back. All
lengths are in millimetres.
"""

import numpy as np

from gppcs.engine.arrays import Flags, Floats
from gppcs.scans.patch import Patch, Scan, flat, turned

PLATE_X, PLATE_Y, PLATE_Z = 50.0, 30.0, 10.0  # half width, half depth, height
CORNER = 10.0  # radius of the two front corners
HOLES = ((-40.0, -20.0), (40.0, -20.0), (-40.0, 18.0), (40.0, 18.0))  # centres of the holes
HOLE, SINK = 4.0, 8.0  # countersunk holes: lower radius, radius at the top
WALL_X, WALL_FRONT, WALL_BACK = 30.0, 18.0, 30.0  # half width, y of the front face, y of the back face
EYE = 40.0  # height of the common centre of bore, boss and round top
BOSS, BOSS_FRONT, BORE = 21.0, 8.0, 13.0  # radius of the boss, y of its front face, radius of the bore
FILLET = 8.0  # radius of the concave fillet between plate and wall

STEEL = (150, 164, 180)
MACHINED = (214, 178, 108)


def _in_corner_cut(x: Floats, y: Floats) -> Flags:
    """Return where, at (n,) x and y, the rounding of the front corners removes the plate."""
    over_x, over_y = np.abs(x) - (PLATE_X - CORNER), -y - (PLATE_Y - CORNER)
    return (over_x > 0.0) & (over_y > 0.0) & (np.hypot(over_x, over_y) > CORNER)


def _in_hole(x: Floats, y: Floats, radius: float) -> Flags:
    return np.logical_or.reduce([np.hypot(x - hx, y - hy) < radius for hx, hy in HOLES])


def _plate_top(x: Floats, y: Floats) -> Flags:
    under_wall = (np.abs(x) < WALL_X) & (y > WALL_FRONT - FILLET)
    return ~_in_corner_cut(x, y) & ~_in_hole(x, y, SINK) & ~under_wall


def _arched(z: Floats, x: Floats) -> Flags:
    return (z < EYE) | (np.hypot(x, z - EYE) < WALL_X)


def _wall_back(z: Floats, x: Floats) -> Flags:
    wall = (np.abs(x) < WALL_X) & _arched(z, x) & (np.hypot(x, z - EYE) > BORE)
    return (z < PLATE_Z) | wall


def _wall_side(y: Floats, z: Floats) -> Flags:
    beside_fillet = (z < PLATE_Z + FILLET) & (np.hypot(y - (WALL_FRONT - FILLET), z - (PLATE_Z + FILLET)) > FILLET)
    return (y > WALL_FRONT) | beside_fillet


def _hole(centre: tuple[float, float]) -> tuple[Patch, Patch]:
    throat = PLATE_Z - 4.0  # where the cone ends
    return (
        turned(2, centre, (HOLE, 0.0), (HOLE, throat), MACHINED),
        turned(2, centre, (HOLE, throat), (SINK, PLATE_Z), MACHINED),
    )


def _plate() -> list[Patch]:
    x, y, z = (-PLATE_X, PLATE_X), (-PLATE_Y, PLATE_Y), (0.0, PLATE_Z)
    straight = PLATE_X - CORNER
    corner_y = CORNER - PLATE_Y
    top_down = (CORNER, PLATE_Z), (CORNER, 0.0)
    return [
        flat(2, 0.0, x, y, -1, STEEL, lambda x, y: ~_in_corner_cut(x, y) & ~_in_hole(x, y, HOLE)),
        flat(2, PLATE_Z, x, y, 1, STEEL, _plate_top),
        flat(0, -PLATE_X, (corner_y, PLATE_Y), z, -1, STEEL),
        flat(0, PLATE_X, (corner_y, PLATE_Y), z, 1, STEEL),
        flat(1, -PLATE_Y, z, (-straight, straight), -1, STEEL),
        turned(2, (-straight, corner_y), *top_down, STEEL, (np.pi, 1.5 * np.pi)),
        turned(2, (straight, corner_y), *top_down, STEEL, (1.5 * np.pi, 2.0 * np.pi)),
        *(patch for centre in HOLES for patch in _hole(centre)),
    ]


def _wall() -> list[Patch]:
    x = (-WALL_X, WALL_X)
    side = (WALL_FRONT - FILLET, WALL_BACK), (PLATE_Z, EYE)
    top = EYE + WALL_X
    eye = (EYE, 0.0)  # (z, x): the axes across y, in cyclic order
    hollow = (WALL_FRONT - FILLET, PLATE_Z + FILLET)

    def wall_front(z: Floats, x: Floats) -> Flags:
        return _arched(z, x) & (np.hypot(x, z - EYE) > BOSS)

    return [
        flat(1, WALL_FRONT, (PLATE_Z + FILLET, top), x, -1, STEEL, wall_front),
        flat(1, WALL_BACK, (0.0, top), (-PLATE_X, PLATE_X), 1, STEEL, _wall_back),
        flat(0, -WALL_X, *side, -1, STEEL, _wall_side),
        flat(0, WALL_X, *side, 1, STEEL, _wall_side),
        turned(1, eye, (WALL_X, WALL_BACK), (WALL_X, WALL_FRONT), STEEL, (-0.5 * np.pi, 0.5 * np.pi)),
        turned(1, eye, (BOSS, WALL_FRONT), (BOSS, BOSS_FRONT), STEEL),
        turned(1, eye, (BOSS, BOSS_FRONT), (BORE, BOSS_FRONT), MACHINED),
        turned(1, eye, (BORE, BOSS_FRONT), (BORE, WALL_BACK), MACHINED),
        turned(0, hollow, (FILLET, -WALL_X), (FILLET, WALL_X), STEEL, (-0.5 * np.pi, 0.0)),
    ]


BRACKET = Scan((*_plate(), *_wall()), ((-PLATE_X, -PLATE_Y, 0.0), (PLATE_X, PLATE_Y, EYE + WALL_X)))
