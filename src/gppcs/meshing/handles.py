"""Small handles of a mesh, which noise and near sheets make: find them by short loops, cut them, and close both ends.

A loop that does not part the mesh goes around a handle or through it. Two loops are told apart by homology: a tree of
edges and a tree of triangles that crosses other edges leave two edges for each handle (Eppstein 2003). Each closes a
loop across triangles; a code is drawn for each of these, and an edge has the codes of those that cross it. The codes
along a loop of edges cancel out if and only if it parts the mesh, but for an unlikely chance.
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from gppcs.clouds.topology import connected
from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.meshing.coverage import MAX_STEPS, SPAN, Cover
from gppcs.meshing.halfedges import (
    HalfEdges,
    add_to_patch,
    around,
    following,
    half_edge,
    preceding,
    room_for_ring,
    without_bow_ties,
)
from gppcs.spatial.kdtree import KdTree

LONGEST = 7  # edges of a loop along which a handle is cut, at most
RADIAL = 0.4  # minimum mean cosine between normals and the way from the centre of a loop, around bars and in holes


def without_small_handles(
    mesh: HalfEdges, vertices: Floats, normals: Floats, cover_radii: Floats, cover: Cover
) -> HalfEdges:
    """Drop triangles along short loops of handles, but of bars and holes without points; gaps are to be filled."""
    while (codes := _codes(mesh)).any():
        dropped = _beside_loops(mesh, vertices, normals, cover_radii, cover, codes)
        if not dropped.any():
            break
        mesh = without_bow_ties(mesh.changed(~dropped))
    return mesh


def _beside_loops(
    mesh: HalfEdges, vertices: Floats, normals: Floats, cover_radii: Floats, cover: Cover, codes: Ints
) -> Flags:
    """Return which triangles, (F,), are on one side of short loops that together do not part the mesh."""
    dropped, near_cut = np.zeros(len(mesh.corners()), dtype=np.bool_), np.zeros(len(vertices), dtype=np.bool_)
    basis: list[int] = []  # of the codes of the loops that are cut
    holes = set()  # codes of loops in holes: no other loop in these is cut
    tree, side = KdTree.over(cover.points), np.empty(300, dtype=np.int64)
    for padded, code in zip(*_short_loops(mesh, codes), strict=True):
        loop, rest = padded[padded >= 0], int(code)
        for cut in basis:
            rest = min(rest, rest ^ cut)
        if rest == 0 or code in holes:
            continue
        steps = vertices[loop] - vertices[loop].mean(axis=0)
        # The mean cosine between the normals and the way from the centre is 1 on bars, -1 in holes.
        outward = (np.einsum("ij,ij->i", steps, normals[loop]) / np.linalg.norm(steps, axis=1)).mean()
        if outward < RADIAL and _is_in_hole(mesh, vertices, cover_radii, tree, loop, outward):
            holes.add(code)
        elif abs(outward) < RADIAL:
            upright = np.cross(steps, np.roll(steps, -1, axis=0)).sum(axis=0) @ normals[loop].sum(axis=0) >= 0.0
            beside = side[: _list_side(mesh, loop if upright else loop[::-1], side)]
            if not near_cut[mesh.corners()[beside]].any():
                dropped[beside] = near_cut[mesh.corners()[beside]] = True
                basis.append(rest)
    return dropped


def _is_in_hole(
    mesh: HalfEdges, vertices: Floats, cover_radii: Floats, tree: KdTree, loop: Ints, outward: float
) -> bool:
    """Return whether a loop inside the surface has points across it that lie far from the cloud, by its normals."""
    if (mesh.opposite[mesh.leaving[loop]] < 0).any():
        return False
    v, w = np.indices((MAX_STEPS + 1, MAX_STEPS + 1)).reshape(2, -1) / MAX_STEPS
    weights = np.column_stack([1.0 - v - w, v, w])[v + w < 1.0 + 1e-9]
    corners = vertices[np.stack([loop, np.roll(loop, 1)])]
    fan = np.concatenate([np.broadcast_to(vertices[loop].mean(axis=0), (1, *corners.shape[1:])), corners])
    across = np.einsum("pk,kix->pix", weights, fan).reshape(-1, 3)
    _, squared = tree.nearest_of(across, 1)
    bareness = np.sqrt(squared.max()) / cover_radii[loop].mean()
    return bool(bareness + min(-outward / RADIAL, SPAN / 2) >= SPAN)


def _codes(mesh: HalfEdges) -> Ints:
    """Return the code of each half-edge, 0 where no loop of triangles crosses it."""
    n, n_faces = len(mesh.leaving), len(mesh.corners())
    edges = np.flatnonzero(mesh.opposite < np.arange(len(mesh.origin)))  # one half-edge of each
    begins, ends = mesh.origin[edges], mesh.targets()[edges]
    on_boundary = mesh.opposite[edges] < 0
    left, right = edges // 3, mesh.opposite[edges] // 3
    right[on_boundary] = n_faces + connected(begins[on_boundary], ends[on_boundary], n)[1][begins[on_boundary]]
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
    codes[edges], codes[mesh.opposite[edges[~on_boundary]]] = code, code[~on_boundary]
    return codes


def _forest(begins: Ints, ends: Ints, n: int) -> tuple[Ints, Ints]:
    """Return the nodes of trees that span a graph, from the roots on, and the node above each; n is above the roots."""
    roots = np.flatnonzero(np.diff(np.maximum.accumulate(connected(begins, ends, n)[1]), prepend=-1))
    sources, targets = np.append(begins, np.full(len(roots), n)), np.append(ends, roots)
    graph = coo_array((np.ones(len(sources)), (sources, targets)), shape=(n + 1, n + 1))
    return breadth_first_order(graph.tocsr(), n, directed=False)


def _in_forest(begins: Ints, ends: Ints, above: Ints) -> Flags:
    """Return which edges of a graph, no two between the same nodes, are in a forest."""
    return (above[begins] == ends) | (above[ends] == begins)


@kernel(allocates=False)
def _add_up(order, above, sums):
    """Add to the sum of each node, (nodes,), those of the nodes below it."""
    for node in order[:0:-1]:
        sums[above[node]] ^= sums[node]


def _short_loops(mesh: HalfEdges, codes: Ints) -> tuple[Ints, Ints]:
    """Return short loops that do not part the mesh, (L, LONGEST), the shortest first, and the sums of their codes."""
    bases = np.unique(mesh.origin[codes != 0])
    loops, along = np.full((len(bases), LONGEST), -1), np.zeros(len(bases), dtype=np.int64)
    _find_loops(mesh, codes, bases, loops, along)
    closed = np.flatnonzero(loops[:, 0] >= 0)
    order = closed[np.argsort((loops[closed] >= 0).sum(axis=1), kind="stable")]
    return loops[order], along[order]


@kernel
def _find_loops(mesh, codes, bases, loops, along):
    """Fill `loops`, (m, LONGEST), with the shortest loop that does not part the mesh, from each base, (m,)."""
    n = len(mesh.leaving)
    depth, parent = np.full(n, -1), np.full(n, -1)
    sums, queue = np.zeros(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    halves, _ = room_for_ring()
    for i in range(len(bases)):
        queue[0], begin, end = bases[i], 0, 1
        depth[bases[i]], sums[bases[i]], parent[bases[i]] = 0, 0, -1
        shortest, p, q = LONGEST + 1, -1, -1
        while begin < end:
            v = queue[begin]
            begin += 1
            if 2 * depth[v] + 1 >= shortest:
                break
            edges, is_closed = around(mesh, v, halves)
            for slot in range(edges + (not is_closed)):
                h = halves[slot] if slot < edges else preceding(halves[edges - 1])
                w = mesh.origin[following(h)] if slot < edges else mesh.origin[h]
                if depth[w] < 0:
                    depth[w], sums[w], parent[w] = depth[v] + 1, sums[v] ^ codes[h], v
                    queue[end] = w
                    end += 1
                elif sums[w] != sums[v] ^ codes[h] and depth[v] + depth[w] + 1 < shortest:
                    shortest, p, q = depth[v] + depth[w] + 1, v, w
                    along[i] = sums[v] ^ sums[w] ^ codes[h]
        if p >= 0:
            _trace(parent, depth, p, q, loops[i])
        for slot in range(end):
            depth[queue[slot]] = -1


@kernel
def _trace(parent, depth, p, q, loop):
    """Fill `loop`, (LONGEST,), with the vertices from p up to where its way meets that of q, and down to q."""
    up, down = 0, len(loop)
    while p != q:
        if depth[p] >= depth[q]:
            loop[up] = p
            up, p = up + 1, parent[p]
        else:
            down -= 1
            loop[down], q = q, parent[q]
    loop[up] = p
    below = loop[down:].copy()
    loop[up + 1 : up + 1 + len(below)] = below
    loop[up + 1 + len(below) :] = -1


@kernel(allocates=False)
def _list_side(mesh, loop, side):
    """List the triangles to the left of a loop that have a vertex of it; return their number."""
    size = 0
    for i in range(len(loop)):
        before, after = loop[i - 1], loop[(i + 1) % len(loop)]
        h = half_edge(mesh, loop[i], after)
        while h >= 0 and mesh.origin[following(h)] != before:
            size = add_to_patch(side, size, h // 3)
            h = mesh.opposite[preceding(h)]
        h = half_edge(mesh, before, loop[i])
        while h >= 0 and mesh.origin[h] != after:
            size = add_to_patch(side, size, h // 3)
            h = mesh.opposite[following(h)]
    return size
