"""Reads and writes mesh files: PLY, OBJ, STL and OFF, and glTF by trimesh."""

import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.mesh import Mesh, Texture
from gppcs.clouds.quantities import units_of
from gppcs.errors import FileFormatError, InputError, file_path, flag, shown
from gppcs.io.files import FORMATS, format_of, naming
from gppcs.io.format import Fit, Format
from gppcs.io.meshes import GLTF, OBJ, OFF, STL, origin_of, stored_of, write_gltf, write_stl
from gppcs.io.ply import FORMAT as PLY
from gppcs.io.streams import inner_name, plain_input, whole_output


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    r"""Read a mesh file: PLY, OBJ, OFF, STL or binary glTF (.glb).

    Parameters
    ----------
    path : str or path
        The file. Polygons become triangles that share their first corner. A gzip file is decompressed.

    Returns
    -------
    Mesh
        Vertices in the unit of the file.

    Raises
    ------
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
    with naming(source), plain_input(source) as file:
        content = format_of(file, source)
        if "faces" not in content.options:
            raise FileFormatError(f"expected a mesh, found {content.name}, whose files are point clouds")
        reader = content.open(file)
        assert reader.triangles is not None
        return Mesh(reader.read().points, reader.triangles())


def mesh_of(path: Path, faces: int) -> Mesh | None:
    """Read the mesh of a file with so many faces, if there are any and its suffix tells that it may be a mesh."""
    may_be = any(kind.has_suffix(inner_name(path).name) for kind in FORMATS if "faces" in kind.options)
    return read_mesh(path) if faces and may_be else None


def write_mesh(
    path: str | os.PathLike[str],
    mesh: Mesh,
    vertices: PointCloud | None = None,
    force: bool = False,
    lossy: bool = False,
    *,
    texture: Texture | None = None,
    unit: str | None = None,
) -> list[str]:
    """Write a mesh file: PLY, OBJ, STL, OFF or glTF.

    PLY holds all attributes of the vertices. OBJ, OFF and glTF hold normals and colours of 8 bits. STL holds none; its
    triangles have normals of their own. glTF is for display: z becomes y, which is up there, and lengths become metres
    if their unit is known; gppcs reads both as they were. Attributes that it cannot hold are left out. The file
    appears only when it is complete.

    Parameters
    ----------
    path : str or path
        The file. Its suffix selects the format: .ply, .obj, .stl, .off or .glb (binary glTF). A further suffix .gz
        compresses it.
    mesh : Mesh
        The triangles.
    vertices : PointCloud, optional
        The vertices of the mesh with their attributes, such as the `cloud` of a `MeshResult`. By default, the
        vertices have none.
    force : bool
        Whether to overwrite an existing file.
    lossy : bool
        Whether to leave out attributes that the format cannot hold, and to round coordinates and colours.
    texture : Texture, optional
        Colours of the mesh in place of those of its vertices, for glTF, by `gppcs.bake_texture`.
    unit : str, optional
        The unit of the coordinates, for glTF: "mm", "ft" and so on. By default, that of the coordinate system of
        `vertices`.

    Returns
    -------
    list of str
        In words what the file does not hold of the vertices: attributes, what their header says, such as a coordinate
        system, and the precision of coordinates and colours. Unless `lossy` is True, only what the header says.

    Raises
    ------
    FileFormatError
        If the format is unknown, or gppcs does not write meshes in it, or not with a texture.
    OutputError
        If the file exists and `force` is False, the folder is missing or not writable, or the format cannot hold all
        values of the vertices and `lossy` is False.
    InputError
        If `vertices` or `texture` are not those of the mesh.
    ParameterError
        If an argument has a wrong type, or the unit is unknown.

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
    force, units = flag("force", force), units_of(unit, cloud.header)
    chosen, fit = mesh_format_of(path, texture is not None), fit_vertices(cloud, path, flag("lossy", lossy))
    stored, faces, for_gltf = replace(fit.cloud, points=cloud.points), mesh.faces, dict[str, Any]()
    if chosen.name == GLTF.name and units:
        factors = units.factors(cloud.points.min(axis=0), cloud.points.max(axis=0))
        for_gltf["metres"] = factors * units.length
    if texture is not None:
        if not isinstance(texture, Texture) or not np.array_equal(texture.indices[texture.faces], faces):
            raise InputError("expected a texture of the mesh by gppcs.bake_texture, found one of another mesh")
        stored, faces, for_gltf["texture"] = stored.take(texture.indices), texture.faces, texture
    with whole_output(path, force) as file:
        assert chosen.write is not None
        # Normals of triangles come from the coordinates before they are rounded.
        chosen.write(file, stored, faces=faces, **for_gltf)
    return [*fit.values, *fit.remarks]


def fit_vertices(cloud: PointCloud, path: str | os.PathLike[str], lossy: bool) -> Fit:
    """Compare vertices with what a mesh file can store; of glTF, which is for display, lost values are no error."""
    chosen = mesh_format_of(path)
    return chosen.fit(cloud, path, lossy or chosen.name == GLTF.name)


def mesh_format_of(path: str | os.PathLike[str], textured: bool = False) -> Format:
    """Return the format of which `write_mesh` would write a file. Call it before long work."""
    suffix = inner_name(Path(file_path(path))).suffix.lower()
    if suffix not in _FORMATS:
        raise FileFormatError(
            f"{path}: expected one of the formats of meshes {' '.join(_FORMATS)}, found {shown(suffix)}"
        )
    if textured and _FORMATS[suffix].name != GLTF.name:
        raise FileFormatError(f"{path}: expected .glb, the format of meshes with a texture, found {shown(suffix)}")
    return _FORMATS[suffix]


_FORMATS = {
    ".ply": PLY,
    ".obj": replace(OBJ, stored=stored_of),  # meshes are written with the normals of their vertices
    ".stl": replace(STL, write=write_stl, stored=partial(stored_of, groups=(NORMALS,), single=True)),
    ".off": OFF,
    ".glb": replace(GLTF, write=write_gltf, stored=partial(stored_of, single=True, origin_of=origin_of)),
}  # by suffix
