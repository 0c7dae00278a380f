"""Meshes with their triangles, read by PyMeshLab, which comes with the extra `evaluate`."""

from __future__ import annotations

import os
from pathlib import Path

from gppcs.clouds.mesh import Mesh
from gppcs.engine.extras import require_pymeshlab
from gppcs.errors import FileFormatError, InputError
from gppcs.io.files import read
from gppcs.io.meshes import FACE_CHECKS


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Read a mesh of triangles or polygons, which are cut into triangles: PLY, OBJ, OFF, STL and more.

    Raises
    ------
    MissingExtraError
        If PyMeshLab is not installed.
    FileFormatError
        If the file is not a mesh of finite vertices, or holds several.
    OSError
        If there is no such file, or it cannot be read.
    """
    pymeshlab = require_pymeshlab()
    source = Path(path)
    if source.is_dir():
        raise FileFormatError(f"{source}: expected a file, found a folder; name a file")
    with open(source, "rb"):  # for the operating system's own words, if it cannot be read
        pass
    try:
        _require_sound(source)
    except FileFormatError as error:
        raise FileFormatError(f"{source}: {error}") from error
    meshes = pymeshlab.MeshSet(verbose=False)
    try:
        meshes.load_new_mesh(str(source))
    except pymeshlab.PyMeshLabException as error:
        raise FileFormatError(f"{source}: expected a mesh; {str(error).strip()}") from error
    if len(meshes) > 1:
        raise FileFormatError(f"{source}: expected one mesh, found {len(meshes)}; join them, or name a file of one")
    read = meshes.current_mesh()
    try:
        return Mesh(read.vertex_matrix(), read.face_matrix())
    except InputError as error:
        raise FileFormatError(f"{source}: {error}") from error


def _require_sound(source: Path) -> None:
    """Refuse what PyMeshLab would leave out in silence, or crash on: vertices not finite, faces of missing vertices."""
    suffix = source.suffix.lower()
    if suffix in FACE_CHECKS:
        with open(source, "rb") as file:
            FACE_CHECKS[suffix](file)
    if suffix in (".ply", ".off", ".obj", ".stl"):
        try:
            cloud = read(source, suffix)
        except FileFormatError:  # PyMeshLab may know more dialects
            return
        if len(bad := cloud.non_finite()):
            raise FileFormatError(
                f"expected finite vertices, found {len(bad)} that are not, the first at index {bad[0]}: "
                "leave them out, with their faces"
            )
