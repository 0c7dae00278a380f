"""Look up an attribute of a cloud that a user names."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import InputError, ParameterError, nearest_name, shown


def check_named(name: str, names: Iterable[str], use: str) -> None:
    """Raise an error that says for what an attribute is needed, unless it is among some names."""
    names = list(names)
    if name not in names:
        near = nearest_name(name, names) if names else "; it has none at all"
        raise InputError(f"the cloud has no attribute {shown(name)} {use}{near}")


def numbers_in(cloud: PointCloud, name: str, use: str) -> NDArray[np.float64]:
    """Return the numbers in an attribute, (N,)."""
    check_named(name, cloud.attributes, use)
    values = cloud.attributes[name]
    if values.ndim == 1 and values.dtype.kind in "biuf":
        return as_floats(values)
    kind = f"{math.prod(values.shape[1:])}" if values.ndim > 1 else f"values of type {values.dtype}"
    raise ParameterError(f"expected attribute {shown(name)} to hold one number for each point, found {kind}")


def as_floats(values: NDArray[Any]) -> NDArray[np.float64]:
    """Return values as numbers of type float64; those that are too large become infinite."""
    with np.errstate(over="ignore"):
        return values.astype(np.float64)


def bounded(values: NDArray[Any]) -> NDArray[np.float64]:
    """Return values as numbers of type float64 whose differences do not overflow; NaN stays."""
    largest = np.finfo(np.float64).max / 4.0
    return np.clip(as_floats(values), -largest, largest)
