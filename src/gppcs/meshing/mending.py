"""Join the surroundings of triangles that cut others anew, so that they no longer do."""

from __future__ import annotations

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.meshing.collapse import ends
from gppcs.meshing.cuts import TriangleTree, cutting, follow, is_cut
from gppcs.meshing.filling import border_loops, fill, fillings, without_cutting
from gppcs.meshing.halfedges import (
    MOST_AROUND,
    Flags,
    Floats,
    HalfEdges,
    Ints,
    add_triangle,
    around,
    following,
    leave_by,
    neighbours,
    without_bow_ties,
)
from gppcs.spatial.triangles import dot, minus, row

ROUNDS = 4  # of mending all triangles that cut others
PATCHES = 11  # patches around a triangle that are tried
MOST_TRIANGLES = 120  # of a patch
LONGEST_LOOP = 36  # corners of a patch
RELAXED = 0.25  # of the way to the middle of its neighbours, how far a vertex goes


def mend(mesh: HalfEdges, vertices: Floats, normals: Floats, kept: Flags, rounds: int = ROUNDS) -> tuple[Ints, Ints]:
    """Replace patches around triangles that cut others by triangles that cut nothing, where that can be done.

    The patches are two triangles with a common edge, then those around a vertex or some vertices. A patch is a disc,
    and its border stays, so the topology does, too. The vertices inside are removed.
    """
    into, cut = np.arange(len(vertices)), np.empty(0, dtype=np.int64)
    if len(mesh.faces()):
        tree = TriangleTree.of(mesh, vertices)
        cut = cutting(mesh, vertices, tree)
        for _ in range(rounds):
            if not len(cut) or _mend_all(mesh, vertices, normals, kept, tree, cut, into) == 0:
                break
            cut = cutting(mesh, vertices, tree, cut)  # new triangles cut none
    return ends(into), cut


def relax(mesh: HalfEdges, vertices: Floats, faces: Ints) -> None:
    """Move the corners of some triangles a part of the way to the middle of their neighbours.

    On borders, these are the two on the border.
    """
    _relax_all(mesh, vertices, np.unique(mesh.origin.reshape(-1, 3)[faces]))


@kernel
def _relax_all(mesh, vertices, corners):
    """Move some vertices, (m,), one after another."""
    halves, found = np.empty(MOST_AROUND, dtype=np.int64), np.empty(MOST_AROUND + 1, dtype=np.int64)
    for v in corners:
        count, _, closed = neighbours(mesh, v, halves, found)
        others = found[:count] if closed else found[: count : count - 1]
        for axis in range(3):
            vertices[v, axis] += RELAXED * (vertices[others, axis].mean() - vertices[v, axis])


@kernel
def _mend_all(mesh, vertices, normals, kept, tree, faces, into):
    """Mend the triangles `faces`, (m,), one after another; return how many patches were replaced."""
    inside = np.zeros(len(mesh.origin) // 3, dtype=np.bool_)
    patch, loop = np.empty(MOST_TRIANGLES, dtype=np.int64), np.empty(LONGEST_LOOP, dtype=np.int64)
    halves, new = np.empty(MOST_AROUND, dtype=np.int64), np.empty((LONGEST_LOOP, 3), dtype=np.int64)
    changes = 0
    for f in faces:
        if mesh.origin[3 * f] < 0 or not is_cut(mesh, vertices, tree, inside, f):
            continue
        for which in range(PATCHES):
            size = _patch(mesh, f, which, halves, patch)
            for i in range(size):
                inside[patch[i]] = True
            length = _border(mesh, patch[:size], inside, kept, loop) if size else 0
            count = 0
            if length:
                count = fill(mesh, vertices, normals, tree, inside, mesh.origin[loop[:length]], halves, True, new)
            for i in range(size):
                inside[patch[i]] = False
            if count:
                _replace(mesh, vertices, tree, patch[:size], loop[:length], new[:count], into)
                changes += 1
                break
    return changes


@kernel(allocates=False)
def _patch(mesh, f, which, halves, patch):
    """Fill `patch` with a patch around the triangle f; return its number of triangles, 0 if there is none.

    Of the 11 patches, three are f and a neighbour, one is f and all neighbours, three are the triangles around a
    corner, three those around two, and the last one those around all three.
    """
    patch[0], size = f, 1
    for k in range(3):
        h = 3 * f + k
        if which in (k, 3):
            if mesh.opposite[h] >= 0:
                size = add_triangle(patch, size, mesh.opposite[h] // 3)
            elif which == k:
                return 0
        if which in (4 + k, 7 + k, 7 + (k + 2) % 3, 10):
            size = _add_around(mesh, mesh.origin[h], halves, patch, size)
    return size if size < MOST_TRIANGLES else 0


@kernel(allocates=False)
def _add_around(mesh, v, halves, patch, size):
    """Add the triangles around a vertex to a patch of some size; return the new size."""
    edges, _ = around(mesh, v, halves)
    for slot in range(edges):
        size = add_triangle(patch, size, halves[slot] // 3)
    return size


@kernel
def _border(mesh, patch, inside, kept, loop):
    """Fill `loop` with the half-edges around a patch, counter-clockwise; return their number.

    It is 0 if the patch is not a disc, has too long a border, or has a kept vertex inside.
    """
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
    inner = 0
    vertices = np.unique(
        np.concatenate((mesh.origin[3 * patch], mesh.origin[3 * patch + 1], mesh.origin[3 * patch + 2]))
    )
    for v in vertices:
        if not (mesh.origin[loop[:length]] == v).any():
            if kept[v]:
                return 0
            inner += 1
    return length if inner == (len(patch) - length + 2) // 2 else 0


@kernel
def _replace(mesh, vertices, tree, patch, loop, new, into):
    """Put the triangles `new`, (L - 2, 3), in the place of a patch with a border of half-edges, (L,)."""
    outer, corners = mesh.opposite[loop], mesh.origin[loop]
    for f in patch:
        for h in range(3 * f, 3 * f + 3):
            v = mesh.origin[h]
            mesh.leaving[v] = -1
            into[v] = _nearest(vertices, v, corners)
            mesh.origin[h] = mesh.opposite[h] = -1
    for t in range(len(new)):
        for k in range(3):
            mesh.origin[3 * patch[t] + k] = new[t, k]
    for t in range(len(new)):
        for h in range(3 * patch[t], 3 * patch[t] + 3):
            a, b = mesh.origin[h], mesh.origin[following(h)]
            for i in range(len(corners)):
                if corners[i] == a and corners[(i + 1) % len(corners)] == b:
                    mesh.opposite[h] = outer[i]
                    if outer[i] >= 0:
                        mesh.opposite[outer[i]] = h
            for s in range(len(new)):
                for o in range(3 * patch[s], 3 * patch[s] + 3):
                    if mesh.origin[o] == b and mesh.origin[following(o)] == a:
                        mesh.opposite[h] = o
        follow(mesh, vertices, tree, patch[t])
    for t in range(len(new)):
        for h in range(3 * patch[t], 3 * patch[t] + 3):
            leave_by(mesh, mesh.origin[h], h)


@kernel(allocates=False)
def _nearest(vertices, v, corners):
    """Return the corner nearest to a vertex: itself if it is one."""
    best, least = v, np.inf
    for u in corners:
        step = minus(row(vertices, u), row(vertices, v))
        if u == v or dot(step, step) < least:
            best, least = u, -1.0 if u == v else dot(step, step)
    return best


def cut_out(mesh: HalfEdges, vertices: Floats, normals: Floats) -> tuple[Ints, int]:
    """Leave out triangles until none cuts another, and close the holes by triangles that cut nothing.

    This may change the topology: a handle that is no part of the surface often cuts it. Return the triangles, and the
    number of holes that stay open.
    """
    old, faces = _border_edges(mesh), _without_cuts(mesh, vertices)
    loops = border_loops(HalfEdges.of(faces, len(vertices)))
    loops = [loop for loop in loops if not np.isin(np.roll(loop, -1) * len(vertices) + loop, old).any()]
    new, hole = without_cutting(faces, vertices, *fillings(faces, vertices, normals, loops, careful=True))
    return np.concatenate([faces, new]), len(loops) - len(np.unique(hole))


def _border_edges(mesh: HalfEdges) -> Ints:
    """Return the half-edges on borders, from p to q, as p V + q."""
    h = np.flatnonzero((mesh.origin >= 0) & (mesh.opposite < 0))
    return mesh.origin[h] * len(mesh.leaving) + mesh.origin[np.where(h % 3 == 2, h - 2, h + 1)]


def without_cuts(faces: Ints, vertices: Floats, normals: Floats, kept: Flags) -> Ints:
    """Mend triangles that cut others once, then leave out those that still do: a first mesh has others beside them."""
    mesh = HalfEdges.of(faces, len(vertices))
    _, cut = mend(mesh, vertices, normals, kept, rounds=1)
    return _without_cuts(mesh, vertices) if len(cut) else mesh.faces()


def _without_cuts(mesh: HalfEdges, vertices: Floats) -> Ints:
    """Leave out triangles until none cuts another, large ones first; return the corners of the others, a manifold."""
    tree = TriangleTree.of(mesh, vertices)
    cut = cutting(mesh, vertices, tree)
    a, b, c = (vertices[corner] for corner in mesh.origin.reshape(-1, 3)[cut].T)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    left_out = np.zeros(len(mesh.origin) // 3, dtype=np.bool_)
    _leave_out(mesh, vertices, tree, cut[np.argsort(-areas, kind="stable")], left_out)
    faces = mesh.origin.reshape(-1, 3)[~left_out]
    return without_bow_ties(faces[faces[:, 0] >= 0], len(vertices))


@kernel
def _leave_out(mesh, vertices, tree, faces, left_out):
    """Mark in `left_out`, (F,), those of some triangles that cut one that is not marked."""
    for f in faces:
        left_out[f] = is_cut(mesh, vertices, tree, left_out, f)
