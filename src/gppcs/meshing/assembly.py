"""Put triangles together so that they stay an oriented manifold, and fill small gaps between them."""

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.meshing.coverage import Cover, are_covered
from gppcs.meshing.filling import boundary_loops, fillings, holes_filled
from gppcs.meshing.halfedges import MAX_VALENCE, EdgeTable, HalfEdges, add_edge, find_edge, pieces_of, without_bow_ties
from gppcs.meshing.handles import without_small_handles

LARGEST_GAP = 300  # corners of a gap that is filled at the end, such as a slit along the rim of two sheets


def assembled(
    triangles: Ints,
    votes: Ints,
    radii: Floats,
    points: Floats,
    normals: Floats,
    cover_radii: Floats,
    cover: Cover,
    bridges: bool = False,
) -> HalfEdges:
    """Choose triangles of fans that are an oriented manifold, by votes and radii, and fill gaps that points cover."""
    n, surface = len(points), (points, normals, cover_radii, cover)
    covered = are_covered(cover, triangles, points, cover_radii)
    triangles, votes, radii = triangles[covered], votes[covered], radii[covered]
    order = np.argsort(radii, kind="stable")
    order = np.concatenate([order[votes[order] == count] for count in (3, 2, 1)])
    agreed = votes[order] > 1
    faces = triangles[order[agreed]]
    faces = faces[are_taken(faces, n)]
    faces = faces[np.argsort(faces[:, 0], kind="stable")]  # near ones side by side
    mesh = without_bow_ties(HalfEdges.from_faces(faces, n))
    n_faces, more = len(mesh.corners()), np.concatenate([gap_fillings(mesh, *surface, 8), triangles[order[~agreed]]])
    taken = are_taken(np.concatenate([mesh.faces(), more]), n)
    mesh = without_bow_ties(mesh.changed(taken[:n_faces], more[taken[n_faces:]]))
    if bridges:
        mesh = bridged(mesh, triangles, *surface)
    mesh = mesh.changed(new=gap_fillings(mesh, *surface, LARGEST_GAP))
    cut = without_small_handles(mesh, *surface)
    if cut is not mesh:
        mesh = cut.changed(new=gap_fillings(cut, *surface, LARGEST_GAP))
    corners = points[mesh.faces()]
    if not len(corners):
        return mesh
    edge = np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1))
    return holes_filled(mesh, points, normals, 4.0 * edge, 6)  # pinholes, which random samples have


def gap_fillings(
    mesh: HalfEdges, points: Floats, normals: Floats, cover_radii: Floats, cover: Cover, max_corners: int
) -> Ints:
    """Return triangles that fill covered gaps of few corners in a mesh; the back of a small piece is no gap."""
    loops = [loop for loop in boundary_loops(mesh) if 3 <= len(loop) <= max_corners]
    new, gap = fillings(mesh, points, normals, loops)
    a, b, c = (points[corner] for corner in new.T)
    facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), normals[new].sum(axis=1))
    backward = np.bincount(gap, facing, minlength=len(loops)) < 0.0
    spoilt = np.isin(gap, gap[~are_covered(cover, new, points, cover_radii)])
    return new[~(spoilt | backward[gap])]


def bridged(
    mesh: HalfEdges, triangles: Ints, points: Floats, normals: Floats, cover_radii: Floats, cover: Cover
) -> HalfEdges:
    """Join pieces by pairs of covered triangles that cut nothing and close no ring of pieces, the shortest first."""
    while True:
        faces, piece = mesh.faces(), np.full(len(points), -1)
        piece[faces] = pieces_of(faces, len(points))[:, None]
        loops = _quadrilaterals(mesh, piece, triangles, points)
        new, bridge = fillings(mesh, points, normals, list(loops), careful=True)
        complete = np.bincount(bridge[are_covered(cover, new, points, cover_radii)], minlength=len(loops)) == 2
        taken, used = np.zeros(len(loops), dtype=np.bool_), np.zeros(len(points), dtype=np.bool_)
        for number in np.flatnonzero(complete):
            a, b = piece[loops[number, [0, 2]]]
            if a != b and not used[loops[number]].any():
                taken[number] = used[loops[number]] = True
                piece[piece == b] = a
        if not taken.any():
            return mesh
        mesh = mesh.changed(new=new[taken[bridge]])


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


def are_taken(triangles: Ints, n: int) -> Flags:
    """Take triangles one by one while all stay an oriented manifold, but for bow-ties, which later ones may join.

    Returns which are taken.
    """
    triangles = np.ascontiguousarray(triangles)
    table, take = EdgeTable.empty(n, 3 * len(triangles)), np.zeros(len(triangles), dtype=np.bool_)
    _take(triangles, table, np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.bool_), take)
    return take


@kernel(allocates=False)
def _take(triangles, table, valences, closed, take):
    """Mark in `take`, (t,), what is taken; fill a table of edges, `valences`, (n,), and `closed` vertices, (n,)."""
    for t in range(len(triangles)):
        fits = True
        for k in range(3):
            p, a, b = triangles[t, k], triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
            if closed[p] or valences[p] == MAX_VALENCE or p == a or find_edge(table, p, a) >= 0:
                fits = False
                break
            reached, steps = _walk(triangles, table, p, b, a)
            if reached and (steps < valences[p] or steps < 2):  # it closes only a part of the triangles at p
                fits = False
                break
        if not fits:
            continue
        take[t] = True
        for k in range(3):
            p, a, b = triangles[t, k], triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
            add_edge(table, p, a, 3 * t + k)
            valences[p] += 1
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


def without_scraps(mesh: HalfEdges, min_faces: int) -> HalfEdges:
    """Drop connected pieces of few triangles, unless none is larger, from a mesh of which none was removed."""
    faces, n = mesh.faces(), len(mesh.leaving)
    pieces = pieces_of(faces, n)
    sizes = np.bincount(pieces, minlength=1)
    large = sizes[pieces] >= min(min_faces, sizes.max())
    return mesh if large.all() else mesh.changed(large)


def largest_pieces(mesh: HalfEdges, count: int, counts_faces: bool) -> HalfEdges:
    """Keep the largest pieces whose smallest meshes (Euler's formula) have at most so many vertices or triangles.

    No triangle of the mesh was removed.
    """
    faces, n = mesh.faces(), len(mesh.leaving)
    pieces = pieces_of(faces, n)
    sizes = np.bincount(pieces)
    if np.count_nonzero(sizes) == 1:
        return mesh
    of_vertex = np.full(n, -1)
    of_vertex[faces] = pieces[:, None]
    boundary_edges = np.bincount(of_vertex[mesh.origin[mesh.boundary_edges()]], minlength=len(sizes))
    edges = (3 * sizes + boundary_edges) // 2
    euler = np.bincount(of_vertex[of_vertex >= 0], minlength=len(sizes)) - edges + sizes
    loops = np.bincount([of_vertex[loop[0]] for loop in boundary_loops(mesh)], minlength=len(sizes))
    handles = (2 - loops - euler) // 2
    minimum = np.where(loops, 3 * loops, 4) + 3 * handles
    if counts_faces:  # by Euler's formula, as each boundary loop has as many edges as vertices
        minimum = 2 * (minimum - euler) - 3 * loops
    order = np.argsort(-sizes, kind="stable")
    kept = np.zeros(len(sizes), dtype=np.bool_)
    kept[order] = np.cumsum(minimum[order]) <= count
    kept[order[0]] = True
    return mesh if kept.all() else mesh.changed(kept[pieces])
