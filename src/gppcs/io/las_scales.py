"""The scale and the offset by which LAS files store coordinates as whole numbers."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

_LARGEST = 2**31 - 1  # of the whole numbers that coordinates are stored as


def scale_and_offset(
    parts: Callable[[], Iterable[NDArray[np.float64]]], scale: float, offset: float
) -> tuple[float, float]:
    """Return the scale and the offset in which one axis is stored, given its coordinates in parts, as often as needed.

    They are those of the header if these are exact. Otherwise the scale is the coarsest power of ten that is exact and
    fits 32 bits, or else the finest one that fits.
    """
    if scale and all(_is_exact(part, scale, offset) for part in parts()):
        return scale, offset
    limits = np.array([(part.min(), part.max()) for part in parts() if len(part)] or [(0.0, 0.0)])
    for scale, offset in _scales(float(limits[:, 0].min()), float(limits[:, 1].max())):
        if all(_is_exact(part, scale, offset) for part in parts()):
            break
    return scale, offset


def multiples(
    values: NDArray[np.float64], scale: float | NDArray[np.float64], offset: float | NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return coordinates as they are read from a file, NaN where they do not fit."""
    with np.errstate(all="ignore"):
        numbers = np.rint((values - offset) / scale)
        numbers[~(np.abs(numbers) <= _LARGEST)] = np.nan
        result: NDArray[np.float64] = numbers * scale + offset
    return result


def _is_exact(values: NDArray[np.float64], scale: float, offset: float) -> bool:
    """Return whether values are multiples of a scale that fit, but for two units in the last place: 41 times 0.01."""
    for part in (values[:1000], values[1000:]):  # most scales fail at the first
        with np.errstate(over="ignore"):
            tolerance = 2 * np.spacing(np.maximum(np.abs(part), abs(offset)))
        if not (np.abs(multiples(part, scale, offset) - part) <= tolerance).all():
            return False
    return True


def _scales(lower: float, upper: float) -> Iterator[tuple[float, float]]:
    """Yield powers of ten that fit, the finest last, each with a fitting offset."""
    for offset in (0.0, float(np.rint(lower / 2 + upper / 2))):
        distance = max(upper - offset, offset - lower)
        fits = (e for e in range(-300, 309) if distance <= float(f"1e{e}") * (_LARGEST - 1))
        finest = next(fits) if distance else 0
        # In multiples of coarser scales than the first, all but zero are too small.
        for exponent in range(max(finest, min(finest + 10, 0)), finest - 1, -1):
            yield float(f"1e{exponent}"), offset
