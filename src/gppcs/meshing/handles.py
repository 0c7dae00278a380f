"""Small handles of a mesh, which noise and near sheets make: find them by short loops, cut them, and close both ends.

A loop that does not part the mesh goes around a handle or through it. Two loops are told apart by homology: a tree of
edges and a tree of triangles that crosses other edges leave two edges for each handle (Eppstein 2003). Each closes a
loop across triangles; a code is drawn for each of these, and an edge has the codes of those that cross it. The codes
along a loop of edges cancel out if and only if it parts the mesh, but for an unlikely chance.
"""

from __future__ import annotations

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.meshing.halfedges import MOST_AROUND, Floats, HalfEdges, Ints, around, following, preceding
from gppcs.spatial.triangles import area_vector, dot, minus, row, unit

LONGEST = 7  # edges of a loop along which a handle is cut, at most
MOST_TRIANGLES = 300  # that a cut takes
RADIAL = 0.4  # least mean cosine between normals and the way from the centre of a loop, around bars and in holes
ROUNDS = 8  # of cuts at most


def without_small_handles(faces: Ints, vertices: Floats, normals: Floats) -> Ints:
    """Leave out triangles along short loops that go around or through handles; the gaps are to be filled."""
    for _ in range(ROUNDS):
        mesh = HalfEdges.of(faces, len(vertices))
        codes = _codes(mesh)
        if not codes.any():
            break
        left_out = np.zeros(len(faces), dtype=np.bool_)
        _cut_all(mesh, vertices, normals, codes, _short_loops(mesh, codes), left_out)
        if not left_out.any():
            break
        faces = faces[~left_out]
    return faces


def _codes(mesh: HalfEdges) -> Ints:
    """Return the code of each half-edge, 0 where no loop of triangles crosses it."""
    size, rings = len(mesh.origin), np.full(len(mesh.origin), -1)
    nodes = size // 3 + _number_rings(mesh, rings)
    inner = np.zeros(size, dtype=np.bool_)
    _grow_tree(mesh, inner)
    above, across, order = np.full(nodes, -1), np.full(nodes, -1), np.empty(nodes, dtype=np.int64)
    codes, left = np.zeros(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    left = left[: _grow_dual_tree(mesh, rings, inner, above, across, order, left)]
    if len(left):
        drawn = np.random.default_rng(0).integers(1, 2**62, size=len(left))
        _spread_codes(mesh, rings, above, across, order, left, drawn, codes)
    return codes


@kernel(allocates=False)
def _number_rings(mesh, rings):
    """Fill `rings`, (3 F,), with the number of the border at each half-edge; return how many there are."""
    count = 0
    for first in range(len(mesh.origin)):
        if mesh.opposite[first] >= 0 or rings[first] >= 0:
            continue
        h = first
        while rings[h] < 0:
            rings[h] = count
            h = mesh.leaving[mesh.origin[following(h)]]
        count += 1
    return count


@kernel
def _grow_tree(mesh, inner):
    """Mark in `inner`, (3 F,), the half-edges of a tree of edges in each piece."""
    n = len(mesh.leaving)
    seen, queue = np.zeros(n, dtype=np.bool_), np.empty(n, dtype=np.int64)
    halves = np.empty(MOST_AROUND, dtype=np.int64)
    for root in range(n):
        if seen[root] or mesh.leaving[root] < 0:
            continue
        seen[root] = True
        queue[0], head, tail = root, 0, 1
        while head < tail:
            v = queue[head]
            head += 1
            edges, is_closed = around(mesh, v, halves)
            for slot in range(edges + (not is_closed)):
                h = halves[slot] if slot < edges else preceding(halves[edges - 1])
                w = mesh.origin[following(h)] if slot < edges else mesh.origin[h]
                if not seen[w]:
                    seen[w] = True
                    queue[tail] = w
                    tail += 1
                    inner[h] = True
                    if mesh.opposite[h] >= 0:
                        inner[mesh.opposite[h]] = True


@kernel(allocates=False)
def _node_across(mesh, rings, h):
    """Return the node of the dual tree beyond a half-edge: a triangle, or a border after all triangles."""
    return mesh.opposite[h] // 3 if mesh.opposite[h] >= 0 else len(mesh.origin) // 3 + rings[h]


@kernel
def _grow_dual_tree(mesh, rings, inner, above, across, order, left):
    """Fill a tree of triangles and borders in each piece, and list the half-edges that neither tree has.

    `above`, (nodes,), is the node above each, -1 for a root; `across` the half-edge between them; `order` has the nodes
    from the roots on. Return the number of half-edges in `left`.
    """
    size = len(mesh.origin)
    seen, used = np.zeros(len(above), dtype=np.bool_), inner.copy()
    first = np.full(len(above) - size // 3, -1)
    for h in range(size):
        if mesh.opposite[h] < 0:
            first[rings[h]] = h
    head = tail = 0
    for root in range(size // 3):
        if seen[root]:
            continue
        seen[root] = True
        order[tail] = root
        tail += 1
        while head < tail:
            node = order[head]
            head += 1
            h = 3 * node if node < size // 3 else first[node - size // 3]
            begin = h
            while True:
                other = _node_across(mesh, rings, h) if node < size // 3 else h // 3
                if not used[h] and not seen[other]:
                    seen[other] = True
                    above[other], across[other] = node, h
                    order[tail] = other
                    tail += 1
                    used[h] = True
                    if mesh.opposite[h] >= 0:
                        used[mesh.opposite[h]] = True
                h = following(h) if node < size // 3 else mesh.leaving[mesh.origin[following(h)]]
                if h == begin:
                    break
    count = 0
    for h in range(size):
        if not used[h] and h > mesh.opposite[h]:
            left[count] = h
            count += 1
    return count


@kernel
def _spread_codes(mesh, rings, above, across, order, left, drawn, codes):
    """Fill the codes of half-edges: those drawn for the ones that are left, and along their ways up the dual tree."""
    sums = np.zeros(len(above), dtype=np.int64)
    for i in range(len(left)):
        codes[left[i]] = drawn[i]
        sums[left[i] // 3] ^= drawn[i]
        sums[_node_across(mesh, rings, left[i])] ^= drawn[i]
    for node in order[::-1]:
        if above[node] >= 0:
            codes[across[node]] = sums[node]
            sums[above[node]] ^= sums[node]
    for h in range(len(codes)):
        if mesh.opposite[h] >= 0:
            codes[h] = codes[mesh.opposite[h]] = codes[h] | codes[mesh.opposite[h]]


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
    depth, sums, parent, queue = (
        np.full(n, -1),
        np.zeros(n, dtype=np.int64),
        np.full(n, -1),
        np.empty(n, dtype=np.int64),
    )
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
def _cut_all(mesh, vertices, normals, codes, loops, left_out):
    """Mark in `left_out`, (F,), the triangles on one side of loops that together do not part the mesh."""
    basis, near_cut = np.zeros(64, dtype=np.int64), np.zeros(len(mesh.leaving), dtype=np.bool_)
    halves, side = np.empty(MOST_AROUND, dtype=np.int64), np.empty(MOST_TRIANGLES, dtype=np.int64)
    for padded in loops:
        loop = padded[padded >= 0]
        code = _reduced(basis, _code_along(mesh, codes, loop, halves))
        if code == 0 or _is_around_tube(vertices, normals, loop):
            continue
        size = _side_of(mesh, loop if _is_upright(vertices, normals, loop) else loop[::-1], halves, side)
        if not _is_apart(mesh, near_cut, side[:size]):
            continue
        for f in side[:size]:
            left_out[f] = True
        for f in side[: _with_smaller_fans(mesh, left_out, halves, side, size)]:
            for k in range(3):
                near_cut[mesh.origin[3 * f + k]] = True
        _keep(basis, code)


@kernel(allocates=False)
def _is_around_tube(vertices, normals, loop):
    """Return whether normals along a loop point away from its centre, as on a bar, or to it, as in a drilled hole."""
    x = y = z = total = 0.0
    for v in loop:
        x, y, z = x + vertices[v, 0] / len(loop), y + vertices[v, 1] / len(loop), z + vertices[v, 2] / len(loop)
    for v in loop:
        total += dot(unit(minus(row(vertices, v), (x, y, z))), row(normals, v))
    return abs(total) >= RADIAL * len(loop)


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
def _with_smaller_fans(mesh, left_out, halves, side, size):
    """Add to the triangles of a cut all but the largest fan of the others at each vertex; return their number."""
    i = 0
    while i < size:
        for k in range(3):
            v = mesh.origin[3 * side[i] + k]
            edges, is_closed = around(mesh, v, halves)
            begin, longest = _longest_run(left_out, halves, edges, is_closed)
            for slot in range(longest, edges):
                f = halves[(begin + slot) % edges] // 3
                if not left_out[f] and size < len(side):
                    left_out[f] = True
                    side[size] = f
                    size += 1
        i += 1
    return size


@kernel(allocates=False)
def _longest_run(left_out, halves, edges, is_closed):
    """Return where the longest run of triangles that are in no cut begins around a vertex, and its length."""
    best = longest = length = 0
    for slot in range(2 * edges if is_closed else edges):
        length = 0 if left_out[halves[slot % edges] // 3] else length + 1
        if length > longest and length <= edges:
            best, longest = slot - length + 1, length
    return best % max(1, edges), longest


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
            size = _with(side, size, h // 3)
            h = mesh.opposite[preceding(h)]
        h = _half_edge(mesh, before, loop[i], halves)
        while h >= 0 and mesh.origin[h] != after:
            size = _with(side, size, h // 3)
            h = mesh.opposite[following(h)]
    return size


@kernel(allocates=False)
def _with(side, size, f):
    """Add a triangle to a list of some size unless it is there, or the list is full; return the new size."""
    for slot in range(size):
        if side[slot] == f:
            return size
    if size < len(side):
        side[size] = f
        return size + 1
    return size
