"""Join the surroundings of triangles that cut others anew, so that they no longer do."""

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.collapse import ends
from gppcs.meshing.cuts import TriangleTree, cutting, follow, is_cut
from gppcs.meshing.draft import Draft
from gppcs.meshing.filling import boundary_loops, fill, fillings, with_fillings
from gppcs.meshing.halfedges import (
    HalfEdges,
    add_to_patch,
    around,
    following,
    neighbours,
    pieces_of,
    position_of,
    replace_triangles,
    room_for_ring,
    without_bow_ties,
)
from gppcs.meshing.refinement import farthest_points_of, insert, split, unused_points
from gppcs.spatial.triangles import dot, minus, row

# Largest holes that are closed, in distances of a dense point's neighbour of rank `RANK` (about five spacings), and,
# added to these, in standard deviations of the noise.
PINHOLE, PINHOLE_NOISE = 3.6, 4.0


def mend_draft(draft: Draft, assigned: Assignment, counts_faces: bool, tries: int = 4, relaxations: int = 12) -> int:
    """Close pinholes, mend cuts of a draft, or cut them out, and add vertices for removed ones; return the open holes.

    New vertices go where the points are farthest from the triangles to which they are assigned, which follow.
    """
    n_vertices, n_faces, holes = draft.n_vertices, len(draft.mesh.faces()), 0
    for last in (*[False] * (tries - 1), True):
        corners, vertices = draft.mesh.corners().copy(), draft.vertices.copy()
        closed = close_pinholes(draft)
        holes = max(0, holes - closed)  # some of these were cut out before
        if cuts := len(_mended(draft, relaxations if draft.moved else 0)):
            draft.mesh, opened = cut_out(draft.mesh, draft.vertices, draft.normals)
            holes += opened
        missing = (n_faces - len(draft.mesh.faces())) // 2 if counts_faces else n_vertices - draft.n_vertices
        if missing <= 0 or last or draft.fixed.any():
            break
        is_stale = closed or cuts or not np.array_equal(draft.vertices, vertices)  # cut out, or relaxed
        assigned = draft.assigned() if is_stale else draft.reassigned(assigned, corners)
        _add(draft, assigned, missing)
    return holes


def close_pinholes(draft: Draft) -> int:
    """Close holes that the points are too sparse or too noisy to show, even if that cuts; return how many."""
    faces, piece = draft.mesh.faces(), np.empty(len(draft.vertices), dtype=np.int64)
    pieces = pieces_of(faces, len(piece))
    piece[faces], sizes = pieces[:, None], np.bincount(pieces)
    radii, noise = draft.dense.cover.radii[draft.dense_index], draft.dense.noise
    loops = [
        loop
        for loop in boundary_loops(draft.mesh)
        if sizes[piece[loop[0]]] > 3 * len(loop)  # otherwise it may be the border of a small piece
        and np.linalg.norm(np.ptp(draft.vertices[loop], axis=0))
        <= PINHOLE * np.median(radii[loop]) + PINHOLE_NOISE * noise
    ]
    new, number = fillings(draft.mesh, draft.vertices, draft.normals, loops)
    if len(new):
        draft.mesh = draft.mesh.changed(new=new)
    return len(np.unique(number))


def _mended(draft: Draft, relaxations: int) -> Ints:
    """Mend cuts, and relax what still cuts; return the triangles that no round has helped, whose corners go back."""
    before = draft.vertices.copy()
    for last in (*[False] * relaxations, True):
        tree = TriangleTree.from_mesh(draft.mesh, draft.vertices)
        into, cut = mend(draft.mesh, draft.vertices, draft.normals, draft.fixed, tree)
        draft.merge(into)
        if not len(cut) or last:
            break
        relax(draft.mesh, draft.vertices, np.unique(draft.mesh.corners()[cut]))
    corners = draft.mesh.corners()[cut]
    draft.vertices[corners] = before[corners]
    return cut


def _add(draft: Draft, assigned: Assignment, count: int) -> None:
    """Add vertices where the dense points are farthest off, and where the new triangles cut none."""
    n = len(draft.dense_index)
    faces, points = farthest_points_of(draft.mesh, assigned, unused_points(draft), 4 * count)
    positions = draft.dense.positions if draft.moved else draft.dense.raw
    trial = split(draft.mesh, faces)
    cut = cutting(trial, np.concatenate([draft.vertices, positions[points]]))
    spoilt = np.isin(n + np.arange(len(points)), trial.corners()[cut])
    covered = assigned.face >= 0
    sums = np.bincount(assigned.face[covered], assigned.squared[covered], minlength=len(draft.mesh.corners()))
    worst_first = np.argsort(-sums[faces], kind="stable")
    best = np.sort(worst_first[~spoilt[worst_first]][:count])
    insert(draft, assigned, faces[best], points[best])


def mend(
    mesh: HalfEdges, vertices: Floats, normals: Floats, fixed: Flags, tree: TriangleTree, rounds: int = 4
) -> tuple[Ints, Ints]:
    """Replace discs around triangles that cut others; return where vertices go, and which triangles still cut."""
    into, cut = np.arange(len(vertices)), cutting(mesh, vertices, tree)
    for _ in range(rounds):
        if not len(cut) or _mend_all(mesh, vertices, normals, fixed, tree, cut, into) == 0:
            break
        cut = cutting(mesh, vertices, tree, cut)  # new triangles cut none
    return ends(into), cut


@kernel
def relax(mesh, vertices, corners):
    """Move vertices, (m,), one by one, partly to the mean of their neighbours, on boundaries of those on these."""
    halves, ring = room_for_ring()
    for v in corners:
        count, _, closed = neighbours(mesh, v, halves, ring)
        beside = ring[:count] if closed else ring[: count : count - 1]
        for axis in range(3):
            vertices[v, axis] += 0.25 * (vertices[beside, axis].mean() - vertices[v, axis])


@kernel
def _mend_all(mesh, vertices, normals, fixed, tree, faces, into):
    """Mend the triangles `faces`, (m,), one after another; return how many patches were replaced."""
    inside = np.zeros(len(mesh.origin) // 3, dtype=np.bool_)
    patch, loop = np.empty(120, dtype=np.int64), np.empty(36, dtype=np.int64)  # larger ones are not tried
    new, changes = np.empty((len(loop), 3), dtype=np.int64), 0
    halves, _ = room_for_ring()
    for f in faces:
        if mesh.origin[3 * f] < 0 or not is_cut(mesh, vertices, tree, inside, f):
            continue
        for which in range(11):
            size = _patch(mesh, f, which, halves, patch)
            inside[patch[:size]] = True
            length = _boundary(mesh, patch[:size], inside, fixed, loop) if size else 0
            corners, count = mesh.origin[loop[:length]], 0
            if length:
                count = fill(mesh, vertices, normals, tree, inside, corners, halves, True, new)
            inside[patch[:size]] = False
            if count:
                _replace(mesh, vertices, tree, patch[:size], corners, new[:count], into)
                changes += 1
                break
    return changes


@kernel(allocates=False)
def _patch(mesh, f, which, halves, patch):
    """Fill `patch` with f and one or all neighbours, or with the stars of one to three corners; return its size."""
    patch[0], size = f, 1
    for k in range(3):
        h = 3 * f + k
        if which in (k, 3):
            if mesh.opposite[h] >= 0:
                size = add_to_patch(patch, size, mesh.opposite[h] // 3)
            elif which == k:
                return 0
        if which in (4 + k, 7 + k, 7 + (k + 2) % 3, 10):
            edges, _ = around(mesh, mesh.origin[h], halves)
            for slot in range(edges):
                size = add_to_patch(patch, size, halves[slot] // 3)
    return size if size < len(patch) else 0


@kernel
def _boundary(mesh, patch, inside, fixed, loop):
    """Fill `loop` with the half-edges around a patch; return their number, 0 if it is no disc to be filled."""
    first, outer = -1, 0
    for f in patch:
        for h in range(3 * f, 3 * f + 3):
            if mesh.opposite[h] < 0 or not inside[mesh.opposite[h] // 3]:
                first, outer = h, outer + 1
    if not 3 <= outer <= len(loop):
        return 0
    h, length = first, 0
    while length == 0 or h != first:
        for slot in range(length):
            if length == outer or mesh.origin[loop[slot]] == mesh.origin[h]:
                return 0
        loop[length] = h
        length += 1
        h = following(h)
        while mesh.opposite[h] >= 0 and inside[mesh.opposite[h] // 3]:
            h = following(mesh.opposite[h])
    if length < outer or (len(patch) - length) % 2:
        return 0
    inner, corners = 0, mesh.origin[loop[:length]]
    for v in np.unique(mesh.origin.reshape(-1, 3)[patch].ravel()):
        if position_of(corners, length, v) < 0:
            if fixed[v]:
                return 0
            inner += 1
    return length if inner == (len(patch) - length + 2) // 2 else 0


@kernel
def _replace(mesh, vertices, tree, patch, corners, new, into):
    """Put the triangles `new`, (L - 2, 3), in the place of a patch with a boundary of corners, (L,)."""
    for f in patch:
        for v in mesh.origin[3 * f : 3 * f + 3]:
            into[v] = _nearest(vertices, v, corners)
    replace_triangles(mesh, patch, new)
    for f in patch[: len(new)]:
        follow(mesh, vertices, tree, f)


@kernel(allocates=False)
def _nearest(vertices, v, corners):
    """Return the corner nearest to a vertex: itself if it is one."""
    nearest, lowest = v, np.inf
    for u in corners:
        if u == v:
            return v
        step = minus(row(vertices, u), row(vertices, v))
        if dot(step, step) < lowest:
            nearest, lowest = u, dot(step, step)
    return nearest


def cut_out(mesh: HalfEdges, vertices: Floats, normals: Floats) -> tuple[HalfEdges, int]:
    """Drop triangles until none cuts another, large ones first, and fill the holes; return also how many stay open."""
    boundary, tree = mesh.boundary_edges(), TriangleTree.from_mesh(mesh, vertices)
    cut = cutting(mesh, vertices, tree)
    a, b, c = (vertices[corner] for corner in mesh.corners()[cut].T)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    dropped = mesh.origin[::3] < 0
    _drop(mesh, vertices, tree, cut[np.argsort(-areas, kind="stable")], dropped)
    left = without_bow_ties(mesh.changed(~dropped))
    old = mesh.origin[boundary] * len(vertices) + mesh.targets()[boundary]
    loops = [loop for loop in boundary_loops(left) if not np.isin(np.roll(loop, -1) * len(vertices) + loop, old).any()]
    filled, numbers = with_fillings(left, vertices, *fillings(left, vertices, normals, loops, careful=True))
    return filled, len(loops) - len(numbers)


@kernel
def _drop(mesh, vertices, tree, faces, dropped):
    """Mark in `dropped`, (F,), those of some triangles that cut one that is not marked."""
    for f in faces:
        dropped[f] = is_cut(mesh, vertices, tree, dropped, f)
