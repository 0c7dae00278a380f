"""The class `PointCloud`: points and their attributes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.clouds.header import Header
from gppcs.engine.equality import ComparedByValue
from gppcs.errors import InputError, shown

NORMALS = ("nx", "ny", "nz")  # attributes that hold the components of a point's normal


@dataclass(frozen=True, eq=False)
class PointCloud(ComparedByValue):
    """N points, each with the same attributes.

    Parameters
    ----------
    points : (N, 3) array, float64
        Coordinates, in any unit. They may be NaN or infinite.
    attributes : mapping of str to (N, ...) array
        Other values of each point by name, such as colour, intensity, label or normal. Each array keeps its own type.
    coordinate_dtype : numpy dtype
        The type of the coordinates in the source of the cloud. Files are written in this type, so a kept point has
        the same bits in the output as in the input.
    header : Header, optional
        What the file that the cloud came from says of the whole cloud, such as comments or the coordinate system. It
        is written again to files of the same format.

    Raises
    ------
    InputError
        If `points` is not a numeric (N, 3) array, `attributes` are not arrays of N rows by name, `coordinate_dtype` is
        no type of numbers, or `header` is no header.

    Examples
    --------
    >>> cloud = gppcs.PointCloud([[0, 0, 0], [1, 0, 0]], {"intensity": [7, 9]})
    >>> cloud
    PointCloud(2 points, each with intensity)
    >>> cloud.points
    array([[0., 0., 0.],
           [1., 0., 0.]])
    >>> cloud.take([1]).attributes["intensity"]
    array([9])
    """

    points: NDArray[np.float64]
    attributes: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    coordinate_dtype: np.dtype[np.generic] = field(default_factory=lambda: np.dtype(np.float64))
    header: Header | None = None

    def __post_init__(self) -> None:
        points = _array(self.points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"expected points of shape (N, 3), found {points.shape}")
        if not (np.issubdtype(points.dtype, np.floating) or np.issubdtype(points.dtype, np.integer)):
            raise InputError(f"expected numbers as coordinates, found an array of {points.dtype}")
        object.__setattr__(self, "points", np.ascontiguousarray(points, dtype=np.float64))
        if not isinstance(self.attributes, Mapping):
            raise InputError(
                f"expected attributes by name, such as {{'label': labels}}, found {shown(self.attributes)}"
            )
        attributes = {}
        for name, given in self.attributes.items():
            if not isinstance(name, str):
                raise InputError(f"expected text as the name of an attribute, found {shown(name)}")
            attributes[name] = values = _array(given, f"an array as attribute {name!r}")
            if values.shape[:1] != (len(points),):
                raise InputError(
                    f"expected attribute {name!r} to have one row for each of the {len(points)} points, "
                    f"found shape {values.shape}"
                )
        object.__setattr__(self, "attributes", attributes)
        try:
            kept = np.dtype(self.coordinate_dtype)
        except TypeError as error:
            raise InputError(
                f"expected a type of NumPy as coordinate_dtype, found {shown(self.coordinate_dtype)}"
            ) from error
        if not (np.issubdtype(kept, np.floating) or np.issubdtype(kept, np.integer)):
            raise InputError(f"expected a type of numbers as coordinate_dtype, found {kept}")
        object.__setattr__(self, "coordinate_dtype", kept)
        if not isinstance(self.header, Header | None):
            raise InputError(f"expected the header of a cloud that was read, found {shown(self.header)}")

    @classmethod
    def of(cls, cloud: PointCloud | ArrayLike) -> PointCloud:
        """Return a cloud unchanged, or make one of an array.

        Parameters
        ----------
        cloud : PointCloud or (N, 3) array-like
            A cloud, or coordinates.

        Returns
        -------
        PointCloud
            For an array of floating-point numbers, `coordinate_dtype` is the array's type; otherwise float64.

        Raises
        ------
        InputError
            If the array is not a numeric (N, 3) array.
        """
        if isinstance(cloud, PointCloud):
            return cloud
        points = _array(cloud)
        kept = points.dtype if np.issubdtype(points.dtype, np.floating) else np.dtype(np.float64)
        return cls(points, coordinate_dtype=kept)

    def __repr__(self) -> str:
        carried = f", each with {', '.join(self.attributes)}" if self.attributes else ""
        return f"PointCloud({len(self):,} points{carried})"

    def __len__(self) -> int:
        return len(self.points)

    def take(self, indices: NDArray[np.int64]) -> PointCloud:
        """Return the points with the given indices, in that order, with all attributes.

        Parameters
        ----------
        indices : (M,) array, int64
            Rows of the cloud.

        Returns
        -------
        PointCloud
            A copy of M points.
        """
        return PointCloud(
            self.points[indices],
            {name: values[indices] for name, values in self.attributes.items()},
            self.coordinate_dtype,
            self.header,
        )

    def non_finite(self) -> NDArray[np.int64]:
        """Return the indices of the points that have a NaN or infinite coordinate.

        Returns
        -------
        (K,) array, int64
            Ascending.
        """
        return np.flatnonzero(~np.isfinite(self.points).all(axis=1))

    def finite_rows(self) -> NDArray[np.int64]:
        """Return the indices of the points whose coordinates are all finite.

        Returns
        -------
        (N - K,) array, int64
            Ascending.
        """
        return np.delete(np.arange(len(self)), self.non_finite())

    def normals(self) -> NDArray[np.float64] | None:
        """Return the normals in the attributes `nx`, `ny` and `nz`.

        Returns
        -------
        (N, 3) array, float64, or None
            None if one of the three attributes is missing.
        """
        if not set(NORMALS) <= set(self.attributes):
            return None
        return np.stack([self.attributes[name] for name in NORMALS], axis=1).astype(np.float64)

    def usable(self, name: str) -> NDArray[np.float64]:
        """Return the coordinates if there is at least one point and all coordinates are finite.

        Parameters
        ----------
        name : str
            What the error message calls the cloud.

        Returns
        -------
        (N, 3) array, float64

        Raises
        ------
        InputError
            If the cloud is empty, or a coordinate is NaN or infinite.
        """
        if len(self) == 0:
            raise InputError(f"the {name} is empty: expected at least one point")
        if len(bad := self.non_finite()):
            raise InputError(
                f"expected finite coordinates in the {name}, found {len(bad)} points with NaN or infinite ones, the "
                f"first at index {bad[0]}: drop them first"
            )
        return self.points


def _array(values: Any, name: str = "an (N, 3) array of coordinates") -> NDArray[Any]:
    """Return values as an array; raise an InputError if their rows have different lengths."""
    try:
        return np.asarray(values)
    except ValueError as error:
        raise InputError(f"expected {name}, found {type(values).__name__} with rows of different lengths") from error
