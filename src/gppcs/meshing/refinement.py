"""Put new vertices where the mesh is farthest from the dense points, so that others may go where they matter less."""

from __future__ import annotations

import numpy as np

from gppcs.engine.arrays import Flags, Ints
from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.draft import Draft
from gppcs.meshing.flips import flip
from gppcs.meshing.halfedges import HalfEdges
from gppcs.spatial.triangles import dot, minus, row


def refine(draft: Draft, count: int, assigned: Assignment) -> None:
    """Add vertices where the dense points are farthest off their triangles, in at most so many of these."""
    insert(draft, assigned, *farthest_points_of(draft.mesh, assigned, unused_points(draft), count))
    _find_nearest(draft.mesh, draft.vertices, draft.dense.positions, flip(draft), draft.nearest)


@kernel(allocates=False)
def _find_nearest(mesh, vertices, points, assigned, nearest):
    """Fill the nearest corner of the triangle of each point, (n,)."""
    for i in range(len(points)):
        lowest, first = np.inf, 3 * assigned.face[i]
        for corner in mesh.origin[first : first + 3] if first >= 0 else mesh.origin[:0]:
            step = minus(row(vertices, corner), row(points, i))
            if dot(step, step) < lowest:
                nearest[i], lowest = corner, dot(step, step)


def farthest_points_of(
    mesh: HalfEdges, assigned: Assignment, usable: Flags, count: int, min_weight: float = 0.05
) -> tuple[Ints, Ints]:
    """Return the triangles with the largest sums of squared distances, and the farthest inner point of each."""
    sums, farthest = np.zeros(len(mesh.corners())), np.full(len(mesh.corners()), -1)
    _find_farthest(assigned, usable, min_weight, sums, farthest)
    faces = np.flatnonzero(farthest >= 0)
    faces = np.sort(faces[np.argsort(-sums[faces], kind="stable")][:count])
    return faces, farthest[faces]


@kernel(allocates=False)
def _find_farthest(assigned, usable, min_weight, sums, farthest):
    """Fill what `farthest_points_of` needs of each triangle, (F,): the sum, and the point, -1 if there is none."""
    for i in range(len(usable)):
        f, (s, t) = assigned.face[i], assigned.weights[i]
        if f < 0:
            continue
        sums[f] += assigned.squared[i]
        is_farther = farthest[f] < 0 or assigned.squared[i] >= assigned.squared[farthest[f]]
        if is_farther and usable[i] and min(s, t, 1.0 - s - t) > min_weight:
            farthest[f] = i


def unused_points(draft: Draft) -> Flags:
    """Return which dense points are not vertices of the mesh, (n,)."""
    unused = np.ones(len(draft.nearest), dtype=np.bool_)
    unused[draft.dense_index[draft.mesh.leaving >= 0]] = False
    return unused


def insert(draft: Draft, assigned: Assignment, faces: Ints, points: Ints) -> None:
    """Split triangles, ascending, each by a dense point."""
    first = len(draft.dense_index)
    new = np.full(len(draft.mesh.corners()), -1)
    new[faces] = first + np.arange(len(faces))
    inside = (assigned.face >= 0) & (new[assigned.face] >= 0)
    draft.nearest[inside] = new[assigned.face[inside]]
    draft.mesh = split(draft.mesh, faces, first)
    positions = draft.dense.positions if draft.moved else draft.dense.raw
    draft.dense_index = np.concatenate([draft.dense_index, points])
    draft.fixed = np.concatenate([draft.fixed, np.zeros(len(points), dtype=np.bool_)])
    draft.vertices = np.concatenate([draft.vertices, positions[points]])
    draft.normals = np.concatenate([draft.normals, draft.dense.normals[points]])


def split(mesh: HalfEdges, faces: Ints, first: int) -> HalfEdges:
    """Return a mesh in which some triangles are split in three by a new vertex each."""
    a, b, c = mesh.corners()[faces].T
    new = first + np.arange(len(faces))
    left = np.delete(mesh.corners(), faces, axis=0)
    thirds = [np.column_stack(triangle) for triangle in ((a, b, new), (b, c, new), (c, a, new))]
    return HalfEdges.from_faces(np.concatenate([left[left[:, 0] >= 0], *thirds]), first + len(faces))
