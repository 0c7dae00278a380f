"""Rebuilds surfaces from clouds, by PyMeshLab, and measures distances between meshes.

Surfaces are rebuilt by screened Poisson reconstruction of depth 8, with exact normals, or as in the paper with normals
from planes fitted to ten neighbours in the simplified cloud, each with the sign of the nearest normal of the original.
Distances are those from the vertices of one mesh to the surface of the other.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.mesh import Mesh
from gppcs.engine.arrays import Floats
from gppcs.engine.extras import require_pymeshlab
from gppcs.errors import InputError, NoSurfaceError
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs.spatial.triangles import nearest_triangles
from gppcs.surface.normals import with_signs_of

OCTREE_DEPTH = 8  # depth of the octree
NORMAL_NEIGHBOURS = 10  # points that a plane is fitted to
MEMBRANE = 4.0  # distance from all points beyond which a rebuilt surface is cut off, in spacings or octree cells


def estimated_normals(points: Floats, positions: Floats | None = None, guides: Floats | None = None) -> Floats:
    """Return normals, (M, 3), from planes fitted to the nearest points, signed as guides at positions, (V, 3)."""
    meshes = _mesh_set(points)
    meshes.compute_normal_for_point_clouds(k=NORMAL_NEIGHBOURS)
    normals: Floats = meshes.current_mesh().vertex_normal_matrix()
    if positions is None or guides is None:
        return normals
    nearest, _ = KdTree.build(positions).nearest_of(points, 1)
    return with_signs_of(normals, guides[nearest[:, 0]])


def exact_normals(mesh: Mesh, points: Floats) -> Floats:
    """Return the normals, (M, 3), of a mesh nearest to points, (M, 3): of a triangle, or of a vertex if that is it."""
    nearest, _, weights = nearest_triangles(mesh.vertices, mesh.faces, points)
    corners = np.column_stack([1.0 - weights.sum(axis=1), weights])
    vertices = mesh.faces[nearest, corners.argmax(axis=1)]
    is_vertex = corners.max(axis=1) > 1.0 - 1e-6  # but for rounding
    normals = np.where(is_vertex[:, None], mesh.vertex_normals()[vertices], mesh.face_normals()[nearest])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(lengths > 0.0, lengths, 1.0)


def reconstruct(points: Floats, normals: Floats) -> Mesh:
    """Return the screened Poisson mesh of points with normals, (M, 3) (Kazhdan and Hoppe 2013)."""
    meshes = _mesh_set(points, v_normals_matrix=normals)
    try:
        # One thread: several threads on few cores wait actively for each other, which takes minutes instead of seconds.
        meshes.generate_surface_reconstruction_screened_poisson(depth=OCTREE_DEPTH, preclean=True, threads=1)
        made = meshes.current_mesh()
        mesh = Mesh(made.vertex_matrix(), made.face_matrix())
        require_area(mesh, "rebuilt mesh")
        return mesh
    except (require_pymeshlab().PyMeshLabException, InputError) as error:
        work = f"the screened Poisson reconstruction of the {len(points)} points"
        raise NoSurfaceError(f"{work} gave no surface ({error}): expected points on a surface, with normals") from error


def without_membranes(mesh: Mesh, points: Floats) -> Mesh:
    """Return a mesh without what is far from all points, (M, 3), such as what a reconstruction adds over gaps."""
    tree = KdTree.build(np.unique(points, axis=0))
    spacing = np.sqrt(np.median(nearest_others(tree, min(6, len(tree.order) - 1))[1][:, -1]))
    limit = MEMBRANE * max(spacing, np.ptp(points, axis=0).max() / 2**OCTREE_DEPTH)
    near = tree.nearest_of(mesh.vertices, 1)[1][:, 0] <= limit**2
    faces = mesh.faces[near[mesh.faces].all(axis=1)]
    if not len(faces):
        raise NoSurfaceError(f"the surface rebuilt from the {len(points)} points lies far from all of these")
    return Mesh(mesh.vertices, faces)


def distances_to(mesh: Mesh, points: Floats) -> Floats:
    """Return the distance of each point to the surface of a mesh. Shapes: points (M, 3); returns (M,)."""
    _, squared, _ = nearest_triangles(mesh.vertices, mesh.faces, points)
    return np.sqrt(squared)


def count_self_intersections(mesh: Mesh) -> int:
    """Return the number of triangles that cut another triangle."""
    meshes = _mesh_set(mesh.vertices, face_matrix=mesh.faces)
    meshes.compute_selection_by_self_intersections_per_face()
    return int(meshes.current_mesh().selected_face_number())


def require_area(mesh: Mesh, name: str) -> None:
    """Raise an error if no triangle has an area above zero."""
    if not mesh.face_areas().any():
        raise InputError(f"the {name} has no area: expected triangles whose corners do not lie on a line")


def _mesh_set(points: Floats, **columns: NDArray[Any]) -> Any:
    """Return a PyMeshLab MeshSet with one mesh of points (M, 3), by default without faces."""
    pymeshlab = require_pymeshlab()
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points, **columns))
    return meshes
