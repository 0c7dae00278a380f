"""Colours of points in 8 bits, however a file or a library holds them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def eight_bits(colours: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours in 8 bits.

    Shapes: colours (N, 3); returns (N, 3).
    """
    return np.clip(_from_0_to_255(colours), 0, 255).round().astype(np.uint8)


def fit_eight_bits(colours: NDArray[Any]) -> bool:
    """Return whether colours lose nothing in 8 bits.

    Shapes: colours (N, 3).
    """
    return bool(np.all(np.abs(_from_0_to_255(colours) - eight_bits(colours)) < 1e-3))


def _from_0_to_255(colours: NDArray[Any]) -> NDArray[np.float64]:
    largest = colours.max(initial=0)
    factor = 255.0 if np.issubdtype(colours.dtype, np.floating) and largest <= 1 else 1.0 if largest <= 255 else 1 / 257
    return np.nan_to_num(colours.astype(np.float64)) * factor
