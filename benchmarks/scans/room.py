"""The room: an image of a depth camera, with shadows, quantised depth, and noise that grows with distance."""

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from scans.scene import Rays, Scene, midpoints
from scans.surfaces import Look, Place, Surface, box, cylinder, joined, polygon, sphere

CAMERA = np.array([3.7, 0.35, 1.55])
LOOKS_AT = np.array([1.2, 2.6, 0.75])
TANGENTS = np.tan(np.radians([34.0, 27.0]))  # of half the field of view, horizontal and vertical

PLASTER = Look((226, 220, 206), 6)
WOOD = Look((186, 142, 92), 64)
DARK = Look((66, 70, 80), 64)
CLOTH = Look((74, 104, 148), 64)
RED = Look((190, 70, 56), 64)
PAPER = Look((222, 206, 150), 64)


def _walls() -> list[Surface]:
    """Return floor and four walls; a doorway is a niche in the wall at the back."""
    x, y, z = 4.2, 3.6, 2.5
    door: list[Place] = [(2.6, y, 0.0), (3.5, y, 0.0), (3.5, y, 2.05), (2.6, y, 2.05)]
    niche = [(px, y + 0.12, pz) for px, _, pz in door]
    left, _, right, top = joined(door, niche)
    return [
        polygon([(0, 0, 0), (x, 0, 0), (x, y + 0.12, 0), (0, y + 0.12, 0)], Look((150, 112, 78), 2)),
        polygon([(0, 0, 0), (0, y, 0), (0, y, z), (0, 0, z)], PLASTER),
        polygon([(x, 0, 0), (x, y, 0), (x, y, z), (x, 0, z)], PLASTER),
        polygon([(0, 0, 0), (x, 0, 0), (x, 0, z), (0, 0, z)], PLASTER),
        polygon([(0, y, 0), (x, y, 0), (x, y, z), (0, y, z)], PLASTER, [door]),
        polygon([(0, 0, z), (x, 0, z), (x, y, z), (0, y, z)], PLASTER),
        polygon(niche, WOOD),
        *(polygon(corners, PLASTER) for corners in (left, right, top)),
    ]


def _legs(centre: tuple[float, float], size: tuple[float, float], height: float, radius: float) -> list[Surface]:
    corners = [(centre[0] + i * size[0] / 2.0, centre[1] + j * size[1] / 2.0) for i in (-1, 1) for j in (-1, 1)]
    return [cylinder((x, y, 0.0), (x, y, height), radius, DARK) for x, y in corners]


def _desk() -> list[Surface]:
    return [
        *box((0.85, 2.0), (0.75, 1.5), (0.71, 0.74), WOOD),
        *_legs((0.85, 2.0), (0.6, 1.35), 0.71, 0.025),
        *box((0.62, 2.05), (0.05, 0.56), (0.86, 1.2), DARK, 0.1),
        *box((0.66, 2.05), (0.04, 0.06), (0.74, 0.9), DARK, 0.1),
        *box((0.66, 2.05), (0.2, 0.26), (0.74, 0.755), DARK, 0.1),
        *box((0.98, 2.05), (0.14, 0.44), (0.74, 0.765), DARK, 0.05),
        *box((0.95, 1.5), (0.21, 0.3), (0.74, 0.8), PAPER, 0.5),
        cylinder((0.8, 2.55, 0.74), (0.8, 2.55, 0.84), 0.04, RED),
    ]


def _chair() -> list[Surface]:
    centre = (1.65, 1.95)
    back = (centre[0] + 0.2, centre[1])
    return [
        *box(centre, (0.44, 0.44), (0.43, 0.48), CLOTH),
        *box(back, (0.04, 0.42), (0.6, 0.98), CLOTH),
        *box((back[0], back[1] - 0.15), (0.03, 0.03), (0.48, 0.6), DARK),
        *box((back[0], back[1] + 0.15), (0.03, 0.03), (0.48, 0.6), DARK),
        *_legs(centre, (0.38, 0.38), 0.43, 0.015),
    ]


def _shelf() -> list[Surface]:
    """Return a shelf at the back wall, with books."""
    boards = [box((1.55, 3.43), (1.1, 0.3), (z, z + 0.02), WOOD) for z in (0.08, 0.48, 0.88, 1.28, 1.68)]
    sides = [box((x, 3.43), (0.02, 0.3), (0.0, 1.7), WOOD) for x in (1.0, 2.1)]
    colours = (RED, CLOTH, PAPER, DARK)
    books = []
    for row, z in enumerate((0.5, 0.9, 1.3)):
        x = 1.05
        for number in range(6 + row):
            thick, tall, lean = 0.03 + 0.008 * ((number + row) % 4), 0.22 + 0.03 * ((3 * number + row) % 4), 0.0
            books += box(
                (x + thick / 2.0, 3.45 - 0.01 * (number % 3)), (thick, 0.2), (z, z + tall), colours[number % 4], lean
            )
            x += thick + 0.002
    return [face for part in (*boards, *sides, books) for face in part]


def _rest() -> list[Surface]:
    return [
        *box((2.9, 2.3), (0.5, 0.4), (0.0, 0.38), PAPER, 0.6),
        sphere((2.35, 2.75, 0.16), 0.16, RED),
        cylinder((0.3, 3.2, 0.03), (0.3, 3.2, 1.6), 0.015, DARK),
        cylinder((0.3, 3.2, 0.0), (0.3, 3.2, 0.03), 0.15, DARK),
        cylinder((0.3, 3.2, 1.5), (0.3, 3.2, 1.75), 0.18, PAPER),
    ]


def _grid(count: int) -> tuple[int, ...]:
    lines = max(1, round(np.sqrt(count * TANGENTS[1] / TANGENTS[0])))
    return lines, -(-count // lines)


def _rays(grid: tuple[int, ...], numbers: Ints) -> Rays:
    """Return one ray for each pixel, row by row."""
    forward = (LOOKS_AT - CAMERA) / np.linalg.norm(LOOKS_AT - CAMERA)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down, across = (midpoints(at, size) for at, size in zip(np.unravel_index(numbers, grid), grid, strict=True))
    axes = np.array([TANGENTS[0] * right, TANGENTS[1] * np.cross(forward, right), forward])
    directions = np.einsum("ji,jn->in", axes, [across, down, np.ones(len(numbers))])
    directions /= np.sqrt(np.einsum("in,in->n", directions, directions))
    return Rays(np.broadcast_to(CAMERA, (len(numbers), 3)), directions.T)


def _measured(rays: Rays, distances: Floats, rng: np.random.Generator) -> Floats:
    """Return distances along the rays whose depths, along the camera's axis, are noisy and quantised."""
    cosines = rays.directions @ ((LOOKS_AT - CAMERA) / np.linalg.norm(LOOKS_AT - CAMERA))
    # Khoshelham and Elberink (2012), Accuracy and resolution of Kinect depth data, section 3: depth z is measured in
    # steps of about 2.85e-3 z² (in metres), with a standard deviation of half a step. In 1 / z, the steps are equal.
    step = 2.85e-3
    disparity = 1.0 / (step * distances * cosines) + 0.5 * rng.standard_normal(len(distances))
    measured: Floats = 1.0 / (step * np.round(disparity) * cosines)
    return measured


ROOM = Scene((*_walls(), *_desk(), *_chair(), *_shelf(), *_rest()), _grid, _rays, _measured)
