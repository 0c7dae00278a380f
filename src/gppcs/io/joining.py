"""Joins clouds, of one file or of several, to one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import exact_as_double
from gppcs.clouds.header import Header
from gppcs.errors import FileFormatError


def joined(clouds: Iterable[PointCloud]) -> PointCloud:
    """Return clouds with the same attributes as one."""
    columns, parts = JointColumns(), []
    for cloud in clouds:
        columns.add(cloud)
        parts.append(cloud)
    return parts[0] if len(parts) == 1 else columns.joined(parts)


class JointColumns:
    """The attributes and types that the parts of a cloud have in common."""

    def __init__(self) -> None:
        self._first: PointCloud | None = None
        self._types: dict[str, set[np.dtype[Any]]] = {}
        self._coordinates: set[np.dtype[Any]] = set()
        self._signed: set[str] = set()  # attributes with a negative number

    def add(self, cloud: PointCloud) -> None:
        """Take note of a part."""
        if self._first is None:
            self._first = cloud.take(np.empty(0, dtype=np.int64))  # which tells names and header, and holds no points
        first = self._first
        if set(cloud.attributes) != set(first.attributes):
            differing = ", ".join(sorted(set(cloud.attributes) ^ set(first.attributes)))
            raise FileFormatError(
                f"expected the same attributes in all files of a cloud, found {differing} in some only; "
                "write them anew with the same attributes, or simplify each file for itself"
            )
        conventions = [each.header.conventions if each.header else {} for each in (first, cloud)]
        for name in cloud.attributes:
            one, other = (each.get(name, "no scale") for each in conventions)
            if one != other:
                raise FileFormatError(
                    f"expected values of {name} of one kind in all files of a cloud, found {one} and {other}; "
                    "simplify each file for itself"
                )
        crs = [each.header.crs if each.header else None for each in (first, cloud)]
        if None not in crs and crs[0] != crs[1]:
            raise FileFormatError(
                f"expected one coordinate system in all files of a cloud, found {crs[0]} and {crs[1]}; bring them to "
                "one first, or take them for the same with assume_same_crs"
            )
        self._coordinates.add(cloud.coordinate_dtype)
        for name, values in cloud.attributes.items():
            if values.shape[1:] != first.attributes[name].shape[1:]:
                raise FileFormatError(
                    f"expected values of {name} of one shape in all files of a cloud, found "
                    f"{first.attributes[name].shape[1:]} and {values.shape[1:]}; simplify each file for itself"
                )
            self._types.setdefault(name, set()).add(values.dtype)
            if values.dtype == np.int64 and name not in self._signed and values.size and values.min() < 0:
                self._signed.add(name)

    @property
    def header(self) -> Header | None:
        """The header of the first part."""
        return None if self._first is None else self._first.header

    def merge(self, other: JointColumns) -> None:
        """Take note of the parts that another has noted."""
        if other._first is not None:
            self.add(other._first)
        self._coordinates |= other._coordinates
        self._signed |= other._signed
        for name, types in other._types.items():
            self._types[name] |= types

    def joined(self, clouds: Iterable[PointCloud]) -> PointCloud:
        """Return several clouds as one, in the types of all parts."""
        assert self._first is not None
        points, parts = zip(*((cloud.points, dict(cloud.attributes)) for cloud in clouds), strict=True)
        # Each attribute frees its parts.
        attributes = {name: self._column(name, [each.pop(name) for each in parts]) for name in self._first.attributes}
        return PointCloud(np.concatenate(points), attributes, np.result_type(*self._coordinates), self._first.header)

    def _column(self, name: str, parts: list[NDArray[Any]]) -> NDArray[Any]:
        common = self._common_type(name)
        if common.kind == "f" and not all(part.dtype == common or exact_as_double(part) for part in parts):
            raise FileFormatError(
                f"expected values of {name} that int64, uint64 or float64 holds exactly, found whole numbers beyond "
                "2^53 beside others; write this with a decimal point if it may be rounded"
            )
        return np.concatenate([part.astype(common, copy=False) for part in parts])

    def _common_type(self, name: str) -> np.dtype[Any]:
        types = self._types[name]
        if len(types) == 1:
            return next(iter(types))
        if types <= {np.dtype(np.int64), np.dtype(np.uint64)} and name not in self._signed:
            return np.dtype(np.uint64)
        if len({"number" if each.kind in "biuf" else each.kind for each in types}) > 1:
            raise FileFormatError(
                f"expected values of {name} of one kind in all files of a cloud, found "
                f"{' and '.join(sorted(map(str, types)))}; simplify each file for itself"
            )
        return np.result_type(*types)
