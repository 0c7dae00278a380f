"""The statue: a robed figure with folds, crossed arms and a face; smooth but for the rim of its base.

Its radius is a function of height and angle. Lengths are in millimetres.
"""

import dataclasses

import numpy as np

from gppcs.engine.arrays import Flags, Floats
from gppcs.scans.jets import Jet
from gppcs.scans.painted import coloured, laid_over
from gppcs.scans.patch import Attributes, Patch, Scan, flat

HEIGHT = 100.0
FRONT = -np.pi / 2.0  # angle of the face, which looks along -y
MARBLE = (222, 216, 204)
LEFT, RIGHT, FACE, BACK = -24.6, 24.6, -25.0, 24.0  # bounds along x and y


def _hump(t: Jet, middle: float, width: float) -> Jet:
    """Return a bump of height 1 around a height, as a fraction of the whole."""
    return (-((t - middle) * (1.0 / width)).squared()).exp()


def _towards(angle: Jet, direction: float, width: float) -> Jet:
    """Return a bump of height 1 around a direction, periodic in the angle."""
    return (((angle - direction).cos() - 1.0) * width**-2.0).exp()


def _radius_squared(t: Jet, angle: Jet) -> Jet:
    """Return the square of the radius at a fraction of the height; at the top it falls to 0 with a finite slope."""
    body = _hump(t, 0.0, 0.42) * 15.0 + _hump(t, 0.67, 0.11) * 6.5 - _hump(t, 0.815, 0.035) * 4.5 + 8.5
    shoulders = _hump(t, 0.66, 0.12) * (angle * 2.0).cos() * 2.6
    folds = _hump(t, 0.0, 0.5) * ((angle * 13.0 + t * 5.0).cos() + (angle * 7.0 - t * 9.0).sin() * 0.7)
    sides = (FRONT - 0.75, FRONT + 0.75)
    arms = _hump(t + (angle - FRONT).sin() * 0.06, 0.55, 0.045) * _towards(angle, FRONT, 1.0) * 3.4
    for side in sides:
        arms = arms + _hump(t, 0.6, 0.08) * _towards(angle, side, 0.35) * 1.5
    hair = _hump(t, 0.93, 0.05) * _towards(angle, FRONT + np.pi, 1.1) * ((angle * 26.0 + t * 40.0).cos() * 0.35 + 0.8)
    face = _hump(t, 0.9, 0.018) * _towards(angle, FRONT, 0.15) * 2.2  # the nose
    face = face - _hump(t, 0.872, 0.006) * _towards(angle, FRONT, 0.3) * 0.5  # the mouth
    for side in (FRONT - 0.36, FRONT + 0.36):
        face = face - _hump(t, 0.925, 0.012) * _towards(angle, side, 0.16) * 0.9  # the eyes
    radius = body + shoulders + folds + arms + hair + face
    closed = 1.0 - t.squared().squared().squared().squared()
    return radius.squared() * closed


def _surface(t: Jet, angle: Jet) -> tuple[Jet, Jet, Jet]:
    radius = _radius_squared(t, angle).sqrt()
    return radius * angle.cos(), radius * angle.sin(), t * HEIGHT


def _in_base(x: Floats, y: Floats) -> Flags:
    """Return where, at (n,) x and y, the base is."""
    inside: Flags = x * x + y * y < _radius_squared(*Jet.variables(0.0 * x, np.arctan2(y, x))).value
    return inside


def _dressed(points: Floats, rng: np.random.Generator) -> Attributes:
    """Paint the statue: a robe with a pattern, a belt, a hem with a zigzag, skin and hair."""
    height, angle = points[:, 2] / 100.0, np.arctan2(points[:, 1], points[:, 0])
    zigzag = 0.13 + 0.16 * np.abs((3.0 * angle / np.pi) % 1.0 - 0.5)
    turns, heights = (angle / np.pi * 4.0) % 1.0 - 0.5, (height * 7.0) % 1.0 - 0.5
    from_dot = np.hypot(turns * 0.8, heights)
    robe = (height > 0.29) & (height < 0.47)
    return coloured(laid_over(
        len(points), (150, 40, 40),
        (robe & (from_dot < 0.3), (235, 225, 200)),
        (robe & (from_dot < 0.15), (40, 90, 60)),
        (height < 0.12, (45, 60, 130)),
        (np.abs(height - zigzag) < 0.012, (225, 190, 80)),
        (np.abs(height - 0.5 - 0.03 * np.sin(angle)) < 0.02, (225, 190, 80)),
        (height > 0.86, (222, 178, 145)),
        (height > 0.935, (70, 45, 30)),
    ))  # fmt: skip


STATUE = Scan(
    (
        # The bound of the area element is its maximum on a fine grid, and a little more.
        Patch(_surface, (0.0, 1.0), (-np.pi, np.pi), 3050.0, MARBLE, -1),
        flat(2, 0.0, (LEFT, RIGHT), (FACE, BACK), -1, MARBLE, _in_base),
    ),
    ((LEFT, FACE, 0.0), (RIGHT, BACK, HEIGHT)),
)
PAINTED = dataclasses.replace(STATUE, paint=_dressed)
