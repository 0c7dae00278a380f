"""The avenue: a car with a turning LiDAR of 32 lasers drives between façades, trees, poles, wires and parked cars."""

from itertools import pairwise

import numpy as np

from gppcs.engine.arrays import Ints
from scans.scene import Rays, Scene, with_noise
from scans.surfaces import Look, Place, Surface, box, cylinder, foliage, joined, polygon, sphere

KERB, FACADE = 3.5, 6.5  # distances of the kerbs and the façades from the middle
KERB_HEIGHT = 0.12
DRIVE = (-12.0, 12.0)  # along x
LASERS = np.radians(np.linspace(-25.0, 35.0, 32))  # elevations

PAVING = Look((160, 156, 148), 2)
GLASS = Look((92, 118, 138), 6)
WOOD = Look((110, 84, 60), 64)
STEEL = Look((120, 124, 128), 15)
RUBBER = Look((40, 40, 42), 64)
WALLS = (Look((206, 178, 140), 6), Look((186, 112, 88), 6), Look((214, 206, 190), 6), Look((168, 176, 160), 6))


def _ground() -> list[Surface]:
    """Return the road, both pavements and their kerbs."""
    end, top = 30.0, KERB_HEIGHT

    def strip(first: tuple[float, float], second: tuple[float, float], look: Look) -> Surface:
        return polygon([(-end, *first), (end, *first), (end, *second), (-end, *second)], look)

    return [
        strip((-KERB, 0.0), (KERB, 0.0), Look((92, 92, 96), 11)),
        *(strip((side * KERB, top), (side * FACADE, top), PAVING) for side in (-1.0, 1.0)),
        *(strip((side * KERB, 0.0), (side * KERB, top), PAVING) for side in (-1.0, 1.0)),
    ]


def _house(x: float, width: float, side: float, depth: float, height: float, look: Look) -> list[Surface]:
    """Return a façade with rows of windows, each a niche with a pane."""
    y, columns = side * (FACADE + depth), int(width // 2.4)
    niches: list[Surface] = []
    holes: list[list[Place]] = []
    for floor in range(int(height // 3.0)):
        for column in range(columns):
            centre, sill = x + (column + 0.5) * width / columns, KERB_HEIGHT + 0.9 + 3.0 * floor
            door = floor == 0 and column == columns // 2
            hole = _upright(centre - 0.55, centre + 0.55, y, *((KERB_HEIGHT, 2.3) if door else (sill, sill + 1.5)))
            pane = [(px, y + side * 0.18, pz) for px, _, pz in hole]
            holes.append(hole)
            niches += [
                polygon(pane, WOOD if door else GLASS),
                *(polygon(corners, look) for corners in joined(hole, pane)),
            ]
    front = _upright(x, x + width, y, 0.0, height)
    back = [(px, side * 11.0, pz) for px, _, pz in front]
    return [polygon(front, look, holes), *(polygon(joined(front, back)[i], look) for i in (0, 2)), *niches]


def _upright(left: float, right: float, y: float, bottom: float, top: float) -> list[Place]:
    return [(left, y, bottom), (right, y, bottom), (right, y, top), (left, y, top)]


def _houses() -> list[Surface]:
    plots = (
        (-28.0, 11.0, 1.0, 0.0, 9.5),
        (-17.0, 8.0, 1.0, 0.5, 12.5),
        (-6.0, 12.0, 1.0, 0.0, 6.8),
        (8.5, 14.0, 1.0, 0.3, 10.0),
        (-26.0, 13.0, -1.0, 0.2, 12.0),
        (-13.0, 9.0, -1.0, 0.0, 9.3),
        (-1.0, 10.0, -1.0, 0.8, 9.8),
        (9.0, 16.0, -1.0, 0.0, 6.5),
    )
    return [face for number, plot in enumerate(plots) for face in _house(*plot, WALLS[number % len(WALLS)])]


def _tree(x: float, y: float, height: float) -> list[Surface]:
    crown = [
        foliage((x + dx, y + dy, height + dz), radius, Look((92, 138, 62), 5), 0.7)
        for dx, dy, dz, radius in ((0, 0, 0, 1.3), (0.7, 0.3, 0.5, 0.9), (-0.6, -0.4, 0.7, 1.0), (0.1, 0.2, 1.3, 0.9))
    ]
    return [cylinder((x, y, KERB_HEIGHT), (x, y, height), 0.14, Look((96, 78, 62), 5)), *crown]


def _car(x: float, y: float, paint: tuple[int, int, int]) -> list[Surface]:
    wheels = [
        cylinder((x + dx, y + side * 0.85, 0.32), (x + dx, y + side * 0.65, 0.32), 0.32, RUBBER)
        for dx in (-1.3, 1.3)
        for side in (-1.0, 1.0)
    ]
    cabin = box((x - 0.15, y), (2.6, 1.6), (0.85, 1.45), GLASS, top=(1.6, 1.35))
    return [*box((x, y), (4.2, 1.7), (0.3, 0.85), Look(paint, 64)), *cabin, *wheels]


def _cables() -> list[Surface]:
    """Return poles on one pavement, and two hanging wires from each to the next."""
    poles = np.linspace(-24.0, 24.0, 5)
    y, top, sag = 4.1, 7.2, 0.6
    surfaces: list[Surface] = [cylinder((x, y, KERB_HEIGHT), (x, y, 7.6), 0.1, STEEL) for x in poles]
    for height in (top, top - 0.5):
        for start, end in pairwise(poles):
            x = np.linspace(start, end, 13)
            z = height - 4.0 * sag * (x - start) * (end - x) / (end - start) ** 2
            nodes = list(zip(x, np.full(13, y), z, strict=True))
            # Thicker than a wire, as is the beam of a laser.
            surfaces += [cylinder(a, b, 0.02, Look((40, 40, 44), 14)) for a, b in pairwise(nodes)]
    return surfaces


def _furniture() -> list[Surface]:
    """Return lamps, bollards, a bench, a sign and a bin."""

    def post(x: float, y: float, top: float, radius: float) -> Surface:
        return cylinder((x, y, KERB_HEIGHT), (x, y, top), radius, STEEL)

    lamps = (-14.0, 2.0, 18.0)
    return [
        *(post(x, -4.0, 5.2, 0.06) for x in lamps),
        *(sphere((x, -4.0, 5.4), 0.22, STEEL) for x in lamps),
        *(post(x, 3.8, 1.0, 0.05) for x in np.linspace(-5.0, 5.0, 9).tolist()),
        *box((6.0, -5.9), (1.6, 0.45), (0.5, 0.55), WOOD),
        *box((6.0, -6.1), (1.6, 0.04), (0.65, 1.0), WOOD),
        *(face for x in (5.4, 6.6) for face in box((x, -5.9), (0.06, 0.4), (KERB_HEIGHT, 0.5), RUBBER)),
        post(-9.0, 3.9, 2.2, 0.03),
        *box((-9.0, 3.9), (0.02, 0.6), (2.2, 2.8), STEEL),
        post(10.0, 4.2, 0.9, 0.25),
    ]


def _cars() -> list[Surface]:
    paints = ((150, 40, 40), (220, 220, 224), (40, 60, 110), (60, 62, 66))
    return [part for x, paint in zip((-15.0, -9.5, 7.0, 13.0), paints, strict=True) for part in _car(x, 2.5, paint)]


def _trees() -> list[Surface]:
    trees = ((-20.0, -5.0, 3.6), (-8.0, -5.0, 4.1), (13.0, -5.2, 3.8), (-12.0, 5.2, 3.9), (17.0, 5.2, 4.3))
    return [part for tree in trees for part in _tree(*tree)]


def _grid(count: int) -> tuple[int, ...]:
    return -(-count // len(LASERS)), len(LASERS)


def _rays(grid: tuple[int, ...], numbers: Ints) -> Rays:
    """Return the rays of all lasers while the car drives, in the order of time."""
    step, laser = np.unravel_index(numbers, grid)
    fraction, elevation = (step + 0.5) / grid[0], LASERS[laser]
    azimuth, x = 2.0 * np.pi * 16 * fraction, DRIVE[0] + (DRIVE[1] - DRIVE[0]) * fraction
    around = np.array([np.cos(azimuth), np.sin(azimuth)]) * np.cos(elevation)
    origins = np.array([x, np.full_like(x, -1.6), np.full_like(x, 1.9)])
    return Rays(origins.T, np.array([*around, np.sin(elevation)]).T)


AVENUE = Scene((*_ground(), *_houses(), *_trees(), *_cars(), *_cables(), *_furniture()), _grid, _rays, with_noise(0.02))
