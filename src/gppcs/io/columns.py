"""Converts a cloud to the named columns of a file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column
from gppcs.errors import OutputError
from gppcs.io.format import without_attributes

_LONGEST_NAME = 1000
_UNWRITABLE = re.compile("[\0\ud800-\udfff]")  # zip files cut names at the first, UTF-8 has no bytes for the others


def default_names(width: int) -> list[str]:
    """Return names for the columns of a table without names: x, y, z, column_4, column_5 and so on."""
    return ["x", "y", "z", *(f"column_{i}" for i in range(4, width + 1))]


def coordinate_type(cloud: PointCloud) -> np.dtype[Any]:
    """Return the type to write coordinates in, which is the cloud's `coordinate_dtype`."""
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
    """Return the attributes as columns of one number, or one text, per point.

    Shapes: returns (N,).
    """
    columns: dict[str, Column] = {}
    for attribute, values in cloud.attributes.items():
        name = column_name(attribute)
        flat = values.reshape(len(values), math.prod(values.shape[1:]))
        names = [name] if values.ndim == 1 else [f"{name}_{i}" for i in range(flat.shape[1])]
        for column, part in zip(names, flat.T, strict=True):
            check_name(column, columns)
            columns[column] = part
    return columns


def column_name(attribute: str) -> str:
    """Return the name of an attribute with underscores in place of whitespace, separators and quotes."""
    return re.sub(r"[\s,;\"']+", "_", attribute) or "_"


def held_by_columns(cloud: PointCloud, kinds: str) -> tuple[PointCloud, list[str]]:
    """Return what a table can hold of a cloud, by the kinds of NumPy types, and in words what it cannot."""
    others = [
        name for name, values in cloud.attributes.items() if values.dtype.kind not in kinds or 0 in values.shape[1:]
    ]
    return without_attributes(cloud, others)


def check_name(name: str, taken: Iterable[str]) -> None:
    """Check that a column can have a name."""
    if name in taken or name in ("x", "y", "z"):
        raise OutputError(f"expected columns of different names, found {name!r} twice; rename the attribute")
    if not 1 <= len(name) <= _LONGEST_NAME or _UNWRITABLE.search(name):
        raise OutputError(
            f"expected a name of 1 to {_LONGEST_NAME:,} characters of Unicode for each attribute, "
            f"found {name[:20]!a} of {len(name):,}; rename the attribute"
        )


def exact_as_double(values: Column) -> bool:
    """Return whether float64 represents all values exactly."""
    with np.errstate(over="ignore"):
        wide = values.astype(np.float64)
    if values.dtype.kind == "f":
        return bool(np.array_equal(wide, values, equal_nan=True))
    beyond = float(np.iinfo(values.dtype).max)  # rounds up to a power of two
    return bool((wide < beyond).all() and (wide.astype(values.dtype) == values).all())
