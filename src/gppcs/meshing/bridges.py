"""Join pieces of a mesh where their boundary loops run side by side."""

from __future__ import annotations

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.meshing.coverage import Cover, are_covered
from gppcs.meshing.filling import fillings
from gppcs.meshing.halfedges import HalfEdges, pieces_of


def bridged(
    mesh: HalfEdges, triangles: Ints, points: Floats, normals: Floats, reaches: Floats, cover: Cover
) -> HalfEdges:
    """Join pieces by pairs of covered triangles that cut nothing and close no ring of pieces, the shortest first."""
    while True:
        faces, piece = mesh.faces(), np.full(len(points), -1)
        piece[faces] = pieces_of(faces, len(points))[:, None]
        loops = _quadrilaterals(mesh, piece, triangles, points)
        new, bridge = fillings(mesh, points, normals, list(loops), careful=True)
        complete = np.bincount(bridge[are_covered(cover, new, points, reaches)], minlength=len(loops)) == 2
        taken, used = np.zeros(len(loops), dtype=np.bool_), np.zeros(len(points), dtype=np.bool_)
        for number in np.flatnonzero(complete):
            a, b = piece[loops[number, [0, 2]]]
            if a != b and not used[loops[number]].any():
                taken[number] = used[loops[number]] = True
                piece[piece == b] = a
        if not taken.any():
            return mesh
        mesh = HalfEdges.from_faces(np.concatenate([faces, new[taken[bridge]]]), len(points))


def _quadrilaterals(mesh: HalfEdges, piece: Ints, triangles: Ints, points: Floats) -> Ints:
    """Return the corners of bridges, (b, 4), the shortest first: a boundary edge of a piece, and one of another."""
    boundary = mesh.boundary_edges()
    begin, end = mesh.origin[boundary], mesh.targets()[boundary]
    before, after = np.full((2, len(points)), -1)
    before[end], after[begin] = begin, end
    p, q, r = np.concatenate([np.roll(triangles, -k, axis=1) for k in range(3)]).T
    beside = (after[q] == p) & (before[r] >= 0) & (piece[p] != piece[r])
    p, q, r = p[beside], q[beside], r[beside]
    loops = np.unique(
        np.concatenate([np.column_stack([p, q, r, before[r]]), np.column_stack([p, q, after[r], r])]), axis=0
    )
    corners = points[loops]
    lengths = np.linalg.norm(corners[:, [1, 3]] - corners[:, [2, 0]], axis=2).sum(axis=1)
    sorted_loops: Ints = loops[np.argsort(lengths, kind="stable")]
    return sorted_loops
