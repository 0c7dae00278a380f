"""Fill boundary loops by the cheapest triangles (Barequet and Sharir 1995; Liepa 2003)."""

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.meshing.cuts import TriangleTree, cuts_earlier, cuts_tree, cutting
from gppcs.meshing.halfedges import MAX_VALENCE, HalfEdges, around, half_edge, room_for_ring
from gppcs.spatial.triangles import agreement, area_vector, dot, has_area, minus, row

BEND = 4.0  # weight of the bend of a filling, beside its area
LENGTH = 0.02  # weight of its squared edges, which keeps its triangles compact


def holes_filled(mesh: HalfEdges, vertices: Floats, normals: Floats, size: float, max_corners: int = 1000) -> HalfEdges:
    """Close holes whose loops have a box of this diagonal at most, where that cuts nothing; cubic time in corners."""
    loops = [
        loop
        for loop in boundary_loops(mesh)
        if len(loop) <= max_corners and np.linalg.norm(np.ptp(vertices[loop], axis=0)) <= size
    ]
    return with_fillings(mesh, vertices, *fillings(mesh, vertices, normals, loops))[0]


def fillings(
    mesh: HalfEdges, vertices: Floats, normals: Floats, loops: list[Ints], careful: bool = False
) -> tuple[Ints, Ints]:
    """Return triangles that close loops, (T, 3), and the loop of each; careful ones cut nothing and turn none over."""
    if not loops:
        return np.empty((0, 3), dtype=np.int64), np.empty(0, dtype=np.int64)
    ends = np.cumsum([len(loop) for loop in loops])
    new, number = np.empty((ends[-1], 3), dtype=np.int64), np.empty(ends[-1], dtype=np.int64)
    tree = TriangleTree.from_mesh(mesh, vertices) if careful else TriangleTree.empty()
    count = _fill_all(mesh, vertices, normals, tree, np.concatenate(loops), ends, careful, new, number)
    return new[:count], number[:count]


def with_fillings(mesh: HalfEdges, vertices: Floats, new: Ints, number: Ints) -> tuple[HalfEdges, Ints]:
    """Add fillings of loops without common vertices, but none that cuts; return also the numbers of filled loops."""
    if not len(new):
        return mesh, number
    filled = mesh.changed(new=new)
    first = len(filled.corners()) - len(new)
    cut = cutting(filled, vertices, among=first + np.arange(len(new))) - first
    if len(cut):
        fits = ~np.isin(number, number[cut])
        filled, number = mesh.changed(new=new[fits]), number[fits]
    return filled, np.unique(number)


def boundary_loops(mesh: HalfEdges) -> list[Ints]:
    """Return the boundary loops of a mesh, each as its vertices in the order in which a filling would run around it."""
    edges, loops = mesh.boundary_edges(), []
    ends = mesh.targets()[edges].tolist()
    before = dict(zip(ends, mesh.origin[edges].tolist(), strict=True))
    for v in ends:
        loop = []
        while v in before:
            loop.append(v)
            v = before.pop(v)
        if loop:
            loops.append(np.array(loop))
    return loops


@kernel
def _fill_all(mesh, vertices, normals, tree, corners, ends, careful, new, number):
    """Fill `new` and `number` as `fillings` returns them; return the number of triangles."""
    inside = np.zeros(len(mesh.origin) // 3, dtype=np.bool_)
    halves, _ = room_for_ring()
    begin = count = 0
    for i in range(len(ends)):
        loop = corners[begin : ends[i]]
        begin = ends[i]
        added = fill(mesh, vertices, normals, tree, inside, loop, halves, careful, new[count:])
        number[count : count + added] = i
        count += added
    return count


@kernel
def fill(mesh, vertices, normals, tree, inside, corners, halves, careful, new):
    """Fill `new` with the cheapest triangles that close a loop, (L,), outside of `inside`; return their number or 0."""
    length = len(corners)
    costs, middles = np.full((length, length), np.inf), np.empty((length, length), dtype=np.int64)
    for i in range(length - 1):
        costs[i, i + 1] = 0.0
    for gap in range(2, length):
        for i in range(length - gap):
            k = i + gap
            p, q = corners[i], corners[k]
            if gap < length - 1 and _is_joined(mesh, p, q, inside):
                continue
            for m in range(i + 1, k):
                v = corners[m]
                cost = costs[i, m] + costs[m, k]
                if cost < costs[i, k] and (not careful or _is_upright(vertices, normals, p, v, q)):
                    cost += _cost(vertices, normals, p, v, q)
                    cuts = careful and cost < costs[i, k] and cuts_tree(mesh, vertices, tree, inside, p, v, q)
                    if cost < costs[i, k] and not cuts:
                        costs[i, k], middles[i, k] = cost, m
    if costs[0, length - 1] == np.inf:
        return 0
    count = _trace(corners, middles, new)
    for i in range(count if careful else 0):
        if cuts_earlier(vertices, new, i):
            return 0
    return count if _has_room(mesh, corners, inside, new[:count], halves) else 0


@kernel(allocates=False)
def _is_joined(mesh, p, q, inside):
    """Return whether an edge joins two vertices that a triangle outside the patch has."""
    forth, back = half_edge(mesh, p, q), half_edge(mesh, q, p)
    return (forth >= 0 and not inside[forth // 3]) or (back >= 0 and not inside[back // 3])


@kernel(allocates=False)
def _is_upright(vertices, normals, a, b, c):
    """Return whether a triangle has an area, and lies on the side of the mean of its corners' normals."""
    pa, pb, pc = row(vertices, a), row(vertices, b), row(vertices, c)
    return has_area(pa, pb, pc) and agreement(area_vector(pa, pb, pc), normals, a, b, c) >= 0.0


@kernel(allocates=False)
def _has_room(mesh, corners, inside, new, halves):
    """Return whether no corner of a patch would have too many triangles."""
    for v in corners:
        edges, _ = around(mesh, v, halves)
        count = 0
        for slot in range(edges):
            count += not inside[halves[slot] // 3]
        for t in range(len(new)):
            count += new[t, 0] == v or new[t, 1] == v or new[t, 2] == v
        if count > MAX_VALENCE:
            return False
    return True


@kernel
def _trace(loop, middles, triangles):
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
def _cost(points, normals, a, b, c):
    """Return the cost of a triangle of a filling."""
    pa, pb, pc = row(points, a), row(points, b), row(points, c)
    normal = area_vector(pa, pb, pc)
    doubled = np.sqrt(dot(normal, normal))
    cosine = 1.0
    if doubled > 0.0:
        for v in (a, b, c):
            cosine = min(cosine, dot(normal, row(normals, v)) / doubled)
    ab, ca = minus(pb, pa), minus(pa, pc)
    if not has_area(pa, pb, pc):
        return dot(ab, ab) + dot(ca, ca)  # more than any triangle beside it would cost
    return 0.5 * doubled * (1.0 + BEND * (1.0 - cosine) ** 2) + LENGTH * max(dot(ab, ab), dot(ca, ca))
