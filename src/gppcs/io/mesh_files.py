"""Reads mesh files with their triangles."""

from __future__ import annotations

import os
from pathlib import Path

from gppcs.clouds.mesh import Mesh
from gppcs.errors import FileFormatError, file_path
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.files import FORMATS, check_input, format_of, naming
from gppcs.io.streams import inner_name, plain_input


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    r"""Read a mesh file: PLY, OBJ, OFF, STL or binary glTF (.glb).

    Parameters
    ----------
    path : str or path
        The file. Polygons become triangles that share their first corner. A gzip or Zstandard file is decompressed.

    Returns
    -------
    Mesh
        Vertices in the unit of the file.

    Raises
    ------
    MissingExtraError
        If the file is glTF and trimesh is not installed.
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
    check_input(source)
    with naming(source), plain_input(source) as (file, name):
        known = format_of(file, name)
        if known.triangles is None:
            raise FileFormatError(f"expected a mesh, found {known.name}, whose files are point clouds")
        cloud = known.read(file)
        if len(bad := cloud.non_finite()):
            raise FileFormatError(
                f"expected finite vertices, found {len(bad)} that are not, the first at index {bad[0]}: "
                "remove them and their faces"
            )
        file.seek(0)
        return Mesh(cloud.points, known.triangles(file))


def mesh_of(path: Path, format: str | None = None) -> Mesh | None:  # noqa: A002
    """Read the mesh of a file, if it has one and its suffix tells that it may."""
    if not any(known.has_suffix(inner_name(path).suffix) for known in FORMATS if known.triangles):
        return None
    with CloudFiles.of([path], format, if_needed=True) as files:
        faces, _ = files.left_out()
    return read_mesh(path) if faces else None
