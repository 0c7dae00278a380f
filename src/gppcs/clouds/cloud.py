"""The cloud itself: points and whatever else each of them carries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.errors import InputError

NORMALS = ("nx", "ny", "nz")  # the attributes that hold the coordinates of a normal


@dataclass(frozen=True)
class PointCloud:
    """N points with attributes.

    Parameters
    ----------
    points : (N, 3) array, float64
        Coordinates, in the unit of the file.
    attributes : mapping of name to (N, ...) array
        Everything else a point carries (colour, intensity, label, normal), each with its own type, in file order.
    coordinate_dtype : numpy dtype
        The type that the coordinates had where they came from; writers use it again, so that a point that was
        kept comes back bit for bit.

    Raises
    ------
    InputError
        If the shapes do not fit.
    """

    points: NDArray[np.float64]
    attributes: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    coordinate_dtype: np.dtype[np.generic] = field(default_factory=lambda: np.dtype(np.float64))

    def __post_init__(self) -> None:
        points = np.asarray(self.points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"expected points of shape (N, 3), found {points.shape}")
        if not (np.issubdtype(points.dtype, np.floating) or np.issubdtype(points.dtype, np.integer)):
            raise InputError(f"expected numbers as coordinates, found an array of {points.dtype}")
        object.__setattr__(self, "points", np.ascontiguousarray(points, dtype=np.float64))
        attributes = {name: np.asarray(values) for name, values in self.attributes.items()}
        for name, values in attributes.items():
            if values.shape[:1] != (len(points),):
                raise InputError(
                    f"expected attribute {name!r} to have one row for each of the {len(points)} points, "
                    f"found shape {values.shape}"
                )
        object.__setattr__(self, "attributes", attributes)

    @classmethod
    def of(cls, cloud: PointCloud | ArrayLike) -> PointCloud:
        """Take a cloud as it is, or make one of an (N, 3) array-like."""
        if isinstance(cloud, PointCloud):
            return cloud
        try:
            points = np.asarray(cloud)
        except ValueError as error:
            raise InputError(f"expected an (N, 3) array of coordinates, found {type(cloud).__name__}") from error
        kept = points.dtype if np.issubdtype(points.dtype, np.floating) else np.dtype(np.float64)
        return cls(points, coordinate_dtype=kept)

    def __repr__(self) -> str:
        carried = f", each with {', '.join(self.attributes)}" if self.attributes else ""
        return f"PointCloud({len(self):,} points{carried})"

    def __len__(self) -> int:
        return len(self.points)

    def take(self, indices: NDArray[np.int64]) -> PointCloud:
        """Return the points of the given indices, in their order, with every attribute."""
        return PointCloud(
            self.points[indices],
            {name: values[indices] for name, values in self.attributes.items()},
            self.coordinate_dtype,
        )

    def non_finite(self) -> NDArray[np.int64]:
        """Return the indices of points with a coordinate that is NaN or infinite."""
        return np.flatnonzero(~np.isfinite(self.points).all(axis=1))

    def finite_rows(self) -> NDArray[np.int64]:
        """Return the indices of the other points."""
        return np.delete(np.arange(len(self)), self.non_finite())

    def normals(self) -> NDArray[np.float64] | None:
        """Return the normals that the points carry as nx, ny, nz, (N, 3), or None if they carry none."""
        if not set(NORMALS) <= set(self.attributes):
            return None
        return np.stack([self.attributes[name] for name in NORMALS], axis=1).astype(np.float64)

    def usable(self, name: str) -> NDArray[np.float64]:
        """Return the points; raise an InputError that calls the cloud `name` if there are none or not all finite."""
        if len(self) == 0:
            raise InputError(f"the {name} is empty: expected at least one point")
        if len(bad := self.non_finite()):
            raise InputError(
                f"the {name} has {len(bad)} points with coordinates that are NaN or infinite, the first at index "
                f"{bad[0]}: drop them first"
            )
        return self.points
