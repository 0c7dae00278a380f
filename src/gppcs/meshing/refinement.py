"""Put new vertices where the mesh is farthest from the dense points, so that others may go where they matter less."""

from __future__ import annotations

import numpy as np

from gppcs.meshing.assignment import Assignment
from gppcs.meshing.halfedges import Flags, HalfEdges, Ints

INSIDE = 0.05  # least barycentric coordinate of a new vertex in its triangle


def worst_places(mesh: HalfEdges, assigned: Assignment, usable: Flags, count: int) -> tuple[Ints, Ints]:
    """Return the triangles with the largest sums of squared distances, and the farthest dense point of each."""
    there = assigned.face >= 0
    size = len(mesh.origin) // 3
    sums = np.bincount(assigned.face[there], assigned.squared[there], minlength=size)
    s, t = assigned.weights.T
    inner = np.flatnonzero(there & usable & (np.minimum(np.minimum(s, t), 1.0 - s - t) > INSIDE))
    farthest = np.full(size, -1)
    inner = inner[np.argsort(assigned.squared[inner], kind="stable")]
    farthest[assigned.face[inner]] = inner  # of several points of a triangle, the last one stays
    faces = np.flatnonzero(farthest >= 0)
    faces = np.sort(faces[np.argsort(-sums[faces], kind="stable")][:count])
    return faces, farthest[faces]


def split(mesh: HalfEdges, faces: Ints, first: int) -> HalfEdges:
    """Return a mesh in which some triangles are split in three by a new vertex each."""
    corners = mesh.origin.reshape(-1, 3)
    a, b, c = corners[faces].T
    new = first + np.arange(len(faces))
    left = np.delete(corners, faces, axis=0)
    thirds = [np.column_stack(triangle) for triangle in ((a, b, new), (b, c, new), (c, a, new))]
    return HalfEdges.of(np.concatenate([left[left[:, 0] >= 0], *thirds]), first + len(faces))
