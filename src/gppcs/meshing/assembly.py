"""Put triangles together so that they stay an oriented manifold, and fill small gaps between them."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gppcs.engine.kernels import kernel
from gppcs.meshing.coverage import Cover, are_covered, is_covered, no_search
from gppcs.meshing.halfedges import (
    MOST_AROUND,
    EdgeTable,
    Floats,
    HalfEdges,
    Ints,
    add_edge,
    find_edge,
    following,
    preceding,
)
from gppcs.spatial.triangles import area_vector, dot, has_area, minus, row

SMALL_GAP = 8  # corners of a gap that is filled before triangles of a single fan are tried
PINHOLE, PINHOLE_SIZE = (
    6,
    4.0,
)  # corners and size, in usual edges, of a gap that is filled though no points cover it, as random samples have
LARGEST_GAP = 40  # corners of a gap that is filled at the end
MOST_CORNERS = 1000  # of a hole that is filled on request: its filling takes the cube of their number in time
PIECE_TRIANGLES = 12  # triangles of a piece; smaller ones are scraps
BEND = 4.0  # weight of the bend of a filling, beside its area
LENGTH = 0.02  # weight of its squared edges, which keeps its triangles compact


def assembled(
    triangles: Ints, votes: Ints, radii: Floats, points: Floats, normals: Floats, reaches: Floats, cover: Cover
) -> Ints:
    """Choose triangles of the fans that together are an oriented manifold, and fill gaps that dense points cover.

    Triangles on which two or three fans agree come first, those with small circumcircles before others. Small gaps
    are filled; then triangles of a single fan are added where there is room; then larger gaps are filled, and pinholes.
    """
    kept = are_covered(cover, triangles, points, reaches)
    triangles, votes, radii = triangles[kept], votes[kept], radii[kept]
    order = np.lexsort((radii, -votes))
    agreed = votes[order] > 1
    gaps = points, normals, reaches, cover
    faces = taken(triangles[order[agreed]], len(points))
    faces = without_bow_ties(faces[np.argsort(faces[:, 0], kind="stable")], len(points))  # near ones side by side
    faces = filled(faces, *gaps, SMALL_GAP)
    faces = taken(np.concatenate([faces, triangles[order[~agreed]]]), len(points))
    faces = filled(without_bow_ties(faces, len(points)), *gaps, LARGEST_GAP)
    faces = filled(without_bow_ties(faces, len(points)), *gaps, LARGEST_GAP)
    corners = points[faces]
    usual = np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1))
    faces = holes_filled(
        without_bow_ties(faces, len(points)), points, normals, PINHOLE_SIZE * usual, cover, PINHOLE
    )  # fmt: skip
    return without_bow_ties(faces, len(points))


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


def without_bow_ties(faces: Ints, n: int) -> Ints:
    """Leave out triangles so that those at each vertex are one fan: the largest stays, of equal ones the first."""
    while True:
        mesh = HalfEdges.of(faces, n)
        inner = np.flatnonzero(mesh.opposite >= 0)
        other = mesh.opposite[inner]
        ends = inner, np.where(other % 3 == 2, other - 2, other + 1)  # they leave the same vertex
        _, fan = connected_components(coo_array((np.ones(len(inner)), ends), shape=(len(mesh.origin),) * 2))
        sizes = np.bincount(fan)
        if len(sizes) == np.count_nonzero(mesh.leaving >= 0):
            return faces
        vertex = np.empty(len(sizes), dtype=np.int64)
        vertex[fan] = mesh.origin
        several = np.flatnonzero(np.bincount(vertex)[vertex] > 1)
        order = several[np.lexsort((-sizes[several], vertex[several]))]
        smaller = np.zeros(len(sizes), dtype=np.bool_)
        smaller[order[1:]] = vertex[order[1:]] == vertex[order[:-1]]
        faces = faces[~smaller[fan].reshape(-1, 3).any(axis=1)]


def filled(faces: Ints, points: Floats, normals: Floats, reaches: Floats, cover: Cover, most: int) -> Ints:
    """Fill the gaps that have few corners and that the dense points cover."""
    mesh = HalfEdges.of(faces, len(points))
    loops, ends = border_loops(mesh)
    return np.concatenate([faces, _fillings(mesh, loops, ends, most, points, normals, reaches, cover, True)])


def _fillings(
    mesh: HalfEdges,
    loops: Ints,
    ends: Ints,
    most: int,
    points: Floats,
    normals: Floats,
    reaches: Floats,
    cover: Cover,
    covered: bool,
) -> Ints:
    """Return the triangles, (B, 3), that close borders, as `border_loops` lists them; see `_fill_all`."""
    table = EdgeTable.of(len(mesh.leaving), len(mesh.origin) + 3 * len(loops))
    added = np.empty((len(loops), 3), dtype=np.int64)
    return added[: _fill_all(mesh, loops, ends, most, points, normals, reaches, cover, covered, table, added)]


def border_loops(mesh: HalfEdges) -> tuple[Ints, Ints]:
    """Return the borders of a mesh, each as its vertices in the order in which a filling would run around it."""
    loops = np.empty(int(((mesh.opposite < 0) & (mesh.origin >= 0)).sum()), dtype=np.int64)
    ends = np.empty(len(loops), dtype=np.int64)
    return loops, ends[: _list_loops(mesh, loops, ends)]


@kernel
def _list_loops(mesh, loops, ends):
    """Fill `loops`, (B,), and `ends`, as `border_loops` returns them; return the number of borders."""
    seen = np.zeros(len(mesh.origin), dtype=np.bool_)
    length, count = 0, 0
    for first in range(len(mesh.origin)):
        if mesh.origin[first] < 0 or mesh.opposite[first] >= 0 or seen[first]:
            continue
        h = first
        while not seen[h]:
            seen[h] = True
            loops[length] = mesh.origin[following(h)]
            length += 1
            h = preceding(h)
            while mesh.opposite[h] >= 0:
                h = preceding(mesh.opposite[h])
        ends[count] = length
        count += 1
    return count


@kernel
def _fill_all(mesh, loops, ends, most, points, normals, reaches, cover, covered, table, added):
    """Fill `added`, (B, 3), with triangles that close borders of at most `most` corners; return their number.

    The table, empty at first, gets all directed edges, so that no filling repeats one. With `covered`, only what the
    dense points cover is filled.
    """
    for h in range(len(mesh.origin)):
        if mesh.origin[h] >= 0:
            add_edge(table, mesh.origin[h], mesh.origin[following(h)], h)
    last = no_search()
    degrees = np.zeros(len(mesh.leaving), dtype=np.int64)
    for v in mesh.origin:
        if v >= 0:
            degrees[v] += 1
    count, begin = 0, 0
    for end in ends:
        loop = loops[begin:end]
        begin = end
        if not 3 <= len(loop) <= most:
            continue
        new = _fill(loop, points, normals, table, added[count : count + len(loop) - 2])
        fits = new > 0
        for t in range(count, count + new):
            for k in range(3):
                p, q = added[t, k], added[t, (k + 1) % 3]
                degrees[p] += 1
                fits = fits and find_edge(table, p, q) < 0 and degrees[p] <= MOST_AROUND
            if fits and covered:
                fits = is_covered(cover, points, reaches, added[t, 0], added[t, 1], added[t, 2], last)
        for t in range(count, count + new):
            for k in range(3):
                p, q = added[t, k], added[t, (k + 1) % 3]
                if fits:
                    add_edge(table, p, q, len(mesh.origin) + 3 * t + k)
                else:
                    degrees[p] -= 1
        if fits:
            count += new
    return count


@kernel
def _fill(loop, points, normals, table, triangles):
    """Fill `triangles`, (L - 2, 3), with the cheapest that close a loop, (L,); return their number, 0 if none do.

    The cost is the area, more where the filling bends away from the normals of its corners (Barequet and Sharir 1995;
    Liepa 2003). The inner edges are none that the table has.
    """
    length = len(loop)
    costs = np.full((length, length), np.inf)
    middles = np.empty((length, length), dtype=np.int64)
    for i in range(length - 1):
        costs[i, i + 1] = 0.0
    for gap in range(2, length):
        for i in range(length - gap):
            k = i + gap
            inner = gap < length - 1
            p, q = loop[i], loop[k]
            if inner and (find_edge(table, p, q) >= 0 or find_edge(table, q, p) >= 0):
                continue
            for m in range(i + 1, k):
                cost = costs[i, m] + costs[m, k]
                if cost < costs[i, k]:
                    cost += cost_of_filling(points, normals, p, loop[m], q)
                    if cost < costs[i, k]:
                        costs[i, k], middles[i, k] = cost, m
    return trace_filling(loop, middles, triangles) if costs[0, length - 1] < np.inf else 0


@kernel
def trace_filling(loop, middles, triangles):
    """Fill `triangles`, (L - 2, 3), with those of a filling; return their number."""
    stack = np.empty((len(loop), 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, len(loop) - 1
    height, count = 1, 0
    while height:
        height -= 1
        i, k = stack[height]
        if k - i < 2:
            continue
        m = middles[i, k]
        triangles[count, 0], triangles[count, 1], triangles[count, 2] = loop[i], loop[m], loop[k]
        count += 1
        stack[height, 0], stack[height, 1] = i, m
        stack[height + 1, 0], stack[height + 1, 1] = m, k
        height += 2
    return count


@kernel(allocates=False)
def cost_of_filling(points, normals, a, b, c):
    """Return the cost of a triangle of a filling."""
    pa, pb, pc = row(points, a), row(points, b), row(points, c)
    normal = area_vector(pa, pb, pc)
    doubled = np.sqrt(dot(normal, normal))
    agreement = 1.0
    if doubled > 0.0:
        for v in (a, b, c):
            agreement = min(agreement, dot(normal, row(normals, v)) / doubled)
    ab, ca = minus(pb, pa), minus(pa, pc)
    if not has_area(pa, pb, pc):
        return dot(ab, ab) + dot(ca, ca)  # more than any triangle beside it would cost
    return 0.5 * doubled * (1.0 + BEND * (1.0 - agreement) ** 2) + LENGTH * max(dot(ab, ab), dot(ca, ca))


def without_scraps(faces: Ints, n: int, fewest: int = PIECE_TRIANGLES) -> Ints:
    """Leave out connected pieces of few triangles."""
    pieces = pieces_of(faces, n)
    return faces[np.bincount(pieces, minlength=1)[pieces] >= fewest]


def pieces_of(faces: Ints, n: int) -> Ints:
    """Return the connected piece of each triangle."""
    ends = np.concatenate([faces[:, :2], faces[:, 1:]]).T
    _, pieces = connected_components(coo_array((np.ones(ends.shape[1]), ends), shape=(n, n)), directed=False)
    found: Ints = pieces[faces[:, 0]]
    return found


def holes_filled(
    faces: Ints, points: Floats, normals: Floats, size: float, cover: Cover, most: int = MOST_CORNERS
) -> Ints:
    """Close holes up to a size, whether dense points cover them or not."""
    mesh = HalfEdges.of(faces, len(points))
    loops, ends = border_loops(mesh)
    runs = [loop for loop in np.split(loops, ends[:-1]) if len(loop)]
    small = [loop for loop in runs if np.linalg.norm(np.ptp(points[loop], axis=0)) <= size]
    if not small:
        return faces
    loops, ends = np.concatenate(small), np.cumsum([len(loop) for loop in small])
    reaches = np.ones(len(points))
    return np.concatenate([faces, _fillings(mesh, loops, ends, most, points, normals, reaches, cover, False)])
