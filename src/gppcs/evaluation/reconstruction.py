"""Rebuilds a surface from a simplified cloud and measures distances between meshes, by PyMeshLab, as the paper does.

The conventions: screened Poisson reconstruction of depth 8; normals from planes fitted to ten neighbours in the
simplified cloud, each with the sign of the nearest normal of the original; distances from the vertices of one mesh to
the surface of the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.mesh import Mesh
from gppcs.engine.extras import require_pymeshlab
from gppcs.errors import InputError, NoSurfaceError
from gppcs.spatial.kdtree import KdTree

OCTREE_DEPTH = 8  # depth of the octree
NORMAL_NEIGHBOURS = 10  # points that a plane is fitted to


def estimated_normals(
    points: NDArray[np.float64],
    places: NDArray[np.float64] | None = None,
    guides: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return normals from planes fitted to the nearest points.

    Parameters
    ----------
    points : (M, 3) array, float64
        The cloud.
    places : (V, 3) array, float64, optional
        Where the signs of normals are known.
    guides : (V, 3) array, float64, optional
        Normals at `places`. Each result has the sign of the guide at the nearest place. Without guides, or if that
        guide is zero, neighbouring normals get the same sign.

    Returns
    -------
    (M, 3) array, float64
        Unit normals.

    Raises
    ------
    MissingExtraError
        If PyMeshLab is not installed.
    """
    meshes = _mesh_set(points)
    meshes.compute_normal_for_point_clouds(k=NORMAL_NEIGHBOURS)
    normals: NDArray[np.float64] = meshes.current_mesh().vertex_normal_matrix()
    if places is None or guides is None:
        return normals
    nearest, _ = KdTree.build(places).nearest_of(points, 1)
    opposed = np.einsum("ij,ij->i", normals, guides[nearest[:, 0]]) < 0
    return np.where(opposed[:, None], -normals, normals)


def reconstruct(points: NDArray[np.float64], normals: NDArray[np.float64]) -> Mesh:
    """Return the screened Poisson mesh of points with normals (Kazhdan and Hoppe 2013).

    Parameters
    ----------
    points : (M, 3) array, float64
        The cloud.
    normals : (M, 3) array, float64
        Normals that point outward.

    Returns
    -------
    Mesh
        In the unit of the points.

    Raises
    ------
    NoSurfaceError
        If the reconstruction gives no surface.
    MissingExtraError
        If PyMeshLab is not installed.
    """
    pymeshlab = require_pymeshlab()
    meshes = _mesh_set(points, v_normals_matrix=normals)
    try:
        # One thread: several threads on few cores wait actively for each other, which takes minutes instead of seconds.
        meshes.generate_surface_reconstruction_screened_poisson(depth=OCTREE_DEPTH, preclean=True, threads=1)
        rebuilt = meshes.current_mesh()
        mesh = Mesh(rebuilt.vertex_matrix(), rebuilt.face_matrix())
        mesh.require_area("rebuilt mesh")
        return mesh
    except (pymeshlab.PyMeshLabException, InputError) as error:
        raise NoSurfaceError(
            f"the screened Poisson reconstruction of the {len(points)} points gave no surface ({error}): expected "
            "points on a surface, with normals"
        ) from error


def distances_to(mesh: Mesh, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of each point to the surface of a mesh.

    Parameters
    ----------
    mesh : Mesh
        The surface.
    points : (M, 3) array, float64
        In the unit and frame of the mesh.

    Returns
    -------
    (M,) array, float64

    Raises
    ------
    MissingExtraError
        If PyMeshLab is not installed.
    """
    pymeshlab = require_pymeshlab()
    meshes = _mesh_set(points)
    used, faces = np.unique(mesh.faces, return_inverse=True)  # unused vertices would enlarge PyMeshLab's grid
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices[used], faces.reshape(mesh.faces.shape)))
    corners = np.concatenate([points, mesh.vertices[used]])
    reach = 2.0 * float(np.linalg.norm(np.ptp(corners, axis=0)))  # PyMeshLab clips larger distances
    meshes.compute_scalar_by_distance_from_another_mesh_per_vertex(
        measuremesh=0, refmesh=1, signeddist=False, maxdist=pymeshlab.PureValue(reach)
    )
    distances: NDArray[np.float64] = meshes.mesh(0).vertex_scalar_array()
    return distances


def count_self_intersections(mesh: Mesh) -> int:
    """Return the number of triangles that cut another triangle.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    int

    Raises
    ------
    MissingExtraError
        If PyMeshLab is not installed.
    """
    pymeshlab = require_pymeshlab()
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    meshes.compute_selection_by_self_intersections_per_face()
    return int(meshes.current_mesh().selected_face_number())


def _mesh_set(points: NDArray[np.float64], **columns: NDArray[np.float64]) -> Any:
    """Return a PyMeshLab MeshSet with one mesh of points (M, 3) and no faces."""
    pymeshlab = require_pymeshlab()
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points, **columns))
    return meshes
