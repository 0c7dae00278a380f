"""The class `PointCloud`: points and their attributes."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from gppcs.clouds import objects
from gppcs.clouds.columns import NORMALS as NORMALS
from gppcs.clouds.columns import Column, parts_of_columns, unmasked
from gppcs.clouds.header import Header
from gppcs.engine.equality import ComparedByValue
from gppcs.errors import InputError, shown
from gppcs.spatial.units import Units

LIBRARIES = "Open3D, PyVista, trimesh, pandas, PyArrow or laspy"
ACCEPTED = f"a PointCloud, an object of {LIBRARIES}, or an (N, 3) array of coordinates"


@dataclass(frozen=True, eq=False)
class PointCloud(ComparedByValue):
    """N points, each with the same attributes.

    A cloud can be used as an array of its points: `np.asarray(cloud)` is `cloud.points`, `len(cloud)` is N, and a loop
    over the cloud yields the coordinates of each point. See `PointCloud.__getitem__` for `cloud[indices]`.

    Parameters
    ----------
    points : (N, 3) array, float64
        Coordinates, in any unit. They may be NaN or infinite. An (N, 2) array is a cloud of the plane z = 0.
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
        If `points` is not a numeric (N, 3) or (N, 2) array, `attributes` are not arrays of N rows by name,
        `coordinate_dtype` is no type of numbers, or `header` is no header.

    Examples
    --------
    >>> cloud = gppcs.PointCloud([[0, 0, 0], [1, 0, 0]], {"intensity": [7, 9]})
    >>> cloud
    PointCloud(2 points, each with intensity)
    >>> cloud.points
    array([[0., 0., 0.],
           [1., 0., 0.]])
    >>> cloud[cloud.attributes["intensity"] > 8].attributes["intensity"]
    array([9])
    """

    points: NDArray[np.float64]
    attributes: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    coordinate_dtype: np.dtype[np.generic] = field(default_factory=lambda: np.dtype(np.float64))
    header: Header | None = None

    def __post_init__(self) -> None:
        points = array_of(self.points)
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            actual = points.shape or _described(self.points)
            raise InputError(f"expected points of shape (N, 3), found {actual}{_remedy(points.shape)}")
        require_numbers(points.dtype, "numbers as coordinates, found an array of")
        if points.shape[1] == 2:
            points = np.column_stack([points, np.zeros(len(points))])
        object.__setattr__(self, "points", np.ascontiguousarray(points, dtype=np.float64))
        if not (isinstance(self.attributes, Mapping) and all(isinstance(name, str) for name in self.attributes)):
            raise InputError(
                f"expected attributes by name, such as {{'label': labels}}, found {shown(self.attributes)}"
            )
        attributes = {}
        for name, attribute in self.attributes.items():
            attributes[name] = values = array_of(attribute, f"an array as attribute {name!r}")
            if values.shape[:1] != (len(points),):
                raise InputError(
                    f"expected attribute {name!r} to have one row for each of the {len(points)} points, "
                    f"found shape {values.shape}"
                )
        object.__setattr__(self, "attributes", attributes)
        try:
            dtype = np.dtype(self.coordinate_dtype)
        except TypeError as error:
            actual = shown(self.coordinate_dtype)
            raise InputError(f"expected a type of NumPy as coordinate_dtype, found {actual}") from error
        require_numbers(dtype, "a type of numbers as coordinate_dtype, found")
        object.__setattr__(self, "coordinate_dtype", dtype)
        if not isinstance(self.header, Header | None):
            raise InputError(f"expected the header of a cloud that was read, found {shown(self.header)}")

    @classmethod
    def from_columns(cls, columns: Mapping[str, Column]) -> PointCloud:
        """Make a cloud of columns, (N, ...): x, y and z are the coordinates, the others become attributes."""
        return cls(*parts_of_columns(columns))

    @classmethod
    def from_object(cls, cloud: CloudLike) -> PointCloud:
        """Return a cloud unchanged, or make one of an array or an object of another library.

        All functions that take a cloud take these. Libraries are recognised without importing them. The names of
        attributes are those of PLY files: colours become `red`, `green`, `blue` and `alpha`, normals become `nx`, `ny`
        and `nz`. All arrays keep their types.

        Parameters
        ----------
        cloud : PointCloud, (N, 3) or (N, 2) array-like, or object of another library
            An object is one of these:

            - a `Result`, whose cloud is taken, or what `gppcs.open` returns, which is read
            - a masked array, in which masked numbers are NaN, so that their points are invalid
            - a structured array with fields x, y and z; the other fields become attributes
            - `open3d.geometry.PointCloud` or `open3d.t.geometry.PointCloud`, with colours, normals, covariances or all
              other tensors
            - a data set of PyVista, such as `pyvista.PolyData`, with its `point_data`
            - `trimesh.PointCloud` or `trimesh.Trimesh`, with colours and attributes of the vertices, and their normals
              if these are stored
            - `pandas.DataFrame` with columns x, y and z, or X, Y and Z; the other columns become attributes
            - `pyarrow.Table` or `RecordBatch`, in the same manner
            - `laspy.LasData`, with all dimensions; the coordinates are scaled
            - a tensor on the CPU, such as one of PyTorch, or another array that NumPy takes, also by DLPack. float64 in
              rows is not copied

        Returns
        -------
        PointCloud
            `coordinate_dtype` is the type of the coordinates. For whole numbers in an array that is not structured, it
            is float64.

        Raises
        ------
        InputError
            If it is none of these, a coordinate is missing, or an attribute holds text.

        Examples
        --------
        >>> import pandas
        >>> table = pandas.DataFrame({"x": [0.0, 1.0], "y": [0.0, 0.5], "z": [0.0, 2.0], "label": [4, 5]})
        >>> gppcs.PointCloud.from_object(table)
        PointCloud(2 points, each with label)
        """
        if isinstance(cloud, PointCloud):
            return cloud
        if isinstance(result := getattr(cloud, "cloud", None), PointCloud):
            return result
        if isinstance(cloud, str | os.PathLike):
            raise InputError(
                f"expected {ACCEPTED}, found the path {shown(os.fspath(cloud))}; read the file with gppcs.read first"
            )
        if type(cloud) is not np.ndarray or cloud.dtype.names:
            parts = objects.parts_of_object(cloud)
            if parts is not None:
                return cls(*parts)
        points = array_of(cloud, ACCEPTED)
        if points.ndim == 0:
            raise InputError(f"expected {ACCEPTED}, found {_described(cloud)}")
        return cls(points, coordinate_dtype=_floating(points.dtype))

    def __repr__(self) -> str:
        carried = f", each with {', '.join(self.attributes)}" if self.attributes else ""
        return f"PointCloud({len(self):,} points{carried})"

    def __len__(self) -> int:
        return len(self.points)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self.points, dtype) if copy is None else np.array(self.points, dtype, copy=copy)

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        return iter(self.points)

    @overload
    def __getitem__(self, indices: int) -> NDArray[np.float64]: ...

    @overload
    def __getitem__(self, indices: slice | ArrayLike) -> PointCloud: ...

    def __getitem__(self, indices: Any) -> PointCloud | NDArray[np.float64]:
        """Return a part of the cloud with all attributes, or the coordinates of one point, (3,).

        Indices are a slice, a mask, (N,), or whole numbers, (M,).
        """
        if isinstance(indices, slice):
            return self.take(np.arange(len(self))[indices])
        chosen = array_of(indices, "indices of points")
        if not chosen.size and chosen.dtype == np.float64:  # what NumPy makes of an empty list
            chosen = chosen.astype(np.int64)
        is_index = chosen.dtype.kind in "iu" or (chosen.dtype.kind == "b" and chosen.ndim)
        if isinstance(indices, tuple) or chosen.ndim > 1 or not is_index:
            raise TypeError(
                f"expected a slice, a mask or indices of points, found {shown(indices)}; coordinates are in .points, "
                "attributes in .attributes"
            )
        positive = np.arange(len(self))[chosen]
        return self.take(positive) if chosen.ndim else self.points[positive]

    def take(self, indices: NDArray[np.int64]) -> PointCloud:
        """Return a copy of the points with some indices, (M,), in that order, with all attributes."""
        attributes = {name: values[indices] for name, values in self.attributes.items()}
        return PointCloud(self.points.take(indices, axis=0), attributes, self.coordinate_dtype, self.header)

    def moved(self, points: NDArray[np.float64]) -> PointCloud:
        """Return the cloud with other coordinates, (N, 3); a `coordinate_dtype` of integers becomes float64."""
        return replace(self, points=points, coordinate_dtype=_floating(self.coordinate_dtype))

    to_open3d = objects.to_open3d
    to_pyvista = objects.to_pyvista
    to_trimesh = objects.to_trimesh
    to_pandas = objects.to_pandas

    @property
    def units(self) -> Units | None:
        """The units of the axes, if the header tells them."""
        return self.header.units if self.header else None

    def factors(self) -> NDArray[np.float64]:
        """Return the factors, (3,), that bring all axes to the unit of lengths; 1 if they have one unit."""
        points = self.points[self.is_finite()] if self.units and self.units.is_mixed else self.points[:0]
        return self.units.factors(points.min(axis=0), points.max(axis=0)) if self.units and len(points) else np.ones(3)

    def is_finite(self) -> NDArray[np.bool_]:
        """Return for which points, (N,), all coordinates are finite."""
        x, y, z = np.isfinite(self.points).T  # several times as fast as `all` along the short axis
        return x & y & z

    def normals(self) -> NDArray[np.float64] | None:
        """Return the normals in the attributes `nx`, `ny` and `nz`, (N, 3); None if one of these is missing."""
        if not set(NORMALS) <= set(self.attributes):
            return None
        return np.stack([self.attributes[name] for name in NORMALS], axis=1).astype(np.float64)


class HasCloud(Protocol):
    """A result, or files that `gppcs.open` has opened."""

    @property
    def cloud(self) -> PointCloud: ...  # noqa: D102


class HasPoints(Protocol):
    """An object of Open3D, PyVista or laspy."""

    @property
    def points(self) -> Any: ...  # noqa: D102


class HasVertices(Protocol):
    """An object of trimesh."""

    @property
    def vertices(self) -> Any: ...  # noqa: D102


# What functions take for a cloud, most of them also as the names of files; tables of pandas are like arrays.
CloudLike: TypeAlias = (
    ArrayLike | HasCloud | HasPoints | HasVertices | os.PathLike[str] | Sequence[str | os.PathLike[str]]
)


def with_normals(cloud: PointCloud, normals: NDArray[np.float64]) -> PointCloud:
    """Return a cloud with these normals, (N, 3), as attributes."""
    columns = np.ascontiguousarray(normals.T, dtype=np.float32)
    return replace(cloud, attributes={**cloud.attributes, **dict(zip(NORMALS, columns, strict=True))})


def usable(cloud: CloudLike, name: str) -> NDArray[np.float64]:
    """Return the coordinates, (N, 3), if there are some and all are finite; errors call the cloud by a name."""
    cloud = PointCloud.from_object(cloud)
    if len(cloud) == 0:
        raise InputError(f"the {name} is empty: expected at least one point")
    if not (mask := cloud.is_finite()).all():
        raise InputError(
            f"expected finite coordinates in the {name}, found {(~mask).sum()} points with NaN or infinite ones, the "
            f"first at index {np.argmin(mask)}: drop them first"
        )
    return cloud.points


def array_of(values: Any, name: str = "an (N, 3) array of coordinates") -> NDArray[Any]:
    """Return values as an array; raise an InputError if NumPy cannot make one."""
    try:
        return unmasked(values)
    except ValueError as error:
        raise InputError(f"expected {name}, found {type(values).__name__} with rows of different lengths") from error
    except (TypeError, LookupError, AttributeError, RuntimeError, BufferError) as error:  # of what is like no array
        reason = " ".join(str(error).split())
        raise InputError(f"expected {name}, found {_described(values)}, of which NumPy says: {reason}") from error


def _remedy(shape: tuple[int, ...]) -> str:
    """Return what to do about points of a wrong shape, if that can be guessed, as the end of a message."""
    if len(shape) == 3:
        return "; gppcs.simplify_batch takes several clouds"
    if len(shape) != 2 or shape[1] < 4:
        return ""
    if shape[0] == 3:
        return "; transpose the array: points.T"
    return "; pass further columns as attributes: PointCloud(points[:, :3], {'intensity': points[:, 3]})"


def require_numbers(dtype: np.dtype[Any], expected: str) -> None:
    """Raise an error unless a type is one of real numbers."""
    if dtype.kind not in "iuf":
        raise InputError(f"expected {expected} {dtype}")


def _floating(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return a type of floats, or float64 in place of another type."""
    return dtype if dtype.kind == "f" else np.dtype(np.float64)


def _described(value: Any) -> str:
    """Return what a message calls a value: objects of libraries by their class, since they may print many lines."""
    kind = type(value)
    return shown(value) if kind.__module__ in ("builtins", "numpy") else f"{kind.__module__}.{kind.__qualname__}"
