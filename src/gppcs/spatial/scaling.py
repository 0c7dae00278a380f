"""The bounds of a cloud, and its points shifted and scaled to about unit size."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.errors import InputError

NEGLIGIBLE = 1e-100  # of the size: squares of less would vanish
BLOCK = 1 << 10  # points that the nearest cache holds


def bounds(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the greatest coordinates, (3,), of points, (N, 3), N at least 1; NaN where any is NaN."""
    low, high = _bounds_of_chunks(points, min(len(points), 4 * nb.get_num_threads()))
    return low.min(axis=0), high.max(axis=0)


def normalised(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Shift the corner of the bounding box to the origin, and scale by a power of two to about unit size.

    What differs by less than 1e-100 of the size becomes the same, since squares of that would vanish. The corner
    and the exponent of that power, which lead back, are returned as well.

    Raises
    ------
    InputError
        If the range of the coordinates overflows.
    """
    low, high = bounds(points)
    with np.errstate(over="ignore"):
        size = float((high - low).max())
    if not math.isfinite(size):
        raise InputError("expected coordinates whose differences are finite, found a range that overflows")
    exponent = math.frexp(size)[1]  # zero for a size of zero
    half = -exponent // 2
    local = np.empty(points.shape)  # not in the kernel: NumPy asks for large pages
    _shift_and_scale(points, low, math.ldexp(1.0, half), math.ldexp(1.0, -exponent - half), local)
    return local, low, exponent


@nb.njit(cache=True, parallel=True, nogil=True)
def _bounds_of_chunks(points, chunks):
    n = len(points)
    low, high = np.full((chunks, 3), np.inf), np.full((chunks, 3), -np.inf)
    for c in nb.prange(chunks):
        end = n * (c + 1) // chunks
        for begin in range(n * c // chunks, end, BLOCK):
            _widen(points[begin : min(begin + BLOCK, end)], low[c], high[c])
    return low, high


@nb.njit(cache=True)
def _widen(points, low, high):
    for axis in range(3):
        least, greatest = low[axis], high[axis]
        for i in range(len(points)):
            value = points[i, axis]
            if value < least or value != value:  # NaN, once there, stays
                least = value
            if value > greatest or value != value:
                greatest = value
        low[axis], high[axis] = least, greatest


@nb.njit(cache=True, parallel=True, nogil=True)
def _shift_and_scale(points, corner, scale, again, local):
    """Multiply by two powers of two, since one alone could overflow."""
    for i in nb.prange(len(points)):
        for axis in range(3):
            value = (points[i, axis] - corner[axis]) * scale * again
            local[i, axis] = value if value >= NEGLIGIBLE else 0.0
