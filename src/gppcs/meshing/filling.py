"""Fill holes by the cheapest triangles (Barequet and Sharir 1995; Liepa 2003)."""

from __future__ import annotations

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.meshing.cuts import TriangleTree, are_cut, cutting, first_cut
from gppcs.meshing.halfedges import MOST_AROUND, Floats, HalfEdges, Ints, around, following, preceding
from gppcs.spatial.triangles import area_vector, dot, has_area, minus, row

MOST_CORNERS = 1000  # of a hole that is filled: its filling takes the cube of their number in time
BEND = 4.0  # weight of the bend of a filling, beside its area
LENGTH = 0.02  # weight of its squared edges, which keeps its triangles compact


def holes_filled(faces: Ints, vertices: Floats, normals: Floats, size: float, most: int = MOST_CORNERS) -> Ints:
    """Close holes up to a size, the diagonal of the box around their border, where that cuts nothing."""
    loops = [
        loop
        for loop in border_loops(HalfEdges.of(faces, len(vertices)))
        if len(loop) <= most and np.linalg.norm(np.ptp(vertices[loop], axis=0)) <= size
    ]
    return np.concatenate([faces, without_cutting(faces, vertices, *fillings(faces, vertices, normals, loops))[0]])


def fillings(
    faces: Ints, vertices: Floats, normals: Floats, loops: list[Ints], careful: bool = False
) -> tuple[Ints, Ints]:
    """Return triangles that close borders of a mesh, (T, 3), and the number of the border of each.

    Careful ones cut no triangle of the mesh, and turn none over.
    """
    if not loops:
        return np.empty((0, 3), dtype=np.int64), np.empty(0, dtype=np.int64)
    mesh = HalfEdges.of(faces, len(vertices))
    ends = np.cumsum([len(loop) for loop in loops])
    new, hole = np.empty((ends[-1], 3), dtype=np.int64), np.empty(ends[-1], dtype=np.int64)
    tree = TriangleTree.of(mesh, vertices)
    count = _fill_all(mesh, vertices, normals, tree, np.concatenate(loops), ends, careful, new, hole)
    return new[:count], hole[:count]


def without_cutting(faces: Ints, vertices: Floats, new: Ints, hole: Ints) -> tuple[Ints, Ints]:
    """Leave out the fillings that have a triangle which cuts another: of the mesh, or of another filling."""
    whole = HalfEdges.of(np.concatenate([faces, new]), len(vertices))  # no two borders have a common vertex
    cut = cutting(whole, vertices, among=len(faces) + np.arange(len(new))) - len(faces)
    spoilt = np.isin(hole, hole[cut])
    return new[~spoilt], hole[~spoilt]


def border_loops(mesh: HalfEdges) -> list[Ints]:
    """Return the borders of a mesh, each as its vertices in the order in which a filling would run around it."""
    loops = np.empty(int(((mesh.opposite < 0) & (mesh.origin >= 0)).sum()), dtype=np.int64)
    ends = np.empty(len(loops), dtype=np.int64)
    return np.split(loops, ends[: _list_loops(mesh, loops, ends)])[:-1]


@kernel
def _list_loops(mesh, loops, ends):
    """Fill `loops`, (B,), and `ends`, with where each border ends; return the number of borders."""
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
def _fill_all(mesh, vertices, normals, tree, corners, ends, careful, new, hole):
    """Fill `new` and `hole` as `fillings` returns them; return the number of triangles."""
    inside = np.zeros(len(mesh.origin) // 3, dtype=np.bool_)
    halves = np.empty(MOST_AROUND, dtype=np.int64)
    begin = count = 0
    for number in range(len(ends)):
        loop = corners[begin : ends[number]]
        begin = ends[number]
        added = fill(mesh, vertices, normals, tree, inside, loop, halves, careful, new[count:])
        hole[count : count + added] = number
        count += added
    return count


@kernel
def fill(mesh, vertices, normals, tree, inside, corners, halves, careful, new):
    """Fill `new` with the cheapest triangles that close a loop of vertices, (L,); return their number, 0 if none do.

    The cost is the area, more where the filling bends away from the normals of its corners. Careful fillings cut no
    triangle but those marked in `inside`, and turn none over.
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
                if cost < costs[i, k] and (not careful or _is_upright(vertices, normals, p, v, q)):
                    cost += cost_of_filling(vertices, normals, p, v, q)
                    cuts = careful and cost < costs[i, k] and first_cut(mesh, vertices, tree, inside, p, v, q) >= 0
                    if cost < costs[i, k] and not cuts:
                        costs[i, k], middles[i, k] = cost, m
    if costs[0, length - 1] == np.inf:
        return 0
    count = trace_filling(corners, middles, new)
    for i in range(count if careful else 0):
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
