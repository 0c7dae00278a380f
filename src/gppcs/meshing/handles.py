"""Small handles of a mesh, which noise and near sheets make: find them by short loops, cut them, and close both ends.

A loop that does not part the mesh goes around a handle or through it. Two loops are told apart by homology: a tree of
edges and a tree of triangles that crosses other edges leave two edges for each handle (Eppstein 2003). Each closes a
loop across triangles; a code is drawn for each of these, and an edge has the codes of those that cross it. The codes
along a loop of edges cancel out if and only if it parts the mesh, but for an unlikely chance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from gppcs.clouds.topology import connected
from gppcs.engine.kernels import kernel
from gppcs.meshing.coverage import MOST_STEPS, SPAN, Cover
from gppcs.meshing.halfedges import (
    MOST_AROUND,
    Floats,
    HalfEdges,
    Ints,
    add_triangle,
    around,
    following,
    preceding,
    without_bow_ties,
)
from gppcs.spatial.kdtree import nearest_in_tree
from gppcs.spatial.triangles import area_vector, dot, minus, row, unit

LONGEST = 7  # edges of a loop along which a handle is cut, at most
MOST_TRIANGLES = 300  # that a cut takes
RADIAL = 0.4  # least mean cosine between normals and the way from the centre of a loop, around bars and in holes


def without_small_handles(faces: Ints, vertices: Floats, normals: Floats, reaches: Floats, cover: Cover) -> Ints:
    """Leave out triangles along short loops that go around or through handles; the gaps are to be filled.

    The mesh has no bow ties, before and after. A round cuts as many handles as a code has bits, at most. Bars stay, and
    holes that the dense points of the cover leave open; `reaches`, (n,), is how far each vertex covers the surface.
    """
    while (codes := _codes(mesh := HalfEdges.of(faces, len(vertices)))).any():
        left_out = np.zeros(len(faces), dtype=np.bool_)
        _cut_all(mesh, vertices, normals, reaches, cover, codes, _short_loops(mesh, codes), left_out)
        if not left_out.any():
            break
        faces = without_bow_ties(faces[~left_out], len(vertices))
    return faces


def _codes(mesh: HalfEdges) -> Ints:
    """Return the code of each half-edge, 0 where no loop of triangles crosses it."""
    n, n_faces = len(mesh.leaving), len(mesh.origin) // 3
    edges = np.flatnonzero(mesh.opposite < np.arange(len(mesh.origin)))  # one half-edge of each
    begins, ends = mesh.origin[edges], np.roll(mesh.origin.reshape(-1, 3), -1, axis=1).ravel()[edges]
    on_border = mesh.opposite[edges] < 0
    left, right = edges // 3, mesh.opposite[edges] // 3
    right[on_border] = n_faces + connected(begins[on_border], ends[on_border], n)[1][begins[on_border]]
    across = np.flatnonzero(~_in_forest(begins, ends, _forest(begins, ends, n)[1]))
    order, above = _forest(left[across], right[across], n_faces + n)
    below = _in_forest(left[across], right[across], above)
    drawn, crossed = across[~below], across[below]
    code, sums = np.zeros(len(edges), dtype=np.int64), np.zeros(len(above), dtype=np.int64)
    code[drawn] = np.random.default_rng(0).integers(1, 2**62, size=len(drawn))
    for nodes in (left, right):
        np.bitwise_xor.at(sums, nodes[drawn], code[drawn])
    _add_up(order, above, sums)
    code[crossed] = sums[np.where(above[left[crossed]] == right[crossed], left[crossed], right[crossed])]
    codes = np.zeros(len(mesh.origin), dtype=np.int64)
    codes[edges], codes[mesh.opposite[edges[~on_border]]] = code, code[~on_border]
    return codes


def _forest(begins: Ints, ends: Ints, n: int) -> tuple[Ints, Ints]:
    """Return the nodes of trees that span a graph, from the roots on, and the node above each; n is above the roots."""
    roots = np.unique(connected(begins, ends, n)[1], return_index=True)[1]
    rows, columns = np.append(begins, np.full(len(roots), n)), np.append(ends, roots)
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(n + 1, n + 1))
    return breadth_first_order(graph.tocsr(), n, directed=False)


def _in_forest(begins: Ints, ends: Ints, above: Ints) -> NDArray[np.bool_]:
    """Return which edges of a graph, no two between the same nodes, are in a forest."""
    return (above[begins] == ends) | (above[ends] == begins)


@kernel(allocates=False)
def _add_up(order, above, sums):
    """Add to the sum of each node, (nodes,), those of the nodes below it."""
    for node in order[:0:-1]:
        sums[above[node]] ^= sums[node]


def _short_loops(mesh: HalfEdges, codes: Ints) -> Ints:
    """Return short loops that do not part the mesh, the shortest first: their vertices, (L, LONGEST), -1 after them."""
    bases = np.unique(mesh.origin[codes != 0])
    loops = np.full((len(bases), LONGEST), -1)
    _find_loops(mesh, codes, bases, loops)
    loops = loops[loops[:, 0] >= 0]
    return loops[np.argsort((loops >= 0).sum(axis=1), kind="stable")]


@kernel
def _find_loops(mesh, codes, bases, loops):
    """Fill `loops`, (m, LONGEST), with the shortest loop that does not part the mesh, from each base, (m,)."""
    n = len(mesh.leaving)
    depth, parent = np.full(n, -1), np.full(n, -1)
    sums, queue = np.zeros(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    halves = np.empty(MOST_AROUND, dtype=np.int64)
    for i in range(len(bases)):
        queue[0], head, tail = bases[i], 0, 1
        depth[bases[i]], sums[bases[i]], parent[bases[i]] = 0, 0, -1
        least, p, q = LONGEST + 1, -1, -1
        while head < tail:
            v = queue[head]
            head += 1
            if 2 * depth[v] + 1 >= least:
                break
            edges, is_closed = around(mesh, v, halves)
            for slot in range(edges + (not is_closed)):
                h = halves[slot] if slot < edges else preceding(halves[edges - 1])
                w = mesh.origin[following(h)] if slot < edges else mesh.origin[h]
                if depth[w] < 0:
                    depth[w], sums[w], parent[w] = depth[v] + 1, sums[v] ^ codes[h], v
                    queue[tail] = w
                    tail += 1
                elif sums[w] != sums[v] ^ codes[h] and depth[v] + depth[w] + 1 < least:
                    least, p, q = depth[v] + depth[w] + 1, v, w
        if p >= 0:
            _trace(parent, depth, p, q, loops[i])
        for slot in range(tail):
            depth[queue[slot]] = -1


@kernel(allocates=False)
def _trace(parent, depth, p, q, loop):
    """Fill `loop`, (LONGEST,), with the vertices from p up to where its way meets that of q, and down to q."""
    up, down = 0, len(loop)
    while p != q:
        if depth[p] >= depth[q]:
            loop[up] = p
            up += 1
            p = parent[p]
        else:
            down -= 1
            loop[down] = q
            q = parent[q]
    loop[up] = p
    up += 1
    for slot in range(down, len(loop)):
        loop[up + slot - down] = loop[slot]
    for slot in range(up + len(loop) - down, len(loop)):
        loop[slot] = -1


@kernel
def _cut_all(mesh, vertices, normals, reaches, cover, codes, loops, left_out):
    """Mark in `left_out`, (F,), the triangles on one side of loops that together do not part the mesh."""
    basis, near_cut = np.zeros(64, dtype=np.int64), np.zeros(len(mesh.leaving), dtype=np.bool_)
    holes = {np.int64(0)}  # codes of loops in holes: no other loop in these is cut
    halves, side = np.empty(MOST_AROUND, dtype=np.int64), np.empty(MOST_TRIANGLES, dtype=np.int64)
    for padded in loops:
        loop = padded[padded >= 0]
        along = _code_along(mesh, codes, loop, halves)
        code = _reduced(basis, along)
        if code == 0 or along in holes:
            continue
        outward = _outward(vertices, normals, loop)
        if outward < RADIAL and _is_in_hole(mesh, vertices, reaches, cover, loop, outward, halves):
            holes.add(along)
            continue
        if abs(outward) >= RADIAL:
            continue
        size = _side_of(mesh, loop if _is_upright(vertices, normals, loop) else loop[::-1], halves, side)
        if not _is_apart(mesh, near_cut, side[:size]):
            continue
        for f in side[:size]:
            left_out[f] = True
            for k in range(3):
                near_cut[mesh.origin[3 * f + k]] = True
        _keep(basis, code)


@kernel(allocates=False)
def _centre(vertices, loop):
    """Return the mean of the vertices of a loop."""
    x = y = z = 0.0
    for v in loop:
        x, y, z = x + vertices[v, 0] / len(loop), y + vertices[v, 1] / len(loop), z + vertices[v, 2] / len(loop)
    return x, y, z


@kernel(allocates=False)
def _outward(vertices, normals, loop):
    """Return the mean cosine between the normals along a loop and the way from its centre: 1 on bars, -1 in holes."""
    centre, total = _centre(vertices, loop), 0.0
    for v in loop:
        total += dot(unit(minus(row(vertices, v), centre)), row(normals, v))
    return total / len(loop)


@kernel
def _is_in_hole(mesh, vertices, reaches, cover, loop, outward, halves):
    """Return whether a loop, away from borders, runs in a hole: a place across it lies far from all points.

    SPAN reaches are enough, half of them where normals point into the hole. Across a bridge lie points of the sheets.
    """
    for v in loop:
        if not around(mesh, v, halves)[1]:
            return False
    return _bareness(vertices, reaches, cover, loop) + min(-outward / RADIAL, SPAN / 2) >= SPAN


@kernel
def _bareness(vertices, reaches, cover, loop):
    """Return how far the barest place across a loop is from all dense points, in reaches of the vertices."""
    (x, y, z), reach, largest = _centre(vertices, loop), 0.0, 0.0
    found, squared = np.empty(1, dtype=np.int64), np.empty(1)
    for i in range(len(loop)):
        a, b = minus(row(vertices, loop[i - 1]), (x, y, z)), minus(row(vertices, loop[i]), (x, y, z))
        reach += reaches[loop[i]] / len(loop)
        for j in range(MOST_STEPS + 1):
            for k in range(MOST_STEPS + 1 - j):
                v, w = j / MOST_STEPS, k / MOST_STEPS
                p, q, r = x + v * a[0] + w * b[0], y + v * a[1] + w * b[1], z + v * a[2] + w * b[2]
                nearest_in_tree(cover.points, cover.low, cover.high, p, q, r, found, squared)
                largest = max(largest, squared[0])
    return np.sqrt(largest) / reach


@kernel(allocates=False)
def _is_upright(vertices, normals, loop):
    """Return whether the normals of a loop turn it counter-clockwise, as a filling on its left would."""
    total = 0.0
    for i in range(1, len(loop) - 1):
        up = area_vector(row(vertices, loop[0]), row(vertices, loop[i]), row(vertices, loop[i + 1]))
        for v in loop:
            total += dot(up, row(normals, v))
    return total >= 0.0


@kernel(allocates=False)
def _is_apart(mesh, near_cut, side):
    """Return whether no vertex of some triangles is near an earlier cut."""
    for f in side:
        for k in range(3):
            if near_cut[mesh.origin[3 * f + k]]:
                return False
    return True


@kernel(allocates=False)
def _reduced(basis, code):
    """Return a code less those of a basis, (64,), that have its bits: 0 if it is the sum of some of these."""
    for bit in range(63, -1, -1):
        if code >> bit & 1 and basis[bit]:
            code ^= basis[bit]
    return code


@kernel(allocates=False)
def _keep(basis, code):
    """Add a code that `_reduced` returned to a basis, (64,)."""
    for bit in range(63, -1, -1):
        if code >> bit & 1:
            basis[bit] = code
            return


@kernel(allocates=False)
def _half_edge(mesh, v, w, halves):
    """Return the half-edge from a vertex to another, -1 if there is none."""
    edges, _ = around(mesh, v, halves)
    for slot in range(edges):
        if mesh.origin[following(halves[slot])] == w:
            return halves[slot]
    return -1


@kernel(allocates=False)
def _code_along(mesh, codes, loop, halves):
    """Return the sum of the codes along a loop."""
    code = 0
    for i in range(len(loop)):
        v, w = loop[i], loop[(i + 1) % len(loop)]
        h = _half_edge(mesh, v, w, halves)
        code ^= codes[h if h >= 0 else _half_edge(mesh, w, v, halves)]
    return code


@kernel(allocates=False)
def _side_of(mesh, loop, halves, side):
    """List the triangles to the left of a loop that have a vertex of it; return their number."""
    size = 0
    for i in range(len(loop)):
        before, after = loop[i - 1], loop[(i + 1) % len(loop)]
        h = _half_edge(mesh, loop[i], after, halves)
        while h >= 0 and mesh.origin[following(h)] != before:
            size = add_triangle(side, size, h // 3)
            h = mesh.opposite[preceding(h)]
        h = _half_edge(mesh, before, loop[i], halves)
        while h >= 0 and mesh.origin[h] != after:
            size = add_triangle(side, size, h // 3)
            h = mesh.opposite[following(h)]
    return size
