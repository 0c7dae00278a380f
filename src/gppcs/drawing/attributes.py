"""The attributes of a cloud that colours can show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.colours import eight_bits, full_scale
from gppcs.errors import ParameterError, nearest_name, shown

RGB, VARIATION = "rgb", "variation"  # colourings that are no attributes; an attribute of that name wins
MOST_KINDS = 8  # whole numbers of at most so many different values are shown as kinds: there are as many colours
COLOUR_NAMES = [["red", "green", "blue"], ["r", "g", "b"]]
COLOUR_NAMES += [[f"{name} {i}" for i in range(3)] for name in ("rgb", "color", "colors")]


@dataclass(frozen=True)
class Colourable:
    """The attributes of numbers of a cloud, its RGB, and which value of it in the cloud is the brightest possible."""

    columns: dict[str, NDArray[Any]]
    rgb: NDArray[np.uint8] | None
    full: float | None = None

    @classmethod
    def of(cls, cloud: PointCloud, full: float | None = None) -> Colourable:
        """Return the attributes of a cloud as single columns; `full` is the brightest value of colours, if known."""
        columns: dict[str, NDArray[Any]] = {}
        for name, values in cloud.attributes.items():
            if values.dtype.kind in "biuf":
                flat = values.reshape(len(values), -1).T
                columns |= {name if values.ndim == 1 else f"{name} {i}": column for i, column in enumerate(flat)}
        names = next((names for names in COLOUR_NAMES if set(names) <= set(columns)), None)
        if names is None:
            return cls(columns, None)
        colours = np.stack([columns.pop(name) for name in names], axis=1)
        full = full or full_scale(colours)
        return cls(columns, eight_bits(colours, full), full)

    def require(self, colour: str) -> None:
        """Raise an error if the cloud cannot be coloured so."""
        known = [*([] if self.rgb is None else [RGB]), VARIATION, *self.columns]
        if colour not in known:
            found = f"{shown(colour)}{nearest_name(colour, known)}"
            raise ParameterError(f"expected a colour or an attribute of numbers that the cloud has, found {found}")


def kinds_of(values: NDArray[Any], most: int = MOST_KINDS) -> NDArray[Any] | None:
    """Return the different values (K,) if they are kinds, at most so many, rather than amounts."""
    if np.issubdtype(values.dtype, np.floating):
        return None
    kinds = np.unique(values)
    return kinds if 0 < len(kinds) <= most else None
