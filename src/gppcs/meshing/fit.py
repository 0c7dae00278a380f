"""Move vertices so that the mesh fits the dense points (Hoppe et al. 1993, by steps of Gauss and Newton)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import bsr_array
from scipy.sparse.linalg import cg

from gppcs.clouds.mesh import Mesh
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.blas import one_blas_thread
from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment, corners_from
from gppcs.meshing.cuts import cutting
from gppcs.meshing.draft import Draft
from gppcs.meshing.halfedges import HalfEdges
from gppcs.meshing.stars import SLIDE
from gppcs.spatial.triangles import area_vector, dot, minus, point_in, qualities, row, unit
from gppcs.surface.inducing import joint_steps, noise_between

PULL = 0.001  # weight with which a vertex is held where it is, in mean weights of a vertex
PULL_ALONE = 0.5  # the same on boundaries, beyond which no points hold a vertex, and without points near a vertex
NEAR = 0.4  # minimum weight of the vertex in a point that is near it


def fit(draft: Draft, assigned: Assignment) -> Assignment:
    """Move the vertices so that the mesh fits the dense points better, and return the triangles of these."""
    before = draft.vertices
    draft.vertices = stepped(draft.mesh, before, draft.dense.positions, assigned)
    undo_turns(draft.mesh.faces(), before, draft.normals, draft.vertices)
    after = draft.assigned()
    if after.mean_square() <= assigned.mean_square():
        return after
    draft.vertices = before
    return assigned


def fit_observed(draft: Draft, assigned: Assignment) -> None:
    """Move vertices to explain the dense points as the cloud has them, without new cuts; projections are smoothed."""
    covered, faces = np.flatnonzero(assigned.face >= 0), draft.mesh.faces()
    corners, observed = draft.mesh.corners()[assigned.face[covered]], draft.dense.raw[covered]
    noise = noise_between(observed, draft.dense.positions[covered])
    spacing = float(np.sqrt(Mesh(draft.vertices, faces).face_areas().sum() / draft.n_vertices))
    steps = joint_steps(draft.vertices, corners, assigned.weights[covered], observed, noise, spacing)
    moved = draft.vertices + steps
    while True:
        undo_turns(faces, draft.vertices, draft.normals, moved)
        if not len(cut := cutting(draft.mesh, moved)):
            break
        corners = draft.mesh.corners()[cut]
        moved[corners] = draft.vertices[corners]
    draft.vertices = moved


@one_blas_thread()
def stepped(mesh: HalfEdges, vertices: Floats, points: Floats, assigned: Assignment) -> Floats:
    """Return vertices after a Gauss-Newton step on squared distances; feet slide along triangles nearly free."""
    n = len(vertices)
    diagonal, beside, right = np.zeros((n, 3, 3)), np.zeros((len(mesh.origin), 3, 3)), np.zeros((n, 3))
    totals, largest = np.zeros(n), np.zeros(n)
    _add_points(mesh, vertices, points, assigned, diagonal, beside, right, totals, largest)
    pull = np.full(n, PULL)
    pull[mesh.origin[mesh.boundary_edges()]] = PULL_ALONE
    pull[largest < NEAR] = PULL_ALONE
    pull *= totals.sum() / np.count_nonzero(mesh.leaving >= 0)
    diagonal += pull[:, None, None] * np.eye(3)
    # The matrix of the normal equations has a block of 3 x 3 for each vertex, and one for both ways of each half-edge.
    there = np.flatnonzero(mesh.origin >= 0)
    begins, ends, vertex = mesh.origin[there], mesh.targets()[there], np.arange(n)
    blocks = np.concatenate([diagonal, beside[there], beside[there]])
    lines, columns = np.concatenate([[vertex, vertex], [begins, ends], [ends, begins]], axis=1)
    order = np.argsort(lines, kind="stable")
    limits = np.searchsorted(lines[order], np.arange(n + 1))
    matrix = bsr_array((blocks[order], columns[order], limits), shape=(3 * n, 3 * n))
    preconditioner = bsr_array((np.linalg.inv(diagonal), vertex, np.arange(n + 1)), shape=(3 * n, 3 * n))
    steps, _ = cg(matrix, right.ravel(), rtol=1e-6, maxiter=100, M=preconditioner)
    moved: Floats = vertices + steps.reshape(-1, 3)
    return moved


@kernel(allocates=False)
def _add_points(mesh, vertices, points, assigned, diagonal, beside, right, totals, largest):
    """Add to sums the residual of each point along its triangle's normal, or its offset if the foot is on an edge."""
    for i in range(len(points)):
        f = assigned.face[i]
        if f < 0:
            continue
        a, b, c = corners_from(mesh, vertices, f, row(points, i))
        s, t = assigned.weights[i, 0], assigned.weights[i, 1]
        weights = 1.0 - s - t, s, t
        off = minus((0.0, 0.0, 0.0), point_in(a, b, c, s, t))
        outside = min(weights[0], s, t) < 1e-9 and dot(off, off) > 1e-24  # the foot is on an edge, the point off it
        across = unit(off if outside else area_vector(a, b, c))
        along = (1.0 - SLIDE) * dot(off, across)
        for k in range(3):
            h = 3 * f + k
            v, weight = mesh.origin[h], weights[k]
            _add_block(diagonal[v], weight * weight, across)
            _add_block(beside[h], weight * weights[(k + 1) % 3], across)
            for axis in range(3):
                right[v, axis] += weight * (along * across[axis] + SLIDE * off[axis])
            totals[v] += weight * weight
            largest[v] = max(largest[v], weight)


@kernel(allocates=False)
def _add_block(block, weight, across):
    """Add the part of a point in the block of two vertices, (3, 3)."""
    for i in range(3):
        for j in range(3):
            block[i, j] += (1.0 - SLIDE) * weight * across[i] * across[j]
        block[i, i] += SLIDE * weight


def undo_turns(faces: Ints, vertices: Floats, normals: Floats, moved: Floats) -> None:
    """Halve steps in `moved`, (V, 3), that make triangles thin; also undo those that turn them against the normals."""
    min_cosines = np.minimum(0.2, _cosines(faces, vertices, normals))
    min_qualities = np.minimum(0.2, qualities(vertices, faces))
    for factor in (0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0):
        turned = _cosines(faces, moved, normals) < min_cosines
        if factor > 0.0:
            turned |= qualities(moved, faces) < min_qualities
        worse = np.unique(faces[turned])
        if not len(worse):  # nor are any in a later round
            return
        moved[worse] = vertices[worse] + factor * (moved[worse] - vertices[worse])


def _cosines(faces: Ints, vertices: Floats, normals: Floats) -> Floats:
    """Return the cosine between the normal of each triangle and the mean of its corners' normals."""
    a, b, c = (vertices[corner] for corner in faces.T)
    upright, mean = np.cross(b - a, c - a), normals[faces].sum(axis=1)
    length = np.linalg.norm(upright, axis=1) * np.linalg.norm(mean, axis=1)
    cosines: Floats = np.einsum("ij,ij->i", upright, mean) / np.where(length > 0.0, length, 1.0)
    return cosines
