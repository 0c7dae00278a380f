"""Compare dataclasses that hold arrays, for which the comparison that `dataclass` generates raises an error."""

import dataclasses
from collections.abc import Mapping
from typing import Any


class ComparedByValue:
    """Base class of dataclasses with arrays, declared with `eq=False`: `==` compares all fields; NaN equals NaN."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(
            _equal(getattr(self, field.name), getattr(other, field.name))
            for field in dataclasses.fields(self)  # type: ignore[arg-type]
            if field.compare
        )

    __hash__ = None  # type: ignore[assignment]


def _equal(one: Any, other: Any) -> bool:
    """Return whether two values of a field are equal; values of mappings may be arrays, too."""
    import numpy as np

    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_equal(value, other[key]) for key, value in one.items())
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if one.dtype != other.dtype or one.shape != other.shape:
            return False
        if one.dtype.hasobject:  # lists of different lengths
            return all(map(_equal, one.flat, other.flat))
        return bool(((one == other) | ((one != one) & (other != other))).all())
    return bool(one == other) or (one != one and other != other)
