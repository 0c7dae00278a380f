"""Makes a cloud of named columns, as files, tables and structured arrays have them."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import InputError

Column = NDArray[Any]

# Points, (N, 3), attributes by name, and the type of the coordinates: what a cloud is made of.
CloudParts = tuple[NDArray[Any], dict[str, Column], np.dtype[Any]]

CLASSIFICATION = "classification"
# As the LAS specification (ASPRS) names the classes of point formats 6 to 10.
CLASS_NAMES = (
    "never classified", "unclassified", "ground", "low vegetation", "medium vegetation", "high vegetation", "building",
    "low noise", "", "water", "rail", "road", "", "wire guard", "wire conductor", "transmission tower",
    "wire connector", "bridge deck", "high noise", "overhead structure", "ignored ground", "snow",
    "temporal exclusion",
)  # fmt: skip
NORMALS = ("nx", "ny", "nz")  # attributes that hold the components of a point's normal
COLOUR = ("red", "green", "blue")
EXACT = 2**53  # float64 represents every whole number up to here


def unmasked(values: Any) -> NDArray[Any]:
    """Return values as an array, with NaN for masked numbers; NumPy would take those below the mask."""
    if hasattr(values, "__dlpack__") and not hasattr(values, "__array__"):
        return np.from_dlpack(values)
    if not (isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values)):
        return np.asarray(values)
    if values.dtype.kind not in "biuf":
        return np.asarray(np.ma.filled(values))
    kind = values.dtype if values.dtype.kind == "f" else np.dtype(np.float64)
    return np.asarray(np.ma.filled(values.astype(kind), np.nan))


def coordinate_names(names: Iterable[str]) -> tuple[str, str, str]:
    """Return which names are the coordinates: x, y and z, or X, Y and Z."""
    listed = list(names)
    x, y, z = (next((name for name in (axis, axis.upper()) if name in listed), None) for axis in ("x", "y", "z"))
    if x is None or y is None or z is None:
        actual = ", ".join(map(repr, listed)) or "nothing"
        raise InputError(
            f"expected x, y and z for each point, found {actual}; rename the columns that hold the coordinates"
        )
    return x, y, z


def parts_of_columns(columns: Mapping[str, Column]) -> CloudParts:
    """Return what a cloud is made of: of the columns, (N, ...), x, y and z are the coordinates."""
    axes = coordinate_names(columns)
    points = np.empty((len(columns[axes[0]]), 3))
    for i, axis in enumerate(axes):
        values = columns[axis]
        if values.dtype.kind not in "iuf":
            raise InputError(f"expected numbers as coordinates, found {values.dtype} in {axis}")
        if values.ndim != 1:
            raise InputError(f"expected one {axis} for each point, found shape {values.shape}")
        if values.dtype.kind in "iu" and (np.abs(values.astype(np.float64)) >= EXACT).any():
            raise InputError(f"expected coordinates below 2^53, found larger ones in {axis}; subtract an offset first")
        points[:, i] = values
    kept = np.result_type(*(columns[axis].dtype for axis in axes))
    attributes = {
        name: np.ascontiguousarray(values, values.dtype.newbyteorder("="))
        for name, values in columns.items()
        if name not in axes
    }
    return points, attributes, kept.newbyteorder("=")


def exact_as_double(values: Column) -> bool:
    """Return whether float64 represents all values exactly."""
    with np.errstate(over="ignore"):
        wide = values.astype(np.float64)
    if values.dtype.kind == "f":
        return bool(np.array_equal(wide, values, equal_nan=True))
    beyond = float(np.iinfo(values.dtype).max)  # rounds up to a power of two
    return bool((wide < beyond).all() and (wide.astype(values.dtype) == values).all())
