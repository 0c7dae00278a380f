"""Converts a cloud to the named columns of a file."""

import math
import re
from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.colours import eight_bits, fit_eight_bits, full_scale
from gppcs.clouds.columns import COLOUR, Column, exact_as_double
from gppcs.errors import OutputError


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


def with_digits(cloud: PointCloud) -> PointCloud:
    """Return a cloud for text: of double coordinates if the digits of single ones, as others read them, move points."""
    sizes = np.abs(cloud.points[np.isfinite(cloud.points)])
    if cloud.coordinate_dtype != np.float32 or not len(sizes):
        return cloud
    finite = cloud.points[cloud.is_finite()]
    diagonal = float(np.linalg.norm(np.ptp(finite, axis=0))) if len(finite) else 0.0
    with np.errstate(over="ignore"):
        shift = np.spacing(np.float32(sizes.max())) / 2
    return cloud if shift <= 1e-6 * diagonal else replace(cloud, coordinate_dtype=np.dtype(np.float64))


def columns_of(
    cloud: PointCloud, flat: bool = True, types: Collection[np.dtype[Any]] | None = None
) -> dict[str, Column]:
    """Return coordinates and attributes by name; those of `flat` columns are one number or text for each point.

    If a format has few types, each column gets one of them that holds it exactly, or else float64.
    """
    points = cloud.points.astype(coordinate_type(cloud), copy=False)
    columns: dict[str, Column] = dict(zip("xyz", points.T, strict=True))
    for name, values in cloud.attributes.items():
        parts = {name: values}
        if flat and values.ndim > 1:
            table = values.reshape(len(values), math.prod(values.shape[1:]))
            parts = {f"{name}_{i}": part for i, part in enumerate(table.T)}
        for column, part in parts.items():
            check_name(column, columns)
            columns[column] = part
    if types is None:
        return columns
    return {name: part.astype(exact_type(part, types) or "f8", copy=False) for name, part in columns.items()}


def with_byte_colours(cloud: PointCloud, kinds: str = "if") -> PointCloud:
    """Return a cloud whose colours, of some kinds of types, are bytes, as other programs expect, if these hold them."""
    names = [name for name in (*COLOUR, "alpha") if name in cloud.attributes]
    columns = [cloud.attributes[name] for name in names]
    if not set(COLOUR) <= set(names) or any(column.dtype.kind not in kinds or column.ndim > 1 for column in columns):
        return cloud
    table: Column = np.column_stack(columns)
    if not (len(table) and np.isfinite(table).all() and full_scale(table) <= 255 and fit_eight_bits(table)):
        return cloud
    return replace(cloud, attributes={**cloud.attributes, **dict(zip(names, eight_bits(table).T, strict=True))})


def column_name(attribute: str) -> str:
    """Return the name of an attribute with underscores in place of whitespace, separators and quotes."""
    return re.sub(r"[\s,;\"']+", "_", attribute) or "_"


def exact_type(values: Column, types: Collection[np.dtype[Any]]) -> np.dtype[Any] | None:
    """Return which of a format's types holds all values exactly: their own, or else a wider one; None if none does.

    There is none either for lists of no numbers.
    """
    dtype = values.dtype.newbyteorder("=")
    if 0 in values.shape[1:]:
        return None
    if dtype in types:
        return dtype
    if dtype.kind == "b" or dtype == np.float16:
        return np.dtype("u1" if dtype.kind == "b" else "f4")
    if dtype.kind not in "iuf":
        return None
    if dtype.kind in "iu":
        for narrow in map(np.dtype, ("i4", "u4")):
            bounds = np.iinfo(narrow)
            if not values.size or (bounds.min <= values.min() and values.max() <= bounds.max):
                return narrow
    return np.dtype("f8") if exact_as_double(values) else None


def check_name(name: str, taken: Iterable[str]) -> None:
    """Check that a column can have a name."""
    if name in taken or name in ("x", "y", "z"):
        raise OutputError(f"expected columns of different names, found {name!r} twice; rename the attribute")
    # Zip files cut names at zero characters, and UTF-8 has no bytes for surrogates.
    if not 1 <= len(name) <= 1000 or re.search("[\0\ud800-\udfff]", name):
        raise OutputError(
            f"expected a name of 1 to 1,000 characters of Unicode for each attribute, found {name[:20]!a} of "
            f"{len(name):,}; rename the attribute"
        )
