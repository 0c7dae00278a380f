"""The paper's judge: the screened Poisson mesh of a simplified cloud beside the original mesh.

The conventions: depth 8; normals of a plane fit to ten neighbours in the simplified cloud, with the sign of the
original's normal nearest by; distances from the vertices of one mesh to the surface of the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.mesh import Mesh
from gppcs.engine.extras import require_pymeshlab
from gppcs.errors import InputError, NoSurfaceError
from gppcs.spatial.kdtree import KdTree

DEPTH = 8  # of the octree
NEIGHBOURS = 10  # of the plane fit


def estimated_normals(
    points: NDArray[np.float64],
    places: NDArray[np.float64] | None = None,
    guides: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return normals of plane fits to the nearest points, (M, 3), by PyMeshLab.

    Each has the sign of the guide, (V, 3), at the nearest place, (V, 3); without guides, or where the guide is zero, as
    at a vertex without triangles, neighbours agree.
    """
    meshes = _mesh_set(points)
    meshes.compute_normal_for_point_clouds(k=NEIGHBOURS)
    normals: NDArray[np.float64] = meshes.current_mesh().vertex_normal_matrix()
    if places is None or guides is None:
        return normals
    nearest, _ = KdTree.build(places).nearest_of(points, 1)
    opposed = np.einsum("ij,ij->i", normals, guides[nearest[:, 0]]) < 0
    return np.where(opposed[:, None], -normals, normals)


def reconstruct(points: NDArray[np.float64], normals: NDArray[np.float64]) -> Mesh:
    """Return the screened Poisson mesh (Kazhdan and Hoppe 2013) of points with normals, both (M, 3), by PyMeshLab.

    Raises
    ------
    NoSurfaceError
        If no surface comes out.
    """
    pymeshlab = require_pymeshlab()
    meshes = _mesh_set(points, v_normals_matrix=normals)
    try:
        # a single thread: with several on few cores they spin, and it takes minutes instead of seconds
        meshes.generate_surface_reconstruction_screened_poisson(depth=DEPTH, preclean=True, threads=1)
        rebuilt = meshes.current_mesh()
        mesh = Mesh(rebuilt.vertex_matrix(), rebuilt.face_matrix())
        mesh.require_area("rebuilt mesh")
        return mesh
    except (pymeshlab.PyMeshLabException, InputError) as error:
        raise NoSurfaceError(
            f"the screened Poisson reconstruction of the {len(points)} points gave no surface ({error}): expected "
            "points, with normals, that lie on one"
        ) from error


def distances_to(mesh: Mesh, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of each point, (M, 3), to the surface of a mesh, by PyMeshLab."""
    pymeshlab = require_pymeshlab()
    meshes = _mesh_set(points)
    used, faces = np.unique(mesh.faces, return_inverse=True)  # others would only stretch PyMeshLab's grid
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices[used], faces.reshape(mesh.faces.shape)))
    corners = np.concatenate([points, mesh.vertices[used]])
    reach = 2.0 * float(np.linalg.norm(np.ptp(corners, axis=0)))  # beyond it, PyMeshLab would cut distances off
    meshes.compute_scalar_by_distance_from_another_mesh_per_vertex(
        measuremesh=0, refmesh=1, signeddist=False, maxdist=pymeshlab.PureValue(reach)
    )
    distances: NDArray[np.float64] = meshes.mesh(0).vertex_scalar_array()
    return distances


def _mesh_set(points: NDArray[np.float64], **columns: NDArray[np.float64]) -> Any:
    pymeshlab = require_pymeshlab()
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points, **columns))
    return meshes
