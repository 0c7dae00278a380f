"""Colours of points in 8 bits, however a file or a library holds them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Linear sRGB to the response of the cones, and its cube root to lightness, green to red, and blue to yellow.
TO_CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ],
    dtype=np.float32,
)
TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ],
    dtype=np.float32,
)


def eight_bits(colours: NDArray[Any], full: float | None = None) -> NDArray[np.uint8]:
    """Return colours in 8 bits, given their brightest possible value if it is known. Shapes: (N, 3); returns (N, 3)."""
    return np.clip(_from_0_to_255(colours, full), 0, 255).round().astype(np.uint8)


def fit_eight_bits(colours: NDArray[Any]) -> bool:
    """Return whether colours lose nothing in 8 bits. Shapes: colours (N, 3)."""
    return bool(np.all(np.abs(_from_0_to_255(colours) - eight_bits(colours)) < 1e-3))


def full_scale(colours: NDArray[Any]) -> float:
    """Return which value of some colours is the brightest possible: 1, 255 or 65535, whatever fits."""
    largest = colours.max(initial=0, where=np.abs(colours) <= 65535)  # NaN and larger ones mark missing values
    return 1.0 if np.issubdtype(colours.dtype, np.floating) and largest <= 1 else 255.0 if largest <= 255 else 65535.0


def _from_0_to_255(colours: NDArray[Any], full: float | None = None) -> NDArray[np.float64]:
    return np.nan_to_num(colours.astype(np.float64)) * (255.0 / (full or full_scale(colours)))


def linear(colours: NDArray[Any]) -> NDArray[Any]:
    """Return sRGB colours from 0 to 1 as fractions of the light (IEC 61966-2-1)."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def from_linear(light: NDArray[Any]) -> NDArray[Any]:
    """Return fractions of the light as sRGB colours from 0 to 1: the inverse of `linear`."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def oklab(colours: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return sRGB colours, (N, 3) from 0 to 1, in OKLab (Ottosson 2020), where equal distances look about equal."""
    lab: NDArray[np.float32] = np.cbrt(linear(colours) @ TO_CONES.T) @ TO_LAB.T
    return lab
