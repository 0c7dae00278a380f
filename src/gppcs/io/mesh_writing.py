"""Writes meshes: PLY, OBJ, STL and OFF, and glTF by trimesh."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.colours import eight_bits
from gppcs.clouds.mesh import Mesh
from gppcs.engine.extras import require_trimesh
from gppcs.errors import FileFormatError, InputError, file_path, flag, shown
from gppcs.io.columns import coordinate_type
from gppcs.io.format import reduced
from gppcs.io.meshes import STL_FACET
from gppcs.io.ply import FORMAT as PLY
from gppcs.io.ply import write_ply
from gppcs.io.rows import write_rows
from gppcs.io.streams import inner_name, whole_output

COLOURS = ("red", "green", "blue")  # attributes that hold the colour of a point
STL_COMMENT = b"gppcs".ljust(80)


def write_mesh(
    path: str | os.PathLike[str], mesh: Mesh, vertices: PointCloud | None = None, force: bool = False
) -> list[str]:
    """Write a mesh file: PLY, OBJ, STL, OFF or glTF.

    PLY holds all attributes of the vertices, the others colours and normals at most. The file appears under its name
    only when it is complete.

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

    Returns
    -------
    list of str
        The names of the attributes that the file does not hold; then in words what is lost of the header of the
        vertices, such as a coordinate system.

    Raises
    ------
    FileFormatError
        If the format is unknown, or gppcs does not write meshes in it.
    OutputError
        If the file exists and `force` is False, or the folder is missing or not writable.
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
    >>> gppcs.write_mesh("ball.stl", result.mesh, result.cloud)
    ['nx', 'ny', 'nz', 'curvature', 'red', 'green', 'blue']
    """
    if not isinstance(mesh, Mesh):
        raise InputError(f"expected a gppcs.Mesh, found {shown(mesh)}")
    cloud = PointCloud(mesh.vertices) if vertices is None else vertices
    if not isinstance(cloud, PointCloud) or not np.array_equal(cloud.points, mesh.vertices):
        raise InputError("expected the vertices of the mesh as a PointCloud, found other points")
    write, held = _writer(path)
    with whole_output(path, flag("force", force)) as file:
        write(file, cloud, mesh.faces)
    return _left_out(cloud, held)


def _left_out(cloud: PointCloud, held: Sequence[str] | None) -> list[str]:
    """Return the names of the attributes that a file does not hold, and in words what it does not of the header."""
    kept = PLY.fitted(cloud)[0] if held is None else reduced(cloud, cloud.attributes.keys() - set(held))[0]
    header = cloud.header.contents() if cloud.header and kept.header is None else []
    return [*(name for name in cloud.attributes if name not in kept.attributes), *header]


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
    write, _ = _writer(path)
    if write is _write_gltf:
        require_trimesh()


def _writer(
    path: str | os.PathLike[str],
) -> tuple[Callable[[BinaryIO, PointCloud, NDArray[np.int64]], None], Sequence[str] | None]:
    """Return the function that writes a file, and the attributes that it writes, None for all."""
    suffix = inner_name(Path(file_path(path))).suffix.lower()
    if suffix not in _WRITERS:
        raise FileFormatError(
            f"{path}: expected one of the formats of meshes {' '.join(_WRITERS)}, found {suffix or 'no suffix'!r}"
        )
    return _WRITERS[suffix]


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
    if not set(COLOURS) <= set(cloud.attributes):
        return None
    return eight_bits(np.column_stack([cloud.attributes[name] for name in COLOURS]))


_WRITERS: dict[str, tuple[Callable[[BinaryIO, PointCloud, NDArray[np.int64]], None], Sequence[str] | None]] = {
    ".ply": (_write_ply, None),
    ".obj": (_write_obj, (*NORMALS, *COLOURS)),
    ".stl": (_write_stl, ()),
    ".off": (_write_off, (*NORMALS, *COLOURS)),
    ".glb": (_write_gltf, (*NORMALS, *COLOURS)),
}  # by suffix: the function, and the attributes that it writes; None for all
