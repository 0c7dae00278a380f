"""Join the surroundings of triangles that cut others anew, so that they no longer do."""

from __future__ import annotations

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.meshing.assembly import (
    border_loops,
    cost_of_filling,
    holes_filled,
    pieces_of,
    trace_filling,
    without_bow_ties,
)
from gppcs.meshing.collapse import ends
from gppcs.meshing.coverage import Cover
from gppcs.meshing.cuts import TriangleTree, are_cut, cutting, first_cut, follow, is_cut
from gppcs.meshing.halfedges import MOST_AROUND, Flags, Floats, HalfEdges, Ints, around, following, leave_by
from gppcs.spatial.triangles import area_vector, dot, has_area, minus, nearest_in_triangle, row, squared_distance

ROUNDS = 4  # of mending all triangles that cut others
MOST_RINGS = 2  # of triangles by which a hole grows so that it can be closed
PATCHES = 11  # patches around a triangle that are tried
MOST_TRIANGLES = 120  # of a patch
LOST = 0.5  # farthest a vertex inside may lie from what closes a hole, in usual edges
LONGEST_LOOP = 36  # corners of a patch


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
            cut = cutting(mesh, vertices, tree)
    return ends(into), cut


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
                count = _close(mesh, vertices, normals, tree, inside, mesh.origin[loop[:length]], halves, new)
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
                size = _add(patch, size, mesh.opposite[h] // 3)
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
        size = _add(patch, size, halves[slot] // 3)
    return size


@kernel(allocates=False)
def _add(patch, size, f):
    """Add a triangle to a patch of some size, unless it is there or the patch is full; return the new size."""
    for slot in range(size):
        if patch[slot] == f:
            return size
    if size == MOST_TRIANGLES:
        return size
    patch[size] = f
    return size + 1


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
    return length if _count_inner(mesh, patch, loop[:length], kept) == (len(patch) - length + 2) // 2 else 0


@kernel
def _count_inner(mesh, patch, loop, kept):
    """Return the number of vertices of a patch that are not on its border; -1 if one of them is kept."""
    inner = np.empty(3 * len(patch), dtype=np.int64)
    count = 0
    for f in patch:
        for h in range(3 * f, 3 * f + 3):
            v = mesh.origin[h]
            known = False
            for other in loop:
                known = known or mesh.origin[other] == v
            for slot in range(count):
                known = known or inner[slot] == v
            if not known:
                if kept[v]:
                    return -1
                inner[count] = v
                count += 1
    return count


@kernel
def _close(mesh, vertices, normals, tree, inside, corners, halves, new):
    """Fill `new` with the cheapest triangles that close a loop of vertices, (L,), and cut nothing; count them.

    The count is 0 if there are none. The triangles marked in `inside` do not count. See `assembly` for the cost.
    """
    length = len(corners)
    costs, middles = np.full((length, length), np.inf), np.empty((length, length), dtype=np.int64)
    for i in range(length - 1):
        costs[i, i + 1] = 0.0
    for gap in range(2, length):
        for i in range(length - gap):
            k = i + gap
            p, q = corners[i], corners[k]
            if gap < length - 1 and _is_joined(mesh, p, q, inside, halves):
                continue
            for m in range(i + 1, k):
                v = corners[m]
                cost = costs[i, m] + costs[m, k]
                if cost < costs[i, k] and _is_upright(vertices, normals, p, v, q):
                    cost += cost_of_filling(vertices, normals, p, v, q)
                    if cost < costs[i, k] and first_cut(mesh, vertices, tree, inside, p, v, q) < 0:
                        costs[i, k], middles[i, k] = cost, m
    if costs[0, length - 1] == np.inf:
        return 0
    count = trace_filling(corners, middles, new)
    for i in range(count):
        for j in range(i):
            if are_cut(vertices, new[i], new[j]):
                return 0
    return count if _is_light(mesh, corners, inside, new[:count], halves) else 0


@kernel(allocates=False)
def _is_joined(mesh, p, q, inside, halves):
    """Return whether an edge joins two vertices that a triangle outside the patch has."""
    for v, w in ((p, q), (q, p)):
        edges, _ = around(mesh, v, halves)
        for slot in range(edges):
            if mesh.origin[following(halves[slot])] == w and not inside[halves[slot] // 3]:
                return True
    return False


@kernel(allocates=False)
def _is_upright(vertices, normals, a, b, c):
    """Return whether a triangle has an area, and lies on the side of the mean of its corners' normals."""
    pa, pb, pc = row(vertices, a), row(vertices, b), row(vertices, c)
    normal = area_vector(pa, pb, pc)
    if not has_area(pa, pb, pc):
        return False
    return dot(normal, row(normals, a)) + dot(normal, row(normals, b)) + dot(normal, row(normals, c)) >= 0.0


@kernel(allocates=False)
def _is_light(mesh, corners, inside, new, halves):
    """Return whether no corner of a patch would have too many triangles."""
    for v in corners:
        edges, _ = around(mesh, v, halves)
        count = 0
        for slot in range(edges):
            count += not inside[halves[slot] // 3]
        for t in range(len(new)):
            count += new[t, 0] == v or new[t, 1] == v or new[t, 2] == v
        if count > MOST_AROUND:
            return False
    return True


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


def cut_out(mesh: HalfEdges, vertices: Floats, normals: Floats, kept: Flags) -> tuple[Ints, int]:
    """Leave out triangles until none cuts another, and close the holes by triangles that cut nothing.

    This may change the topology: a handle that is no part of the surface often cuts it. If a hole cannot be closed,
    rings of triangles around it are left out as well; unless some vertices are kept.
    """
    old = _border_edges(mesh)
    faces, holes = _closed(_without_cuts(mesh, vertices), vertices, normals, old)
    for rings in range(1, 1 + (0 if kept.any() else MOST_RINGS)):
        if holes:
            faces, holes = _closed_wider(faces, vertices, normals, old, holes, rings)
    return faces, len(holes)


def _closed_wider(
    faces: Ints, vertices: Floats, normals: Floats, old: Ints, holes: list[Ints], rings: int
) -> tuple[Ints, list[Ints]]:
    """Leave out rings of triangles around holes, then close them; where this fails, all stays as it was.

    Arguments and results are as for `_closed`; `holes` are the vertices around each.
    """
    n = len(vertices)
    beside = np.concatenate(holes)
    for _ in range(rings):
        near = np.isin(faces, beside).any(axis=1)
        beside = np.unique(faces[near])
    left = without_bow_ties(faces[~near], n)
    closed, _ = _closed(left, vertices, normals, old)
    gone = faces[~np.isin(_first_edges(faces, n), _first_edges(left, n))]
    piece, label = pieces_of(gone, n), np.full(n, -1)
    label[gone] = piece[:, None]
    open_ = np.setdiff1d(_border_edges(HalfEdges.of(closed, n)), old) // n
    new, lost = closed[len(left) :], np.setdiff1d(gone, closed)
    edges = np.linalg.norm(vertices[gone] - vertices[np.roll(gone, 1, axis=1)], axis=2).mean(axis=1)
    usual = np.bincount(piece, edges) / np.maximum(1, np.bincount(piece))
    far = _distances(vertices, lost, new, label) > LOST * usual[label[lost]]  # a part of the surface would be lost
    failed = np.union1d(label[open_], label[lost[far]])
    result = np.concatenate([left, new[~np.isin(label[new[:, 0]], failed)], gone[np.isin(piece, failed)]])
    if len(cutting(HalfEdges.of(result, n), vertices)):
        return faces, holes
    return result, [hole for hole in holes if label[hole[0]] in failed]


@kernel
def _distances(vertices, lost, new, label):
    """Return the distance of each of some vertices to the nearest new triangle with the same label."""
    distances = np.full(len(lost), np.inf)
    for i in range(len(lost)):
        place = row(vertices, lost[i])
        for t in range(len(new)):
            if label[new[t, 0]] == label[lost[i]]:
                a = minus(row(vertices, new[t, 0]), place)
                b, c = minus(row(vertices, new[t, 1]), place), minus(row(vertices, new[t, 2]), place)
                v, w = nearest_in_triangle(a, b, c)
                distances[i] = min(distances[i], np.sqrt(squared_distance(a, b, c, v, w)))
    return distances


def _first_edges(faces: Ints, n: int) -> Ints:
    """Return a number for each triangle of an oriented manifold of n vertices, (F,), that no other has."""
    found: Ints = faces[:, 0] * n + faces[:, 1]
    return found


def _closed(faces: Ints, vertices: Floats, normals: Floats, old: Ints) -> tuple[Ints, list[Ints]]:
    """Close the holes of a mesh, except the borders `old`, by triangles that cut nothing.

    Return the triangles, and the vertices around each hole that stays open.
    """
    n = len(vertices)
    mesh = HalfEdges.of(faces, n)
    loops, ends = border_loops(mesh)
    runs = np.split(loops, ends[:-1]) if len(ends) else []
    runs = [run for run in runs if not np.isin(np.roll(run, -1) * n + run, old).any()]
    if not runs:
        return faces, []
    ends = np.cumsum([len(run) for run in runs])
    new, closed = np.empty((ends[-1], 3), dtype=np.int64), np.zeros(len(runs), dtype=np.bool_)
    tree = TriangleTree.of(mesh, vertices)
    count = _close_all(mesh, vertices, normals, tree, np.concatenate(runs), ends, new, closed)
    open_ = [run for run, done in zip(runs, closed, strict=True) if not done]
    return np.concatenate([faces, new[:count]]), open_


def _border_edges(mesh: HalfEdges) -> Ints:
    """Return the half-edges on borders, from p to q, as p V + q."""
    h = np.flatnonzero((mesh.origin >= 0) & (mesh.opposite < 0))
    return mesh.origin[h] * len(mesh.leaving) + mesh.origin[np.where(h % 3 == 2, h - 2, h + 1)]


@kernel
def _close_all(mesh, vertices, normals, tree, loops, ends, new, closed):
    """Close holes, which `loops` and `ends` list as `border_loops` does, by triangles that cut nothing.

    Fill `new`, (L, 3), with these, and mark in `closed` the holes that are; return the number of triangles.
    """
    inside = np.zeros(len(mesh.origin) // 3, dtype=np.bool_)
    halves = np.empty(MOST_AROUND, dtype=np.int64)
    begin = total = 0
    for hole in range(len(ends)):
        corners = loops[begin : ends[hole]]
        begin = ends[hole]
        if len(corners) > LONGEST_LOOP:
            continue
        count = _close(mesh, vertices, normals, tree, inside, corners, halves, new[total:])
        closed[hole] = count > 0
        for t in range(total, total + count):
            for s in range(total):
                closed[hole] = closed[hole] and not are_cut(vertices, new[t], new[s])
        total += count if closed[hole] else 0
    return total


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


def holes_closed(faces: Ints, points: Floats, normals: Floats, size: float, cover: Cover) -> Ints:
    """Close holes up to a size as `holes_filled` does, except those whose filling would cut another triangle."""
    closed, n = holes_filled(faces, points, normals, size, cover), len(points)
    cut = cutting(HalfEdges.of(closed, n), points)
    added = closed[len(faces) :]
    hole = pieces_of(added, n)  # the fillings of two holes have no common vertex
    spoilt = np.isin(hole, hole[cut[cut >= len(faces)] - len(faces)])
    return np.concatenate([faces, added[~spoilt]])
