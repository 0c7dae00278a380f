"""Put triangles together so that they stay an oriented manifold, and fill small gaps between them."""

from __future__ import annotations

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.meshing.bridges import bridged
from gppcs.meshing.coverage import Cover, are_covered
from gppcs.meshing.filling import border_loops, fillings, holes_filled
from gppcs.meshing.halfedges import (
    MOST_AROUND,
    EdgeTable,
    Floats,
    HalfEdges,
    Ints,
    add_edge,
    find_edge,
    pieces_of,
    without_bow_ties,
)
from gppcs.meshing.handles import without_small_handles

SMALL_GAP = 8  # corners of a gap that is filled before triangles of a single fan are tried
PINHOLE, PINHOLE_SIZE = (
    6,
    4.0,
)  # corners and size, in usual edges, of a gap that is filled though no points cover it, as random samples have
LARGEST_GAP = 40  # corners of a gap that is filled at the end
PIECE_TRIANGLES = 12  # triangles of a piece; smaller ones are scraps


def assembled(
    triangles: Ints,
    votes: Ints,
    radii: Floats,
    points: Floats,
    normals: Floats,
    reaches: Floats,
    cover: Cover,
    bridges: bool = False,
) -> Ints:
    """Choose triangles of the fans that together are an oriented manifold, and fill gaps that dense points cover.

    Triangles on which two or three fans agree come first, those with small circumcircles before others. Small gaps
    are filled; then triangles of a single fan are added where there is room; then larger gaps are filled, and pinholes.
    With `bridges`, pieces whose borders run side by side are joined before larger gaps are filled.
    """
    kept = are_covered(cover, triangles, points, reaches)
    triangles, votes, radii = triangles[kept], votes[kept], radii[kept]
    order = np.lexsort((radii, -votes))
    agreed = votes[order] > 1
    faces = taken(triangles[order[agreed]], len(points))
    faces = without_bow_ties(faces[np.argsort(faces[:, 0], kind="stable")], len(points))  # near ones side by side
    faces = gaps_filled(faces, points, normals, reaches, cover, SMALL_GAP)
    faces = taken(np.concatenate([faces, triangles[order[~agreed]]]), len(points))
    faces = without_bow_ties(faces, len(points))
    if bridges:
        faces = bridged(faces, triangles, points, normals, reaches, cover)
    faces = gaps_filled(faces, points, normals, reaches, cover, LARGEST_GAP)
    faces = without_bow_ties(faces, len(points))
    cut = without_small_handles(faces, points, normals, reaches, cover)
    if len(cut) < len(faces):
        faces = without_bow_ties(gaps_filled(cut, points, normals, reaches, cover, LARGEST_GAP), len(points))
    corners = points[faces]
    usual = np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1))
    return without_bow_ties(holes_filled(faces, points, normals, PINHOLE_SIZE * usual, PINHOLE), len(points))


def gaps_filled(faces: Ints, points: Floats, normals: Floats, reaches: Floats, cover: Cover, most: int) -> Ints:
    """Fill the gaps that have few corners and that the dense points cover, but not the back of a small piece."""
    loops = [loop for loop in border_loops(HalfEdges.of(faces, len(points))) if 3 <= len(loop) <= most]
    new, gap = fillings(faces, points, normals, loops)
    a, b, c = (points[corner] for corner in new.T)
    facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), normals[new].sum(axis=1))
    backward = np.bincount(gap, facing, minlength=len(loops)) < 0.0
    spoilt = np.isin(gap, gap[~are_covered(cover, new, points, reaches)])
    return np.concatenate([faces, new[~(spoilt | backward[gap])]])


def taken(triangles: Ints, n: int) -> Ints:
    """Take triangles one after another, each if all of them stay an oriented manifold.

    Bow-ties, vertices at which several fans meet, are allowed here: later triangles may join the fans.
    """
    triangles = np.ascontiguousarray(triangles)
    table, take = EdgeTable.of(n, 3 * len(triangles)), np.zeros(len(triangles), dtype=np.bool_)
    _take(triangles, table, np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.bool_), take)
    return triangles[take]


@kernel(allocates=False)
def _take(triangles, table, degrees, closed, take):
    """Mark in `take`, (t,), the triangles that are taken.

    The table, empty at first, gets their edges: 3 t + k leads from corner k of triangle t to the next one. `degrees`
    and `closed`, (n,), are the number of triangles at each vertex, and whether they close around it.
    """
    for t in range(len(triangles)):
        fits = True
        for k in range(3):
            p, a, b = triangles[t, k], triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
            if closed[p] or degrees[p] == MOST_AROUND or p == a or find_edge(table, p, a) >= 0:
                fits = False
                break
            reached, steps = _walk(triangles, table, p, b, a)
            if reached and (steps < degrees[p] or steps < 2):  # it closes only a part of the triangles at p
                fits = False
                break
        if not fits:
            continue
        take[t] = True
        for k in range(3):
            p, a, b = triangles[t, k], triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
            add_edge(table, p, a, 3 * t + k)
            degrees[p] += 1
            closed[p] = _walk(triangles, table, p, b, a)[0]


@kernel(allocates=False)
def _walk(triangles, table, p, start, end):
    """Walk around a vertex p from the edge to `start`; return whether `end` is reached, and after how many steps."""
    here, steps = start, 0
    while here != end:
        edge = find_edge(table, p, here)
        if edge < 0:
            return False, steps
        here = triangles[edge // 3, (edge + 2) % 3]
        steps += 1
    return True, steps


def without_scraps(faces: Ints, n: int, fewest: int = PIECE_TRIANGLES) -> Ints:
    """Leave out connected pieces of few triangles, unless none is larger."""
    pieces = pieces_of(faces, n)
    sizes = np.bincount(pieces, minlength=1)
    return faces[sizes[pieces] >= min(fewest, sizes.max())]


def largest_pieces(faces: Ints, n: int, count: int, counts_faces: bool) -> Ints:
    """Leave out the smallest connected pieces, so that a mesh of that many vertices or triangles can have the others.

    Each border needs three vertices, a closed piece four; each handle needs three more.
    """
    pieces = pieces_of(faces, n)
    sizes = np.bincount(pieces)
    if np.count_nonzero(sizes) == 1:
        return faces
    mesh = HalfEdges.of(faces, n)
    of_vertex = np.full(n, -1)
    of_vertex[faces] = pieces[:, None]
    open_edges = np.bincount(np.repeat(pieces, 3)[mesh.opposite < 0], minlength=len(sizes))
    edges = (3 * sizes + open_edges) // 2
    euler = np.bincount(of_vertex[of_vertex >= 0], minlength=len(sizes)) - edges + sizes
    borders = np.bincount([of_vertex[loop[0]] for loop in border_loops(mesh)], minlength=len(sizes))
    handles = (2 - borders - euler) // 2
    fewest = np.where(borders, 3 * borders, 4) + 3 * handles
    if counts_faces:  # by Euler's formula, as each border has as many edges as vertices
        fewest = 2 * (fewest - euler) - 3 * borders
    order = np.argsort(-sizes, kind="stable")
    kept = np.zeros(len(sizes), dtype=np.bool_)
    kept[order] = np.cumsum(fewest[order]) <= count
    kept[order[0]] = True
    return faces[kept[pieces]]
