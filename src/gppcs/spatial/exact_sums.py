"""Sums that are exact, so that they do not depend on the order of the numbers or on how they are divided."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

HALF = 27  # Bits. A mantissa is cut into two parts, of which float64 adds 2^26 exactly.
AT_ONCE = 1 << 20  # Numbers that are added at once.
LEAST_EXPONENT = 1074 + 2 * HALF  # Minus the exponent of the unit: no float64 has smaller parts.


def exact_sum(values: NDArray[np.float64]) -> int:
    """Add numbers without rounding.

    Parameters
    ----------
    values : (n,) array, float64
        Finite and not negative.

    Returns
    -------
    int
        The sum in a unit that `mean_of` knows. Such sums can be added.
    """
    if len(values) > AT_ONCE:
        return sum(exact_sum(values[begin : begin + AT_ONCE]) for begin in range(0, len(values), AT_ONCE))
    mantissas, exponents = np.frexp(values)
    high = np.floor(mantissas * 2.0**HALF)
    low = mantissas * 2.0 ** (2 * HALF) - high * 2.0**HALF
    shifts = exponents.astype(np.int64) - 2 * HALF + LEAST_EXPONENT
    total = 0
    for part, more in ((high, HALF), (low, 0)):
        sums = np.bincount(shifts, part)
        total += sum(int(sums[shift]) << int(shift) + more for shift in np.flatnonzero(sums))
    return total


def mean_of(total: int, n: int) -> float:
    """Return a mean, rounded once.

    Parameters
    ----------
    total : int
        A sum of `exact_sum`, or of several.
    n : int
        How many numbers it adds.

    Returns
    -------
    float
    """
    return total / (n << LEAST_EXPONENT)
