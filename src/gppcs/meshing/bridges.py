"""Join pieces of a mesh where their borders run side by side."""

from __future__ import annotations

import numpy as np

from gppcs.meshing.coverage import Cover, are_covered
from gppcs.meshing.filling import fillings
from gppcs.meshing.halfedges import Floats, HalfEdges, Ints, pieces_of


def bridged(faces: Ints, triangles: Ints, points: Floats, normals: Floats, reaches: Floats, cover: Cover) -> Ints:
    """Join pieces by bridges of two triangles, each between a border edge of one piece and one of another.

    The shortest come first. A bridge is where a triangle of a fan, all of which are covered, has an edge on the border
    of one piece and a corner on that of another, so that it cannot be taken alone. Bridges are covered, too, cut no
    triangle of the mesh, and close no ring of pieces: so they make no holes and handles.
    """
    while True:
        piece = np.full(len(points), -1)
        piece[faces] = pieces_of(faces, len(points))[:, None]
        loops = _quadrilaterals(HalfEdges.of(faces, len(points)), piece, triangles, points)
        new, bridge = fillings(faces, points, normals, list(loops), careful=True)
        whole = np.bincount(bridge[are_covered(cover, new, points, reaches)], minlength=len(loops)) == 2
        taken = np.zeros(len(loops), dtype=np.bool_)
        used = np.zeros(len(points), dtype=np.bool_)
        for number in np.flatnonzero(whole):
            a, b = piece[loops[number, [0, 2]]]
            if a != b and not used[loops[number]].any():
                taken[number] = used[loops[number]] = True
                piece[piece == b] = a
        if not taken.any():
            return faces
        faces = np.concatenate([faces, new[taken[bridge]]])


def _quadrilaterals(mesh: HalfEdges, piece: Ints, triangles: Ints, points: Floats) -> Ints:
    """Return places of bridges, (b, 4), the shortest first: an edge on the border of a piece, and one on another's."""
    n = len(points)
    border = np.flatnonzero(mesh.opposite < 0)
    begin, end = mesh.origin[border], mesh.origin[np.where(border % 3 == 2, border - 2, border + 1)]
    before, after = np.full(n, -1), np.full(n, -1)
    before[end], after[begin] = begin, end
    p, q, r = np.concatenate([np.roll(triangles, -k, axis=1) for k in range(3)]).T
    there = (after[q] == p) & (before[r] >= 0) & (piece[p] != piece[r])
    p, q, r = p[there], q[there], r[there]
    loops = np.unique(
        np.concatenate([np.column_stack([p, q, r, before[r]]), np.column_stack([p, q, after[r], r])]), axis=0
    )
    corners = points[loops]
    lengths = np.linalg.norm(corners[:, [1, 3]] - corners[:, [2, 0]], axis=2).sum(axis=1)
    sorted_loops: Ints = loops[np.argsort(lengths, kind="stable")]
    return sorted_loops
