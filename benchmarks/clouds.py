"""The clouds of `speed.py`: files, samples of the mesh of the Dragon, and a flat scene of uneven density."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numba as nb
import numpy as np
from numpy.typing import NDArray

import gppcs
import report

Array = NDArray[np.float64]

KEPT = 28_000
TENTH = 0.1
DRAGON = report.DATA / "dragon.ply"
NOISE, LITTLE_NOISE = 1e-4, 2e-5  # standard deviations of samples of the mesh, in diagonals of its box
BLOCK = 1_000_000  # points sampled at a time

SIDE = 200.0  # metres, of the square with scanners and buildings
BUILDINGS = 60
SCANNERS = 4
MAST = 12.0  # metres, the height of the scanners, above all buildings
RANGE = (4.0, 120.0)  # metres on the ground
RANGE_NOISE = 0.01  # metres


@dataclass(frozen=True)
class Cloud:
    """A cloud, and the share or the number of its points to keep."""

    name: str
    size: int  # points
    amount: float
    make: Callable[[], Array]
    files: tuple[Path, ...] = ()

    @property
    def n_points(self) -> int:
        """The number of points to keep."""
        return round(self.amount * self.size) if self.amount < 1 else int(self.amount)


def of_file(name: str, file: str, size: int, amount: float) -> Cloud:
    """Return the points of a file as a cloud."""
    path = report.DATA / f"{file}.ply"
    return Cloud(name, size, amount, lambda: gppcs.read(path).points, (path,))


def of_mesh(size: int, amount: float = KEPT, noise: float = NOISE) -> Cloud:
    """Return a cloud of points on the mesh of the Dragon."""
    name = "samples of the Dragon's mesh" + ("" if noise == NOISE else f", noise {noise:.0e}".replace("e-0", "e-"))
    return Cloud(name, size, amount, partial(mesh_sample, size, noise), (DRAGON,))


def mesh_sample(n: int, noise: float) -> Array:
    """Return n points on the mesh of the Dragon, (n, 3), uniform by area, with Gaussian noise."""
    mesh = gppcs.read_mesh(DRAGON)
    areas = np.cumsum(mesh.face_areas())
    noise *= np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    rng = np.random.default_rng(0)
    points = np.empty((n, 3))
    for begin in range(0, n, BLOCK):
        block = points[begin : begin + BLOCK]
        faces = np.searchsorted(areas, rng.random(len(block)) * areas[-1], side="right")
        a, b, c = (mesh.vertices[corner] for corner in mesh.faces[faces].T)
        u, v = rng.random((2, len(block), 1))
        root = np.sqrt(u)
        block[:] = (1 - root) * a + root * (1 - v) * b + root * v * c + noise * rng.standard_normal(block.shape)
    return points


def scene(n: int) -> Array:
    """Return n points, (n, 3), of a flat scene with buildings, as a few laser scanners on masts see it.

    Rays leave a scanner uniformly in azimuth and in the logarithm of the distance at which they would reach the
    ground. So the density on the ground falls with the squared distance. Each ray measures the first surface on its
    way. At the end, a gentle relief lifts ground and buildings together.
    """
    rng = np.random.default_rng(0)
    low = np.zeros((BUILDINGS, 3))
    low[:, :2] = rng.uniform(0, SIDE, (BUILDINGS, 2))
    high = low + rng.uniform((6, 6, 3), (25, 25, 0.8 * MAST), (BUILDINGS, 3))
    masts = np.column_stack([rng.uniform(0.2 * SIDE, 0.8 * SIDE, (SCANNERS, 2)), np.full(SCANNERS, MAST)])
    origins = masts[np.arange(n) * SCANNERS // n]
    azimuth = rng.uniform(0, 2 * np.pi, n)
    distance = RANGE[0] * (RANGE[1] / RANGE[0]) ** rng.random(n)
    rays = np.column_stack([distance * np.cos(azimuth), distance * np.sin(azimuth), np.full(n, -MAST)])
    points = origins + _first_hits(origins, rays, low, high)[:, None] * rays
    points += RANGE_NOISE * rng.standard_normal(points.shape)
    points[:, 2] += 1.5 * np.sin(points[:, 0] / 35) + 1.0 * np.cos(points[:, 1] / 22 + points[:, 0] / 60)
    return points


@nb.njit(cache=True, parallel=True, error_model="numpy")
def _first_hits(origins, rays, low, high):
    """Return where each ray, (n, 3), first enters a box or the ground, as a share of its way to the ground, (n,)."""
    shares = np.ones(len(rays))
    for i in nb.prange(len(rays)):
        for box in range(len(low)):
            enter, leave = 0.0, 1.0
            for axis in range(3):
                a = (low[box, axis] - origins[i, axis]) / rays[i, axis]
                b = (high[box, axis] - origins[i, axis]) / rays[i, axis]
                enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
            if enter <= leave:
                shares[i] = min(shares[i], enter)
    return shares


DRAGON_POINTS = 437_645
SERIES = (  # one shape with more and more points, simplified to the same number
    of_file("Dragon", "dragon", DRAGON_POINTS, KEPT),
    of_mesh(1_400_000),
    of_mesh(5_000_000),
    of_mesh(14_000_000),
)
TENTHS = (  # the same, but a tenth of the points are kept
    of_file("Dragon", "dragon", DRAGON_POINTS, TENTH),
    of_mesh(1_400_000, TENTH),
    of_mesh(5_000_000, TENTH),
    of_mesh(10_000_000, TENTH),
)
DRAGON_SCAN = of_file("Dragon", "dragon", DRAGON_POINTS, 0.03)
SCENE = Cloud("flat scene", 5_000_000, KEPT, partial(scene, 5_000_000))
CLOUDS = (
    of_file("Bunny", "bunny", 35_947, 0.05),
    of_file("Armadillo", "armadillo_173k_resampled", 172_974, 0.05),
    DRAGON_SCAN,
    *SERIES[:-1],
    SCENE,
    SERIES[-1],
    *TENTHS,
    of_mesh(10_000_000, TENTH, LITTLE_NOISE),
)
