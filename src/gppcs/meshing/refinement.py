"""Put new vertices where the mesh is farthest from the dense points, so that others may go where they matter less."""

import numpy as np

from gppcs.engine.arrays import Flags, Ints
from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment, corners_from
from gppcs.meshing.draft import Draft
from gppcs.meshing.flips import flip
from gppcs.meshing.halfedges import HalfEdges, replace_triangles
from gppcs.spatial.triangles import dot, minus, nearest_in_triangle, row, squared_distance


def refine(draft: Draft, count: int, assigned: Assignment) -> None:
    """Add vertices where the dense points are farthest off their triangles, in at most so many of these."""
    insert(draft, assigned, *farthest_points_of(draft.mesh, assigned, unused_points(draft), count))
    _find_nearest(draft.mesh, draft.vertices, draft.dense.positions, flip(draft, assigned), draft.nearest)


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
    """Split triangles, ascending, each by a dense point; `assigned` follows."""
    n_faces = len(draft.mesh.corners())
    draft.mesh = split(draft.mesh, faces)
    positions = draft.dense.positions if draft.moved else draft.dense.raw
    draft.dense_index = np.concatenate([draft.dense_index, points])
    draft.fixed = np.concatenate([draft.fixed, np.zeros(len(points), dtype=np.bool_)])
    draft.vertices = np.concatenate([draft.vertices, positions[points]])
    draft.normals = np.concatenate([draft.normals, draft.dense.normals[points]])
    beside = np.full(n_faces, -1)
    beside[faces] = n_faces + 2 * np.arange(len(faces))
    _reassign(draft.mesh, draft.vertices, draft.dense.positions, beside, assigned)


@kernel(allocates=False)
def _reassign(mesh, vertices, points, beside, assigned):
    """Find the nearest third of each split triangle's points; `beside`, (F,), is the second of the three, or -1."""
    for i in range(len(points)):
        f = assigned.face[i]
        if f < 0 or beside[f] < 0:
            continue
        assigned.squared[i] = np.inf
        for third in (f, beside[f], beside[f] + 1):
            a, b, c = corners_from(mesh, vertices, third, row(points, i))
            s, t = nearest_in_triangle(a, b, c)
            squared = squared_distance(a, b, c, s, t)
            if squared < assigned.squared[i]:
                assigned.face[i], assigned.squared[i] = third, squared
                assigned.weights[i, 0], assigned.weights[i, 1] = s, t


def split(mesh: HalfEdges, faces: Ints) -> HalfEdges:
    """Return a mesh in which some triangles are split in three by a new vertex each; two of the three come last."""
    lengths = 6 * len(faces), 6 * len(faces), len(faces)
    larger = HalfEdges(*(np.append(part, np.full(n, -1)) for part, n in zip(mesh, lengths, strict=True)))
    _split_all(larger, faces, len(mesh.corners()), len(mesh.leaving))
    return larger


@kernel
def _split_all(mesh, faces, n_faces, first):
    """Split triangles, (m,), of a mesh with room for others from `n_faces` on, and for vertices from `first` on."""
    for j in range(len(faces)):
        f, new = faces[j], first + j
        a, b, c = mesh.origin[3 * f], mesh.origin[3 * f + 1], mesh.origin[3 * f + 2]
        patch = np.array([f, n_faces + 2 * j, n_faces + 2 * j + 1])
        replace_triangles(mesh, patch, np.array([[a, b, new], [b, c, new], [c, a, new]]))
