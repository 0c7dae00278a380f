"""Joins clouds, of one file or of several, to one."""

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import exact_as_double
from gppcs.clouds.header import Header
from gppcs.errors import FileFormatError


def joined(clouds: Iterable[PointCloud]) -> PointCloud:
    """Return clouds with the same attributes as one."""
    parts = list(clouds)
    parts, columns = [part for part in parts if len(part)] or parts[:1], JointColumns()
    for part in parts:
        columns.add(part)
    return columns.joined(parts)


class JointColumns:
    """The attributes and types that the parts of a cloud have in common."""

    def __init__(self) -> None:
        self._first: PointCloud | None = None
        self.header: Header | None = None  # of the first part that has a coordinate system, or else of the first
        self._lacks_crs = False
        self._types: dict[str, set[np.dtype[Any]]] = {}
        self._coordinates: set[np.dtype[Any]] = set()

    def add(self, cloud: PointCloud) -> None:
        """Take note of a part, after checking that it has the attributes and the coordinate system of the first."""
        if self._first is None:
            self._first = cloud.take(np.empty(0, dtype=np.int64))  # which has names and no points
            self.header = cloud.header
        if cloud.header is not self.header:
            self._add_header(cloud.header)
        first, kinds = _kinds(self._first), _kinds(cloud)
        for name in sorted(first.keys() | kinds.keys()):
            if first.get(name) != kinds.get(name):
                raise FileFormatError(
                    f"expected the same attributes in all files of a cloud, found {name} as "
                    f"{first.get(name, 'nothing')} in the first and {kinds.get(name, 'nothing')} in another; "
                    "simplify each by itself"
                )
        self._coordinates.add(cloud.coordinate_dtype)
        for name, values in cloud.attributes.items():
            self._types.setdefault(name, set()).add(values.dtype)

    def _add_header(self, header: Header | None) -> None:
        """Choose one of two headers, after checking that they do not name different coordinate systems."""
        ours, theirs = self.header and self.header.crs, header and header.crs
        if ours and theirs and ours != theirs:
            raise FileFormatError(
                f"expected one coordinate system in all files of a cloud, found {ours} and {theirs}; bring them to "
                "one first, or join them with gppcs convert --assume-same-crs (in Python, assume_same_crs)"
            )
        if bool(ours) != bool(theirs) and not self._lacks_crs:
            self._lacks_crs = True
            warnings.warn(
                f"some files have no coordinate system: that of others, {ours or theirs}, counts", stacklevel=2
            )
        if theirs and not ours:
            self.header = header

    def merge(self, other: "JointColumns") -> None:
        """Take note of the parts that another has noted."""
        if other._first is not None:
            self.add(replace(other._first, header=other.header))
        self._coordinates |= other._coordinates
        for name, types in other._types.items():
            self._types[name] |= types

    def joined(self, clouds: Iterable[PointCloud]) -> PointCloud:
        """Return clouds as one, in the types of all parts."""
        assert self._first is not None
        points, parts = zip(*((cloud.points, dict(cloud.attributes)) for cloud in clouds), strict=True)
        # Each attribute frees its parts.
        attributes = {name: self._column(name, [part.pop(name) for part in parts]) for name in self._first.attributes}
        return PointCloud(_concatenated(points), attributes, np.result_type(*self._coordinates), self.header)

    def _column(self, name: str, parts: list[NDArray[Any]]) -> NDArray[Any]:
        """Return the values of an attribute in a type that holds those of all parts exactly."""
        common = np.result_type(*self._types[name])
        if common.kind == "f" and not all(part.dtype == common or exact_as_double(part) for part in parts):
            raise FileFormatError(
                f"expected values of {name} that int64, uint64 or float64 holds exactly, found whole numbers beyond "
                "2^53 beside others; write this with a decimal point if it may be rounded"
            )
        return _concatenated([part.astype(common, copy=False) for part in parts])


def _concatenated(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _kinds(cloud: PointCloud) -> dict[str, str]:
    """Return what all parts must have in common of each attribute, in words."""
    conventions, kinds = cloud.header.conventions if cloud.header else {}, {}
    for name, values in cloud.attributes.items():
        kind = conventions.get(name, "numbers" if values.dtype.kind in "biuf" else "text")
        kinds[name] = " ".join([*map(str, values.shape[1:]), kind])
    return kinds
