"""The medallion: fine relief (letters, pearls, a rope, a cut star) on a smooth dome; one side only, in millimetres."""

from functools import cache

import numpy as np

from gppcs.engine.arrays import Floats
from gppcs.scans.jets import Jet
from gppcs.scans.patch import Patch, Scan

RADIUS = 50.0  # of the medallion

INSCRIPTION = "FEWER.POINTS.SAME.SHAPE."
LETTER_RADIUS = 36.0  # of the circle through the middles of the letters
LETTER_SIZE = (4.8, 6.4)  # width, height
# The polylines of each letter, on a grid of 5 by 9 nodes. Two digits are a node: x, then y.
GLYPHS = {
    "A": ["003840", "1333"],
    "E": ["48080040", "0434"],
    "F": ["480800", "0434"],
    "H": ["0008", "4048", "0444"],
    "I": ["2028"],
    "M": ["0008244840"],
    "N": ["00084048"],
    "O": ["103041473818070110"],
    "P": ["00083847453404"],
    "R": ["00083847453404", "2440"],
    "S": ["473818070514344341301001"],
    "T": ["2028", "0848"],
    "W": ["0810243048"],
    ".": ["2424"],
}


@cache
def _strokes() -> Floats:
    """Return the segments x0, y0, x1, y1 of each letter, (letters, strokes, 4), in mm from the middle of its cell."""
    letters = []
    for glyph in INSCRIPTION:
        lines = [np.array([*map(int, line)]).reshape(-1, 2) / (4, 8) - 0.5 for line in GLYPHS[glyph]]
        letters.append(np.concatenate([np.hstack([line[:-1], line[1:]]) for line in lines]) * (LETTER_SIZE * 2))
    table = np.full((len(letters), max(map(len, letters)), 4), 1e3)  # short letters are padded with far strokes
    for row, segments in zip(table, letters, strict=True):
        row[: len(segments)] = segments
    return table


def _plateau(distance_squared: Jet, width: float) -> Jet:
    """Return a bump of height 1 with a flat top; at a distance of `width`, its height is 1/e."""
    return (-(distance_squared * width**-2).squared()).exp()


def _letters(r: Jet, angle: Jet) -> Jet:
    """Return the relief of the inscription, from 0 to 1, in polar coordinates."""
    cell = 2.0 * np.pi / len(INSCRIPTION)
    # The inscription runs clockwise from the left; the feet of the letters point to the centre.
    number = np.floor((np.pi - angle.value) / cell).astype(np.int64) % len(INSCRIPTION)
    middle = np.asarray(np.pi - (number + 0.5) * cell, np.float64)
    x = (angle - middle) * -LETTER_RADIUS
    y = r - LETTER_RADIUS
    bare = x * 0.0 + 1.0
    for x0, y0, x1, y1 in _strokes()[number].transpose(1, 2, 0):
        dx, dy = x1 - x0, y1 - y0
        length_squared = np.maximum(dx * dx + dy * dy, 1e-12)
        along = (((x - x0) * dx + (y - y0) * dy) * (1.0 / length_squared)).clipped(0.0, 1.0)
        distance_squared = (x - x0 - along * dx).squared() + (y - y0 - along * dy).squared()
        bare = bare * (1.0 - _plateau(distance_squared, 0.78))
    return 1.0 - bare


def _star(r: Jet, angle: Jet) -> Jet:
    """Return the height of a five-pointed star of ten plane facets above the field, in mm."""
    tip, notch, peak = 19.0, 8.0, 5.0
    fifth = 2.0 * np.pi / 5.0
    turned = angle - np.pi / 2.0
    nearest_tip = np.round(turned.value / fifth) * fifth
    fold = turned - nearest_tip
    fold = fold * np.sign(fold.value)
    # Between a tip (fold 0) and a notch (fold π/5), the outline is a straight line n · p = c.
    notch_x, notch_y = notch * np.cos(fifth / 2.0), notch * np.sin(fifth / 2.0)
    nx, ny = notch_y, tip - notch_x
    fraction = r * (fold.cos() * nx + fold.sin() * ny) * (1.0 / (nx * tip))
    return (1.0 - fraction) * peak


def _height(s: Jet, angle: Jet) -> Jet:
    """Return the height in mm as a function of s = r² and the angle."""
    r = s.sqrt()
    rope = _plateau((r - 24.5).squared(), 2.6) * ((angle * 48.0 + r * 1.4).cos() * 0.3 + 0.5)
    pearl_spacing = LETTER_RADIUS + 7.5
    pearls = (r - pearl_spacing).squared() + ((angle * 36.0).sin() * (pearl_spacing / 36.0)).squared()
    field = s * (-6.0 / RADIUS**2) + 6.0
    field = field + _plateau((r - 47.9).squared(), 2.0) * 2.2 + rope + _plateau(pearls, 1.25) * 1.0
    field = field + _plateau((r - 30.0).squared(), 0.6) * 0.6
    lettered = np.abs(r.value - LETTER_RADIUS) < LETTER_SIZE[1] / 2.0 + 2.0
    field = field.raised_at(lettered, _letters(r.at(lettered), angle.at(lettered)) * 0.8)
    return field.where_higher(_star(r, angle) + 5.5)


def _surface(s: Jet, angle: Jet) -> tuple[Jet, Jet, Jet]:
    r = s.sqrt()
    return r * angle.cos(), r * angle.sin(), _height(s, angle)


MEDALLION = Scan(
    (Patch(_surface, (0.0, RADIUS**2), (-np.pi, np.pi), 1.25, (198, 146, 78)),),
    ((-RADIUS, -RADIUS, 0.65), (RADIUS, RADIUS, 10.5)),
)
