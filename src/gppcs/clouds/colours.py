"""Colours of points in 8 bits, however a file or a library holds them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def eight_bits(colours: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours in 8 bits.

    Parameters
    ----------
    colours : (N, 3) array
        Floats from 0 to 1, or numbers of 8 or of 16 bits. The largest one tells, since many files hold 8 bits in a type
        of 16.

    Returns
    -------
    (N, 3) array, uint8
    """
    return np.clip(_from_0_to_255(colours), 0, 255).round().astype(np.uint8)


def fit_eight_bits(colours: NDArray[Any]) -> bool:
    """Return whether colours lose nothing in 8 bits.

    Parameters
    ----------
    colours : (N, 3) array
        As for `eight_bits`.

    Returns
    -------
    bool
        Whether all are within a thousandth of a step of 8 bits: files hold fractions with six decimals.
    """
    return bool(np.all(np.abs(_from_0_to_255(colours) - eight_bits(colours)) < 1e-3))


def _from_0_to_255(colours: NDArray[Any]) -> NDArray[np.float64]:
    largest = colours.max(initial=0)
    factor = 255.0 if np.issubdtype(colours.dtype, np.floating) and largest <= 1 else 1.0 if largest <= 255 else 1 / 257
    return np.nan_to_num(colours.astype(np.float64)) * factor
