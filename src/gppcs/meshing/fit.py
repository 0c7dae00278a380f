"""Move vertices so that the mesh fits the dense points: each in turn, by its star; on noisy clouds at last jointly."""

import numpy as np

from gppcs.clouds.mesh import Mesh
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.cuts import TriangleTree, cutting, follow, is_free
from gppcs.meshing.draft import Draft
from gppcs.meshing.energy import FittedMesh
from gppcs.meshing.halfedges import following
from gppcs.meshing.stars import add_around, empty, fit_star, room_for_star, store
from gppcs.spatial.triangles import row
from gppcs.surface.inducing import joint_steps, noise_between

THIN = 0.1  # cost of thin triangles in fits, relative to that in flips
BOUNDARY = 0.2  # weight of the planes through boundary edges in fits, relative to that in collapses
SWEEPS = 2  # through all vertices


def fit(draft: Draft, assigned: Assignment) -> Assignment:
    """Fit the vertices to the dense points, and return the triangles of these."""
    fitted = FittedMesh.from_points(draft.mesh, draft.vertices, draft.dense.positions, assigned)
    fitted.boundaries[:] *= BOUNDARY
    for _ in range(SWEEPS):
        fit_all(fitted, TriangleTree.empty(), THIN * draft.thin_cost)
    return assigned


@kernel
def fit_all(fitted, tree, thin_cost):
    """Fit all vertices to the points around them, one after another, so that no triangle cuts those of a tree."""
    star = room_for_star(len(fitted.points))
    inside = np.zeros(len(fitted.first), dtype=np.bool_)
    changed = np.zeros(len(fitted.vertices), dtype=np.bool_)
    for v in range(len(fitted.vertices)):
        if fitted.mesh.leaving[v] < 0:
            continue
        here = row(fitted.vertices, v)
        empty(star, here)
        before = add_around(fitted, star, v, -1, thin_cost)
        lowest, position = fit_star(fitted, star, here, thin_cost)
        face = star.edges[0] // 3
        if lowest < before and is_star_free(fitted, tree, star, v, position, (face, face), inside):
            store(fitted, star, v, position, thin_cost)
            mark(fitted, tree, star, v, changed)


@kernel
def is_star_free(fitted, tree, star, u, position, removed, inside):
    """Return whether no triangle of a star with the vertex u at a position cuts another of a tree, or of the star."""
    mesh, vertices, count = fitted.mesh, fitted.vertices, star.sizes[0]
    before, patch, new = row(vertices, u), np.empty(count + 2, dtype=np.int64), np.empty((count, 3), dtype=np.int64)
    vertices[u, 0], vertices[u, 1], vertices[u, 2] = position
    for k in range(count):
        edge = star.edges[k]
        patch[k], new[k, 0], new[k, 1], new[k, 2] = edge // 3, u, mesh.origin[edge], mesh.origin[following(edge)]
    patch[count], patch[count + 1] = removed
    free = is_free(mesh, vertices, tree, inside, patch, new)
    vertices[u, 0], vertices[u, 1], vertices[u, 2] = before
    return free


@kernel(allocates=False)
def mark(fitted, tree, star, v, changed):
    """Mark a vertex and the ring around it as changed, and let a tree follow the triangles between."""
    changed[v] = True
    for k in range(star.sizes[0]):
        edge = star.edges[k]
        changed[fitted.mesh.origin[edge]] = changed[fitted.mesh.origin[following(edge)]] = True
        follow(fitted.mesh, fitted.vertices, tree, edge // 3)


def fit_observed(draft: Draft, assigned: Assignment) -> bool:
    """Move vertices to explain the dense points as the cloud has them, without new cuts; projections are smoothed.

    Returns whether the solver converged.
    """
    covered, faces = np.flatnonzero(assigned.face >= 0), draft.mesh.faces()
    corners, observed = draft.mesh.corners()[assigned.face[covered]], draft.dense.raw[covered]
    noise = noise_between(observed, draft.dense.positions[covered])
    spacing = float(np.sqrt(Mesh(draft.vertices, faces).face_areas().sum() / draft.n_vertices))
    steps, converged = joint_steps(draft.vertices, corners, assigned.weights[covered], observed, noise, spacing)
    moved, min_cosines = draft.vertices + steps, np.minimum(0.2, _cosines(faces, draft.vertices, draft.normals))
    while True:
        turned = faces[_cosines(faces, moved, draft.normals) < min_cosines]
        worse = np.append(turned, draft.mesh.corners()[cutting(draft.mesh, moved)])
        if not len(worse):
            break
        moved[worse] = draft.vertices[worse]
    draft.vertices = moved
    return converged


def _cosines(faces: Ints, vertices: Floats, normals: Floats) -> Floats:
    """Return the cosine between the normal of each triangle and the mean of its corners' normals."""
    a, b, c = (vertices[corner] for corner in faces.T)
    upright, mean = np.cross(b - a, c - a), normals[faces].sum(axis=1)
    length = np.linalg.norm(upright, axis=1) * np.linalg.norm(mean, axis=1)
    cosines: Floats = np.einsum("ij,ij->i", upright, mean) / np.where(length > 0.0, length, 1.0)
    return cosines
