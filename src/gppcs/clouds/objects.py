"""Converts between clouds and the objects of other libraries.

The objects are recognised by the names of their classes, so that nothing is imported to recognise them. To accept
another class, write a function that makes a cloud of its objects and add it to `MAKERS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.columns import COLOUR, NORMALS, CloudParts, Column, parts_of_columns, unmasked
from gppcs.engine.extras import require
from gppcs.errors import InputError

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud

RGBA = (*COLOUR, "alpha")

# Arrays of several columns that libraries keep under names of their own, and the attributes that their columns become.
Vectors = Mapping[str, tuple[str, ...]]
OPEN3D: Vectors = {"colors": COLOUR, "normals": NORMALS}
PYVISTA: Vectors = {"RGBA": RGBA, "RGB": COLOUR, "Normals": NORMALS}

VERTEX_ATTRIBUTES = "vertex_attributes"  # trimesh's name for them at meshes; its point clouds hold them as metadata


def parts_of_object(value: Any) -> CloudParts | None:
    """Return what a cloud is made of, from an object of another library or a structured array; else None."""
    for base in type(value).__mro__:
        maker = MAKERS.get((base.__module__.partition(".")[0], base.__name__))
        if maker is not None:
            return maker(value)
    return None


def _from_structured(table: Any) -> CloudParts | None:
    if table.dtype.names is None:
        return None
    if table.ndim != 1:
        raise InputError(f"expected a structured array of shape (N,), found {table.shape}")
    return parts_of_columns({name: unmasked(table[name]) for name in table.dtype.names})


def _from_pandas(table: Any) -> CloudParts:
    if not table.columns.is_unique:
        repeated = table.columns[table.columns.duplicated()][0]
        raise InputError(f"expected columns of different names, found {repeated!r} twice; rename one")
    return parts_of_columns({name: _column(table[name], name) for name in table.columns})


def _from_arrow(table: Any) -> CloudParts:
    return _from_pandas(table.to_pandas())


def _column(series: Any, name: Any) -> Column:
    """Return a column of a table as an array of its own type."""
    try:
        values: Column = series.to_numpy(getattr(series.dtype, "numpy_dtype", None))
    except ValueError as error:
        raise InputError(
            f"expected a number for each point in column {name!r}, found missing values; fill them or drop their rows"
        ) from error
    if values.dtype.kind == "O" and all(isinstance(value, str) for value in values.flat):
        return values.astype(np.str_)
    _require_numbers(values, f"column {name!r}")
    return values


def _require_numbers(values: Column, name: str) -> None:
    if values.dtype.kind in "OUST":
        raise InputError(f"expected numbers in {name}, found text or objects; drop it, or turn it into numbers")


def _from_open3d(cloud: Any) -> CloudParts:
    if hasattr(cloud, "point"):  # a point cloud of `open3d.t`, which holds tensors
        arrays = {name: tensor.cpu().numpy() for name, tensor in cloud.point.items()}
        # Open3D holds one number for each point with a second axis.
        arrays |= {name: values[:, 0] for name, values in arrays.items() if values.shape[1:] == (1,)}
        return _parts(arrays.pop("positions", np.empty((0, 3))), arrays, OPEN3D)
    # Copies, since Open3D may move what its vectors hold.
    arrays = {name: np.array(getattr(cloud, name)) for name in ("colors", "normals", "covariances")}
    return _parts(np.array(cloud.points), {name: values for name, values in arrays.items() if len(values)}, OPEN3D)


def _from_pyvista(data: Any) -> CloudParts:
    return _parts(data.points, {name: data.point_data[name] for name in data.point_data}, PYVISTA)


def _from_trimesh_cloud(cloud: Any) -> CloudParts:
    arrays = dict(cloud.metadata.get(VERTEX_ATTRIBUTES, {}))
    if len(cloud.colors):
        arrays |= zip(RGBA, cloud.colors.T, strict=True)
    return _parts(cloud.vertices, arrays)


def _from_trimesh(mesh: Any) -> CloudParts:
    arrays = dict(mesh.vertex_attributes)
    if mesh.visual.kind == "vertex":
        arrays |= zip(RGBA, mesh.visual.vertex_colors.T, strict=True)
    if "vertex_normals" in mesh._cache:  # the property itself would compute them
        arrays |= zip(NORMALS, mesh.vertex_normals.T, strict=True)
    return _parts(mesh.vertices, arrays)


def _from_laspy(data: Any) -> CloudParts:
    names = [name for name in data.point_format.dimension_names if name not in ("X", "Y", "Z")]
    return _parts(np.column_stack([data.x, data.y, data.z]), {name: data[name] for name in names})


MAKERS: Mapping[tuple[str, str], Callable[[Any], CloudParts | None]] = {  # by package and class
    ("numpy", "ndarray"): _from_structured,
    ("open3d", "PointCloud"): _from_open3d,
    ("pyvista", "DataSet"): _from_pyvista,
    ("trimesh", "PointCloud"): _from_trimesh_cloud,
    ("trimesh", "Trimesh"): _from_trimesh,
    ("pandas", "DataFrame"): _from_pandas,
    ("laspy", "LasData"): _from_laspy,
    ("pyarrow", "Table"): _from_arrow,
    ("pyarrow", "RecordBatch"): _from_arrow,
}


def _parts(points: Any, arrays: Mapping[str, Any], vectors: Vectors | None = None) -> CloudParts:
    """Return what a cloud is made of, from points and arrays; each column of a vector becomes an attribute."""
    attributes: dict[str, Column] = {}
    for name, array in arrays.items():
        values = unmasked(array)
        _require_numbers(values, f"array {name!r}")
        parts = (vectors or {}).get(name, ())
        if parts and values.ndim == 2 and values.shape[1] == len(parts) and not set(parts) & {*arrays, *attributes}:
            attributes |= zip(parts, np.ascontiguousarray(values.T), strict=True)
        else:
            attributes[name] = values
    points = unmasked(points)
    return points, attributes, points.dtype if points.dtype.kind == "f" else np.dtype(np.float64)


def to_open3d(cloud: PointCloud) -> Any:
    """Return the cloud as a new `open3d.t.geometry.PointCloud`, with all attributes.

    `normals` are made of `nx`, `ny` and `nz`, `colors` of `red`, `green` and `blue`. The coordinates are float32 if
    `coordinate_dtype` is, otherwise float64. An InputError names attributes of types that Open3D lacks.
    """
    open3d = require("open3d", "an object of Open3D needs Open3D")
    if "positions" in cloud.attributes:
        raise InputError("expected other names than 'positions', which Open3D calls the points; rename the attribute")
    arrays = _joined(_native(cloud, "Open3D", "biuf"), OPEN3D)
    made = open3d.t.geometry.PointCloud(open3d.core.Tensor(single_or_double(cloud)))
    for name, values in arrays.items():
        made.point[name] = open3d.core.Tensor(values[:, None] if values.ndim == 1 else values)
    return made


def to_pyvista(cloud: PointCloud) -> Any:
    """Return the cloud as a new `pyvista.PolyData`, with all attributes as `point_data`.

    `Normals` is made of `nx`, `ny` and `nz`, `RGB` or `RGBA` of `red`, `green`, `blue` and `alpha`. An attribute of
    three or more axes becomes one of two. An InputError names attributes of types that PyVista lacks.
    """
    pyvista = require("pyvista", "an object of PyVista needs PyVista")
    arrays = _joined(_native(cloud, "PyVista", "biufc"), PYVISTA)
    made = pyvista.PolyData(single_or_double(cloud))
    for name, values in arrays.items():
        made.point_data[name] = values if values.ndim == 1 else _matrix(values)
    if "Normals" in arrays.keys() - cloud.attributes.keys():
        made.point_data.active_normals_name = "Normals"
    return made


def to_trimesh(cloud: PointCloud) -> Any:
    """Return the cloud as a new `trimesh.PointCloud`, with all attributes.

    `colors` are made of `red`, `green`, `blue` and `alpha` if these are uint8; without `alpha`, trimesh sets it to
    255. All other attributes are in `metadata["vertex_attributes"]`.
    """
    import trimesh

    arrays = {name: values.copy() for name, values in cloud.attributes.items()}
    parts = RGBA if "alpha" in arrays else COLOUR
    colours = None
    if all(part in arrays and arrays[part].dtype == np.uint8 and arrays[part].ndim == 1 for part in parts):
        colours = np.column_stack([arrays.pop(part) for part in parts])
    metadata = {VERTEX_ATTRIBUTES: arrays} if arrays else None
    return trimesh.PointCloud(cloud.points.copy(), colours, metadata)


def to_pandas(cloud: PointCloud) -> Any:
    """Return the cloud as a new `pandas.DataFrame` with the columns x, y, z and one for each attribute.

    An attribute with k numbers for each point becomes k columns, called name_0, name_1 and so on; an InputError
    names columns that would be twice. The coordinates are of type `coordinate_dtype`; but if that is a type of
    integers and some coordinates are none, they are float64.
    """
    import pandas

    with np.errstate(invalid="ignore"):
        points = cloud.points.astype(cloud.coordinate_dtype.newbyteorder("="))
    if points.dtype.kind != "f" and not (points == cloud.points).all():
        points = cloud.points
    columns = dict(zip("xyz", points.T, strict=True))
    for attribute, values in cloud.attributes.items():
        names = [attribute] if values.ndim == 1 else [f"{attribute}_{i}" for i in range(_matrix(values).shape[1])]
        for name, column in zip(names, _matrix(values).T, strict=True):
            if name in columns:
                raise InputError(f"expected columns of different names, found {name!r} twice; rename the attribute")
            columns[name] = np.asarray(column, column.dtype.newbyteorder("="))
    return pandas.DataFrame(columns, copy=True)


def _matrix(values: Column) -> Column:
    """Return values of any shape (N, ...) as (N, k)."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


def single_or_double(cloud: PointCloud) -> NDArray[np.floating[Any]]:
    """Return a copy of the points, (N, 3), in float32 if the cloud's source has them so, otherwise in float64."""
    return cloud.points.astype(np.float32 if cloud.coordinate_dtype.newbyteorder("=") == np.float32 else np.float64)


def _native(cloud: PointCloud, library: str, kinds: str) -> dict[str, Column]:
    """Return copies of the attributes in this machine's byte order; raise an InputError for types a library lacks."""
    for name, values in cloud.attributes.items():
        if values.dtype.kind not in kinds or values.dtype.char in "egG":
            raise InputError(
                f"expected a type that {library} has, found {values.dtype} in attribute {name!r}; convert the attribute"
            )
    return {name: values.astype(values.dtype.newbyteorder("=")) for name, values in cloud.attributes.items()}


def _joined(attributes: Mapping[str, Column], vectors: Vectors) -> dict[str, Column]:
    """Return the attributes, of which those that are columns of a library's vectors become these vectors."""
    arrays = dict(attributes)
    for name, parts in vectors.items():
        columns = [arrays[part] for part in parts if part in arrays and arrays[part].ndim == 1]
        if len(columns) == len(parts) and len({column.dtype for column in columns}) == 1 and name not in arrays:
            arrays = {key: values for key, values in arrays.items() if key not in parts}
            arrays[name] = np.column_stack(columns)
    return arrays
