"""Named columns of numbers, as files hold them, and the cloud that they make."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, OutputError

Column = NDArray[Any]

EXACT = 2**53  # up to here float64 holds every whole number


def default_names(width: int) -> list[str]:
    """Name the columns of a table without names: x, y, z, column_4, column_5 and so on."""
    return ["x", "y", "z", *(f"column_{i}" for i in range(4, width + 1))]


def coordinate_names(names: Iterable[str]) -> tuple[str, str, str]:
    """Find x, y and z among names, in lower case or else in capitals.

    Raises
    ------
    FileFormatError
        If one is missing; the message lists what was found.
    """
    found = list(names)
    x, y, z = (next((name for name in (axis, axis.upper()) if name in found), None) for axis in ("x", "y", "z"))
    if x is None or y is None or z is None:
        listed = ", ".join(map(repr, found)) or "nothing"
        raise FileFormatError(f"expected x, y and z for each point, found {listed}; rename what holds them")
    return x, y, z


def cloud_of_columns(columns: Mapping[str, Column]) -> PointCloud:
    """Make a cloud of columns of equal length, of which three are x, y and z and the others attributes.

    Raises
    ------
    FileFormatError
        If a coordinate is missing, is no number, or is a whole number that float64 cannot hold.
    """
    axes = coordinate_names(columns)
    points = np.empty((len(columns[axes[0]]), 3))
    for i, axis in enumerate(axes):
        values = columns[axis]
        if values.dtype.kind not in "iuf":
            raise FileFormatError(f"expected numbers as coordinates, found {values.dtype} in {axis}")
        if values.ndim != 1:
            raise FileFormatError(f"expected one {axis} for each point, found shape {values.shape}")
        if values.dtype.kind in "iu" and (np.abs(values.astype(np.float64)) >= EXACT).any():
            raise FileFormatError(
                f"expected coordinates below 2^53, found larger ones in {axis}; subtract an offset first"
            )
        points[:, i] = values
    kept = np.result_type(*(columns[axis].dtype for axis in axes))
    attributes = {
        name: np.ascontiguousarray(values, values.dtype.newbyteorder("="))
        for name, values in columns.items()
        if name not in axes
    }
    return PointCloud(points, attributes, kept.newbyteorder("="))


def coordinate_type(cloud: PointCloud) -> np.dtype[Any]:
    """Return the type to write coordinates in: the one that they came with.

    Raises
    ------
    OutputError
        If that is a type of whole numbers and the coordinates are not such numbers, or lie outside its range.
    """
    kept = cloud.coordinate_dtype
    if np.issubdtype(kept, np.integer):
        bounds = np.iinfo(kept.name)
        fits = (cloud.points >= bounds.min) & (cloud.points < float(bounds.max + 1))
        if not (fits & (cloud.points == np.rint(cloud.points))).all():
            raise OutputError(
                f"expected whole numbers of type {kept} as coordinates, found others; "
                "set the cloud's coordinate_dtype to a floating type"
            )
    return kept


def attribute_columns(cloud: PointCloud) -> dict[str, Column]:
    """Spread the attributes over columns of one number per point.

    An attribute of k numbers per point becomes k columns, name_0 and so on; whitespace, separators and quotes
    in names become underscores.

    Raises
    ------
    OutputError
        If an attribute is not made of real numbers or booleans, or two columns would have the same name.
    """
    columns: dict[str, Column] = {}
    for attribute, values in cloud.attributes.items():
        name = re.sub(r"[\s,;\"']+", "_", attribute) or "_"
        if values.dtype.kind not in "biuf":
            raise OutputError(f"expected numbers in attribute {attribute!r}, found {values.dtype}; leave it out")
        flat = values.reshape(len(values), math.prod(values.shape[1:]))
        names = [name] if values.ndim == 1 else [f"{name}_{i}" for i in range(flat.shape[1])]
        for column, part in zip(names, flat.T, strict=True):
            check_unused(column, columns)
            columns[column] = part
    return columns


def check_unused(name: str, names: Iterable[str]) -> None:
    """Raise OutputError if a column of this name is among `names` or would be taken for a coordinate."""
    if name in names or name in ("x", "y", "z"):
        raise OutputError(f"expected columns of different names, found {name!r} twice; rename the attribute")
