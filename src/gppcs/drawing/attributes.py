"""The attributes of a cloud that colours can show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.colours import eight_bits
from gppcs.errors import ParameterError, nearest_name, shown

RGB, VARIATION = "rgb", "variation"  # colourings that are no attributes; an attribute of that name wins
MOST_KINDS = 8  # whole numbers of at most so many different values are shown as kinds: there are as many colours
COLOUR_NAMES = (("red", "green", "blue"), ("r", "g", "b"))


@dataclass(frozen=True)
class Colourable:
    """The attributes of numbers of a cloud, and its RGB."""

    columns: dict[str, NDArray[Any]]
    rgb: NDArray[np.uint8] | None

    @classmethod
    def of(cls, cloud: PointCloud) -> Colourable:
        """Return the attributes of a cloud."""
        columns = dict(_columns(cloud))
        for names in (*COLOUR_NAMES, *((f"{name} 0", f"{name} 1", f"{name} 2") for name in ("rgb", "color", "colors"))):
            if set(names) <= set(columns):
                return cls(columns, eight_bits(np.stack([columns.pop(name) for name in names], axis=1)))
        return cls(columns, None)

    def means_variation(self, colour: str) -> bool:
        """Return whether the name of a colour stands for surface variation, rather than for an attribute."""
        return colour == VARIATION and VARIATION not in self.columns

    def require(self, colour: str) -> None:
        """Raise an error if the cloud cannot be coloured so."""
        known = [*([] if self.rgb is None else [RGB]), VARIATION, *self.columns]
        if colour not in known:
            raise ParameterError(
                "expected a colour that the cloud has: rgb, variation or an attribute of numbers, found "
                f"{shown(colour)}{nearest_name(colour, known)}"
            )


def kinds_of(values: NDArray[Any]) -> NDArray[Any] | None:
    """Return the different values if they are kinds, such as classes, rather than amounts.

    Shapes: values (N,); returns (K,).
    """
    if np.issubdtype(values.dtype, np.floating):
        return None
    kinds = np.unique(values)
    return kinds if 0 < len(kinds) <= MOST_KINDS else None


def _columns(cloud: PointCloud) -> list[tuple[str, NDArray[Any]]]:
    """Return the attributes of numbers as columns by name; one with several numbers per point becomes several."""
    columns = []
    for name, values in cloud.attributes.items():
        if not (np.issubdtype(values.dtype, np.number) or values.dtype == bool) or np.iscomplexobj(values):
            continue
        flat = values.reshape(len(values), -1).T
        columns += [(name if values.ndim == 1 else f"{name} {i}", column) for i, column in enumerate(flat)]
    return columns
