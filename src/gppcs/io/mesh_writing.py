"""Writes meshes: PLY, OBJ, STL and OFF, and glTF by trimesh."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.engine.extras import require_trimesh
from gppcs.errors import FileFormatError, InputError, file_path, flag, shown
from gppcs.io.files import refuse_losses
from gppcs.io.format import rounding, without_foreign_header
from gppcs.io.meshes import COLOURS, STL_FACET, colours_of, held, write_obj, write_off
from gppcs.io.ply import FORMAT as PLY
from gppcs.io.ply import write_ply
from gppcs.io.streams import inner_name, whole_output

STL_COMMENT = b"gppcs".ljust(80)


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
        Whether to leave out attributes that the format cannot hold, and to round coordinates and colours.

    Returns
    -------
    list of str
        In words what the file does not hold of the vertices: attributes, what their header says, such as a coordinate
        system, and the precision of coordinates and colours. Unless `lossy` is True, only what the header says.

    Raises
    ------
    FileFormatError
        If the format is unknown, or gppcs does not write meshes in it.
    OutputError
        If the file exists and `force` is False, the folder is missing or not writable, or the format cannot hold all
        values of the vertices and `lossy` is False.
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
        chosen.write(file, chosen.fitted(cloud)[0], mesh.faces)
    values, remarks = _losses(chosen, cloud)
    return [*values, *remarks]


def check_mesh_storable(path: str | os.PathLike[str], cloud: PointCloud, lossy: bool = False) -> None:
    """Check that `write_mesh` can write a mesh whose vertices are points of a cloud. Call it before long work."""
    chosen = _format_of(path)
    if not flag("lossy", lossy):
        refuse_losses(path, chosen.name, _losses(chosen, cloud)[0])


def _losses(chosen: _MeshFormat, cloud: PointCloud) -> tuple[list[str], list[str]]:
    """Return in words the values of a cloud of vertices that a format cannot hold, and the remarks."""
    cloud, remarks = without_foreign_header(cloud, PLY.header if chosen.fitted is PLY.fitted else None)
    lost = chosen.fitted(cloud)[1]
    if chosen.single:
        with np.errstate(over="ignore"):
            digits, tolerated = rounding(cloud.points, cloud.points.astype(np.float32).astype(np.float64))
        (remarks if tolerated else lost).extend(digits)
    return lost, remarks


def check_mesh_format(path: str | os.PathLike[str]) -> None:
    """Check that gppcs can write meshes in the format of a file. Call it before long work."""
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
    write_ply(file, cloud, faces=faces)


def _write_stl(file: BinaryIO, cloud: PointCloud, faces: NDArray[np.int64]) -> None:
    """Write a binary file of triangles with their normals."""
    facets = np.zeros(len(faces), STL_FACET)
    corners = cloud.points[faces]
    facets["corners"] = corners
    products = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(products, axis=1, keepdims=True)
    facets["normal"] = np.divide(products, lengths, out=np.zeros_like(products), where=lengths > 0)
    file.write(STL_COMMENT + np.uint32(len(faces)).tobytes() + facets.tobytes())


def _write_gltf(file: BinaryIO, cloud: PointCloud, faces: NDArray[np.int64]) -> None:
    """Write a binary glTF file."""
    made = require_trimesh().Trimesh(
        cloud.points, faces, vertex_normals=cloud.normals(), vertex_colors=colours_of(cloud), process=False
    )
    file.write(made.export(file_type="glb", include_normals=cloud.normals() is not None))


class _MeshFormat(NamedTuple):
    """How meshes are written in a format, which vertices it can hold, and whether only in single precision."""

    name: str
    write: Callable[[BinaryIO, PointCloud, NDArray[np.int64]], None]
    fitted: Callable[[PointCloud], tuple[PointCloud, list[str]]]
    single: bool = False


_FORMATS = {
    ".ply": _MeshFormat("PLY", _write_ply, PLY.fitted),
    ".obj": _MeshFormat("OBJ", write_obj, partial(held, groups=(NORMALS, COLOURS))),
    ".stl": _MeshFormat("STL", _write_stl, partial(held, groups=(NORMALS,)), single=True),
    ".off": _MeshFormat("OFF", write_off, partial(held, groups=(NORMALS, COLOURS))),
    ".glb": _MeshFormat("glTF", _write_gltf, partial(held, groups=(NORMALS, COLOURS)), single=True),
}  # by suffix
