"""Reads mesh files with their triangles, by PyMeshLab, and glTF by trimesh."""

from __future__ import annotations

import os
from pathlib import Path

from gppcs.clouds.mesh import Mesh
from gppcs.engine.extras import require_pymeshlab
from gppcs.errors import FileFormatError, InputError, file_path
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.files import naming
from gppcs.io.gltf import mesh_in_gltf
from gppcs.io.meshes import FACE_CHECKS
from gppcs.io.reading import read

SUFFIXES = (".ply", ".off", ".obj", ".stl")  # of meshes whose vertices gppcs reads, too
_GLTF = ".glb"  # which trimesh reads


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    r"""Read a mesh file: PLY, OBJ, OFF, STL and whatever else PyMeshLab reads, or binary glTF (.glb).

    Parameters
    ----------
    path : str or path
        The file. Polygons are split into triangles.

    Returns
    -------
    Mesh
        Vertices in the unit of the file.

    Raises
    ------
    MissingExtraError
        If PyMeshLab is not installed, or trimesh for glTF.
    FileFormatError
        If the file is not one mesh with finite vertices, or a face refers to a vertex that does not exist.
    ParameterError
        If `path` is neither text nor a path.
    OSError
        If the file does not exist or cannot be read.

    Examples
    --------
    >>> from pathlib import Path
    >>> _ = Path("square.off").write_text("OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n")
    >>> mesh = gppcs.read_mesh("square.off")
    >>> len(mesh.vertices), len(mesh.faces)
    (4, 2)
    """
    source = file_path(path)
    if source.is_dir():
        raise FileFormatError(f"{source}: expected a file, found a folder; name a file")
    with open(source, "rb"):  # raises the operating system's own error if the file cannot be read
        pass
    if source.suffix.lower() == _GLTF:
        with open(source, "rb") as file, naming(source):
            return mesh_in_gltf(file)
    pymeshlab = require_pymeshlab()
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
        raise FileFormatError(
            f"{source}: expected one mesh, found {len(meshes)}; merge them, or name a file with one mesh"
        )
    loaded = meshes.current_mesh()
    try:
        return Mesh(loaded.vertex_matrix(), loaded.face_matrix())
    except InputError as error:
        raise FileFormatError(f"{source}: {error}") from error


def mesh_of(path: Path, format: str | None = None) -> Mesh | None:  # noqa: A002
    """Read the mesh of a file, if it has one and its suffix tells PyMeshLab the format."""
    if path.suffix.lower() not in (*SUFFIXES, _GLTF):
        return None
    with CloudFiles.of([path], format, if_needed=True) as files:
        faces, _ = files.left_out()
    return read_mesh(path) if faces else None


def _require_sound(source: Path) -> None:
    """Raise an error for invalid vertices or faces, which PyMeshLab would drop silently or crash on."""
    suffix = source.suffix.lower()
    if suffix in FACE_CHECKS:
        with open(source, "rb") as file:
            FACE_CHECKS[suffix](file)
    if suffix in SUFFIXES:
        try:
            cloud = read(source, suffix)
        except FileFormatError:  # PyMeshLab may read more variants of the format
            return
        if len(bad := cloud.non_finite()):
            raise FileFormatError(
                f"expected finite vertices, found {len(bad)} that are not, the first at index {bad[0]}: "
                "remove them and their faces"
            )
