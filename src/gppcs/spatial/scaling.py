"""Find the bounds of a cloud, and shift and scale it to about unit size."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Floats
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import RANGES, on_ranges
from gppcs.errors import InputError
from gppcs.spatial.units import Units

POINTS_AT_ONCE = 1 << 14  # points that a thread takes at once, at least


def bounds(points: Floats) -> tuple[Floats, Floats]:
    """Return the corners of the bounding box, infinite without points; points (N, 3), corners (3,)."""
    chunks = min(RANGES, len(points) // POINTS_AT_ONCE + 1)
    lower, upper = np.empty((2, chunks, 3))
    lower[:], upper[:] = np.inf, -np.inf
    on_ranges(_bound_chunks, chunks, points, lower, upper)
    return lower.min(axis=0), upper.max(axis=0)


class Frame(NamedTuple):
    """A shift and scales that bring points to about unit size, and all axes to one unit.

    Without different units, the scale is a power of two, so it does not round.
    """

    corner: Floats  # (3,), what becomes the origin: the lower corner of the bounding box
    exponent: int  # Lengths are divided by two to this power
    factors: Floats  # (3,), by which coordinates become lengths; 1 if all axes have one unit

    @classmethod
    def from_bounds(cls, lower: Floats, upper: Floats, units: Units | None = None) -> Frame:
        """Return the frame of a bounding box, with corners (3,), whose axes have these units."""
        factors = units.factors(lower, upper) if units else np.ones(3)
        with np.errstate(over="ignore"):
            size = float(((upper - lower) * factors).max())
        if not math.isfinite(size):
            raise InputError("expected coordinates whose differences are finite, found a range that overflows")
        return cls(lower, math.frexp(size)[1], factors)  # an exponent of zero for a size of zero

    def local(self, points: Floats) -> Floats:
        """Shift and scale points in the box. Shapes: points (n, 3); returns (n, 3)."""
        half = -self.exponent // 2
        local = np.empty(points.shape)  # allocated here because NumPy, unlike Numba, asks for large memory pages
        scales, again = np.ldexp(self.factors, half), math.ldexp(1.0, -self.exponent - half)
        on_ranges(_shift_and_scale, len(points), points, self.corner, scales, again, local, minimum=POINTS_AT_ONCE)
        return local

    def near(self, points: Floats) -> Floats:
        """Shift and scale points, (n, 3), that may lie outside the box."""
        return np.ldexp((points - self.corner) * self.factors, -self.exponent)

    def world(self, local: Floats) -> Floats:
        """Return points, (n, 3), by local ones."""
        return np.ldexp(local, self.exponent) / self.factors + self.corner

    def lengths(self, local: Floats) -> Floats:
        """Return lengths by local ones."""
        return np.ldexp(local, self.exponent)


def normalised(points: Floats, units: Units | None = None) -> tuple[Floats, Frame]:
    """Shift the lower corner of the points, (N, 3), to the origin and scale them to about unit size."""
    frame = Frame.from_bounds(*bounds(points), units)
    return frame.local(points), frame


@kernel
def _bound_chunks(begin, end, points, lower, upper):
    """Fill lowest and highest coordinates, (chunks, 3) each, of equal parts of the points, (N, 3)."""
    n, chunks = len(points), len(lower)
    for c in range(begin, end):
        last = n * (c + 1) // chunks
        for first in range(n * c // chunks, last, 1024):  # so many points fit into the innermost cache of a core
            widen(points[first : min(first + 1024, last)], lower[c], upper[c])


@kernel
def widen(points, lower, upper):
    """Extend the bounds `lower` and `upper`, (3,), so that they hold the points, (n, 3)."""
    for axis in range(3):
        smallest, greatest = lower[axis], upper[axis]
        for i in range(len(points)):
            value = points[i, axis]
            if value < smallest or value != value:  # once a bound is NaN, it stays NaN
                smallest = value
            if value > greatest or value != value:
                greatest = value
        lower[axis], upper[axis] = smallest, greatest


@kernel
def _shift_and_scale(begin, end, points, corner, scales, again, local):
    """Fill `local`, (N, 3), with (points - corner) * scales * again; one power of two alone could overflow."""
    for i in range(begin, end):
        for axis in range(3):
            value = (points[i, axis] - corner[axis]) * scales[axis] * again
            local[i, axis] = value if value >= 1e-100 else 0.0  # squares of smaller offsets would underflow
