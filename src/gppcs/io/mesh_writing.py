"""Writes meshes: PLY, OBJ, STL and OFF, and glTF by trimesh."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.colours import eight_bits, fit_eight_bits
from gppcs.clouds.mesh import Mesh
from gppcs.engine.extras import require_trimesh
from gppcs.errors import FileFormatError, InputError, file_path, flag, shown
from gppcs.io.columns import coordinate_type
from gppcs.io.files import refuse_losses
from gppcs.io.format import reduced
from gppcs.io.meshes import STL_FACET
from gppcs.io.ply import FORMAT as PLY
from gppcs.io.ply import write_ply
from gppcs.io.rows import write_rows
from gppcs.io.streams import inner_name, whole_output

COLOURS = ("red", "green", "blue")  # attributes that hold the colour of a point
STL_COMMENT = b"gppcs".ljust(80)
LARGEST_SHIFT = 1e-6  # of the diagonal, by which single precision may move a vertex; it is more far from the origin


def write_mesh(
    path: str | os.PathLike[str],
    mesh: Mesh,
    vertices: PointCloud | None = None,
    force: bool = False,
    lossy: bool = False,
) -> list[str]:
    """Write a mesh file: PLY, OBJ, STL, OFF or glTF.

    PLY holds all attributes of the vertices. OBJ, OFF and glTF hold normals and colours of 8 bits. STL holds none; its
    triangles have normals of their own. The file appears under its name only when it is complete.

    Parameters
    ----------
    path : str or path
        The file. Its suffix selects the format: .ply, .obj, .stl, .off or .glb (binary glTF). A further suffix .gz or
        .zst compresses it.
    mesh : Mesh
        The triangles.
    vertices : PointCloud, optional
        The vertices of the mesh with their attributes, such as the `cloud` of a `MeshResult`. By default, the
        vertices have none.
    force : bool
        Whether to overwrite an existing file.
    lossy : bool
        Whether to leave out what the format cannot hold, and to round coordinates and colours.

    Returns
    -------
    list of str
        In words what the file does not hold of the vertices: attributes, what their header says, such as a coordinate
        system, and the precision of coordinates and colours. Nothing unless `lossy` is True.

    Raises
    ------
    FileFormatError
        If the format is unknown, or gppcs does not write meshes in it.
    OutputError
        If the file exists and `force` is False, the folder is missing or not writable, or the format cannot hold all of
        the vertices and `lossy` is False.
    InputError
        If `vertices` are not those of the mesh.
    MissingExtraError
        If the format is glTF and trimesh is not installed.
    ParameterError
        If an argument has a wrong type.

    Examples
    --------
    >>> result = gppcs.mesh(gppcs.sample("sphere", n_points=3000), n_points=100)
    >>> gppcs.write_mesh("ball.ply", result.mesh, result.cloud)
    []
    >>> gppcs.write_mesh("ball.obj", result.mesh, result.cloud, lossy=True)
    ['attribute curvature (float32)']
    """
    if not isinstance(mesh, Mesh):
        raise InputError(f"expected a gppcs.Mesh, found {shown(mesh)}")
    cloud = PointCloud(mesh.vertices) if vertices is None else vertices
    if not isinstance(cloud, PointCloud) or not np.array_equal(cloud.points, mesh.vertices):
        raise InputError("expected the vertices of the mesh as a PointCloud, found other points")
    force = flag("force", force)
    check_mesh_storable(path, cloud, lossy)
    chosen = _format_of(path)
    with whole_output(path, force) as file:
        chosen.write(file, cloud, mesh.faces)
    return chosen.losses(cloud)


def check_mesh_storable(path: str | os.PathLike[str], cloud: PointCloud, lossy: bool = False) -> None:
    """Check that `write_mesh` can write a mesh whose vertices are points of a cloud. Call it before long work.

    Parameters
    ----------
    path, lossy
        As for `write_mesh`.
    cloud : PointCloud

    Raises
    ------
    FileFormatError, OutputError, ParameterError
        As for `write_mesh`.
    """
    chosen = _format_of(path)
    if not flag("lossy", lossy):
        refuse_losses(path, chosen.name, chosen.losses(cloud))


def _losses_of_ply(cloud: PointCloud) -> list[str]:
    return PLY.fitted(cloud)[1]


def _losses(cloud: PointCloud, held: Sequence[Sequence[str]], single: bool = False) -> list[str]:
    """Return in words what a format cannot hold of a cloud.

    It holds complete sets of attributes, and coordinates in single precision or as they are.
    """
    names = {name for group in held if set(group) <= set(cloud.attributes) for name in group}
    _, lost = reduced(cloud, cloud.attributes.keys() - names)
    if set(COLOURS) <= names and not fit_eight_bits(_stacked(cloud)):
        lost.append("colours (they are rounded to 8 bits)")
    if single and _is_rounded(cloud.points[cloud.finite_rows()]):
        lost.append("coordinates (they are rounded to single precision)")
    return lost


def _is_rounded(points: NDArray[np.float64]) -> bool:
    """Return whether single precision moves points noticeably."""
    if not len(points):
        return False
    with np.errstate(over="ignore"):
        shift = np.abs(points.astype(np.float32) - points).max()
    return bool(shift > LARGEST_SHIFT * np.linalg.norm(np.ptp(points, axis=0)))


def check_mesh_format(path: str | os.PathLike[str]) -> None:
    """Check that gppcs can write meshes in the format of a file. Call it before long work.

    Parameters
    ----------
    path : str or path
        The file to be written.

    Raises
    ------
    FileFormatError
        If the format is unknown, or gppcs does not write meshes in it.
    MissingExtraError
        If it needs a package that is not installed.
    """
    if _format_of(path).write is _write_gltf:
        require_trimesh()


def _format_of(path: str | os.PathLike[str]) -> _MeshFormat:
    suffix = inner_name(Path(file_path(path))).suffix.lower()
    if suffix not in _FORMATS:
        raise FileFormatError(
            f"{path}: expected one of the formats of meshes {' '.join(_FORMATS)}, found {suffix or 'no suffix'!r}"
        )
    return _FORMATS[suffix]


def _write_ply(file: BinaryIO, cloud: PointCloud, faces: NDArray[np.int64]) -> None:
    write_ply(file, PLY.fitted(cloud)[0], faces=faces)


def _write_obj(file: BinaryIO, cloud: PointCloud, faces: NDArray[np.int64]) -> None:
    """Write vertices with colours from 0 to 1, normals, and triangles."""
    colours, normals = _colours(cloud), cloud.normals()
    columns = list(_coordinates(cloud).T)
    if colours is not None:
        columns += list(np.round(colours / 255, 6).T)
    write_rows(file, columns, prefix="v ")
    numbers = faces + 1
    if normals is None:
        write_rows(file, list(numbers.T), prefix="f ")
        return
    write_rows(file, list(normals.astype(np.float32).T), prefix="vn ")
    file.writelines(b"f %d//%d %d//%d %d//%d\n" % (a, a, b, b, c, c) for a, b, c in numbers.tolist())


def _write_stl(file: BinaryIO, cloud: PointCloud, faces: NDArray[np.int64]) -> None:
    """Write a binary file of triangles with their normals."""
    facets = np.zeros(len(faces), STL_FACET)
    corners = cloud.points[faces]
    facets["corners"] = corners
    products = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(products, axis=1, keepdims=True)
    facets["normal"] = np.divide(products, lengths, out=np.zeros_like(products), where=lengths > 0)
    file.write(STL_COMMENT + np.uint32(len(faces)).tobytes() + facets.tobytes())


def _write_off(file: BinaryIO, cloud: PointCloud, faces: NDArray[np.int64]) -> None:
    """Write vertices with normals and colours, and triangles."""
    colours, normals = _colours(cloud), cloud.normals()
    columns, name = list(_coordinates(cloud).T), "OFF"
    if normals is not None:
        columns, name = columns + list(normals.astype(np.float32).T), f"N{name}"
    if colours is not None:
        columns, name = columns + list(colours.T), f"C{name}"
    file.write(f"{name}\n{len(cloud)} {len(faces)} 0\n".encode())
    write_rows(file, columns)
    write_rows(file, list(faces.T), prefix="3 ")


def _write_gltf(file: BinaryIO, cloud: PointCloud, faces: NDArray[np.int64]) -> None:
    """Write a binary glTF file."""
    made = require_trimesh().Trimesh(
        cloud.points, faces, vertex_normals=cloud.normals(), vertex_colors=_colours(cloud), process=False
    )
    file.write(made.export(file_type="glb", include_normals=cloud.normals() is not None))


def _coordinates(cloud: PointCloud) -> NDArray[np.float64]:
    return cloud.points.astype(coordinate_type(cloud), copy=False)


def _colours(cloud: PointCloud) -> NDArray[np.uint8] | None:
    """Return the colours of the vertices, (V, 3), as bytes; None if there are none."""
    return eight_bits(_stacked(cloud)) if set(COLOURS) <= set(cloud.attributes) else None


def _stacked(cloud: PointCloud) -> NDArray[Any]:
    """Return the colours of the vertices, (V, 3), in their own type."""
    return np.column_stack([cloud.attributes[name] for name in COLOURS])


class _MeshFormat(NamedTuple):
    """How meshes are written in a format, and in words what that loses of a cloud of vertices."""

    name: str
    write: Callable[[BinaryIO, PointCloud, NDArray[np.int64]], None]
    losses: Callable[[PointCloud], list[str]]


_FORMATS = {
    ".ply": _MeshFormat("PLY", _write_ply, _losses_of_ply),
    ".obj": _MeshFormat("OBJ", _write_obj, partial(_losses, held=(NORMALS, COLOURS))),
    ".stl": _MeshFormat("STL", _write_stl, partial(_losses, held=(NORMALS,), single=True)),
    ".off": _MeshFormat("OFF", _write_off, partial(_losses, held=(NORMALS, COLOURS))),
    ".glb": _MeshFormat("glTF", _write_gltf, partial(_losses, held=(NORMALS, COLOURS), single=True)),
}  # by suffix
