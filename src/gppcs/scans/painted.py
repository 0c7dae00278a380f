"""Painted samples, whose detail is colour or intensity, not shape: a wall with a fresco, and a street; in mm."""

import numpy as np

from gppcs.clouds.columns import COLOUR
from gppcs.engine.arrays import Flags, Floats
from gppcs.scans.jets import Jet
from gppcs.scans.patch import Attributes, Patch, Scan

WIDE, HIGH, RELIEF = 4000.0, 3000.0, 4.0  # the wall, and its unevenness
LONG, ACROSS, CAMBER = 20_000.0, 8_000.0, 0.025  # the street, and its slope to both sides
BARE, MARKED = 60.0, 180.0  # intensity of asphalt and of its markings


def coloured(colours: Floats) -> Attributes:
    """Return colours, (N, 3), as attributes."""
    return dict(zip(COLOUR, np.clip(colours, 0, 255).round().astype(np.uint8).T, strict=True))


def laid_over(count: int, ground: tuple[int, int, int], *layers: tuple[Flags, tuple[int, int, int]]) -> Floats:
    """Return colours, (N, 3): that of the last layer that covers a point, or of the ground."""
    colours = np.tile(np.array(ground, dtype=np.float64), (count, 1))
    for where, colour in layers:
        colours[where] = colour
    return colours


def _fresco(points: Floats, rng: np.random.Generator) -> Attributes:
    """Paint the wall: sky, sun, hills, a house and a band of diamonds."""
    x, z = points[:, 0] / 1000.0, points[:, 2] / 1000.0
    far, near = 1.5 + 0.25 * np.sin(2.1 * x), 1.0 + 0.2 * np.sin(3.0 * x + 1.0)
    sun = np.hypot(x - 3.0, z - 2.3)
    house, roof = (np.abs(x - 1.3) < 0.4) & (np.abs(z - 1.3) < 0.3), np.abs(x - 1.3) < 1.2 * (2.05 - z)
    window = (np.abs(np.abs(x - 1.3) - 0.2) < 0.07) & (np.abs(z - 1.35) < 0.1)
    diamonds = np.abs((x / 0.4) % 1.0 - 0.5) + np.abs(z - 0.25) / 0.3 < 0.45
    colours = laid_over(
        len(points), (150, 185, 215),
        (sun < 0.42, (240, 225, 170)),
        (sun < 0.33, (225, 150, 50)),
        (z < far, (120, 150, 110)),
        (house, (215, 200, 170)),
        (roof & (z > 1.6) & (z < 2.05), (165, 65, 45)),
        (window, (60, 60, 80)),
        (z < near, (90, 120, 60)),
        (z < 0.5, (190, 160, 90)),
        (diamonds, (110, 40, 35)),
    )  # fmt: skip
    sky = (z > far) & (sun > 0.42)
    colours[sky] += 25.0 * (z[sky, np.newaxis] - 2.0)
    return coloured(colours)


def _marked(points: Floats, rng: np.random.Generator) -> Attributes:
    """Mark the street: lines along the edges, a broken line in the middle and a crossing; noisy intensity."""
    x, y = points[:, 0] / 1000.0, points[:, 1] / 1000.0
    lines = (np.abs(np.abs(y) - 3.5) < 0.08) | ((np.abs(y) < 0.08) & (x % 4.0 < 2.0))
    crossing = (np.abs(x - 14.0) < 1.5) & (y % 1.0 < 0.5)
    marking = (lines & (np.abs(x - 14.0) > 2.0)) | crossing
    intensity = np.where(marking, MARKED, BARE) + rng.normal(0.0, 3.0, len(points))
    return {"intensity": intensity.round().astype(np.uint16), "marking": marking.astype(np.uint8)}


def _uneven(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
    return u, (u * 0.004).sin() * (v * 0.005).sin() * RELIEF, v


def _cambered(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
    return u, v, (v.squared() * (-CAMBER / ACROSS)) + (u * 0.0006).sin() * 40.0


FRESCO = Scan(
    (Patch(_uneven, (0.0, WIDE), (0.0, HIGH), 1.001, (205, 190, 160)),),
    ((0.0, -RELIEF, 0.0), (WIDE, RELIEF, HIGH)),
    _fresco,
)
STREET = Scan(
    (Patch(_cambered, (0.0, LONG), (-ACROSS / 2.0, ACROSS / 2.0), 1.001, (70, 70, 72)),),
    ((0.0, -ACROSS / 2.0, -CAMBER * ACROSS / 4.0 - 40.0), (LONG, ACROSS / 2.0, 40.0)),
    _marked,
)
