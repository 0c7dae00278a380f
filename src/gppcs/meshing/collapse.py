"""Remove vertices by half-edge collapses, the cheapest first (Garland and Heckbert 1997, with the points' quadrics)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.meshing.halfedges import (
    MOST_AROUND,
    Flags,
    Floats,
    HalfEdges,
    Ints,
    around,
    following,
    leave_by,
    neighbours,
    preceding,
)
from gppcs.spatial.triangles import area_vector, dot, has_area, minus, quality, row
from gppcs.surface.error_quadrics import add_moved, value

TURN = 0.2  # least cosine between a triangle's normals before and after, in the first pass
THIN_IN_COLLAPSE = 0.3  # triangles below this quality cost extra
EXTRA = 1e-2  # that cost, in squared edges for each unit of quality and each dense point of a vertex
AT_ONCE = 16_384  # collapses until progress is reported


def collapse(
    mesh: HalfEdges,
    vertices: Floats,
    normals: Floats,
    quadrics: Floats,
    target: int,
    kept: Flags,
    density: float,
    faces: bool = False,
    advanced: Callable[[int], None] | None = None,
) -> Ints:
    """Remove vertices until few enough are left, each by moving its triangles to a neighbour.

    The cost of a collapse is the sum of the two quadrics at the neighbour. Only collapses are made that keep the mesh
    an oriented manifold of the same topology (the link condition), and that turn no triangle over. If the target is
    not reached, a second pass drops the limit on turns.
    """
    into = np.arange(len(vertices))
    costs = np.full(len(vertices), np.inf)
    winner = np.empty(2 * len(vertices), dtype=np.int64)
    for limit in (TURN, -2.0):
        _start(mesh, vertices, quadrics, kept, costs, winner)
        while True:
            left = mesh.faces().shape[0] if faces else np.count_nonzero(mesh.leaving >= 0)
            if left <= target:
                return ends(into)
            steps = min(AT_ONCE, -(-(left - target) // 2) if faces else left - target)
            removed = _collapse_some(
                mesh, vertices, normals, quadrics, kept, EXTRA * density, limit, steps, costs, winner, into
            )
            if advanced:
                advanced(removed)
            if removed == 0:
                break
    return ends(into)


def ends(into: Ints) -> Ints:
    """Return where each vertex went in the end."""
    while not np.array_equal(further := into[into], into):
        into = further
    return into


@kernel
def _start(mesh, vertices, quadrics, kept, costs, winner):
    """Fill the costs, (V,), and the tournament tree `winner`, (2 V,): vertex v is at V + v, and the cheapest at 1."""
    n = len(costs)
    halves, found = np.empty(MOST_AROUND, dtype=np.int64), np.empty(MOST_AROUND + 1, dtype=np.int64)
    for v in range(n):
        costs[v] = np.inf if kept[v] else _least_cost(mesh, vertices, quadrics, v, halves, found)
        winner[n + v] = v
    for node in range(n - 1, 0, -1):
        a, b = winner[2 * node], winner[2 * node + 1]
        winner[node] = b if costs[b] < costs[a] else a


@kernel(allocates=False)
def _play(costs, winner, v):
    """Update the tournament tree after the cost of a vertex has changed."""
    node = (len(costs) + v) // 2
    while node:
        a, b = winner[2 * node], winner[2 * node + 1]
        best = b if costs[b] < costs[a] else a
        if best == winner[node] != v:  # nothing changes above, either
            return
        winner[node] = best
        node //= 2


@kernel(allocates=False)
def _least_cost(mesh, vertices, quadrics, v, halves, found):
    """Return the cost of the cheapest collapse of a vertex, whether it is allowed or not."""
    count, _, _ = neighbours(mesh, v, halves, found)
    least = np.inf
    for slot in range(count):
        u = found[slot]
        least = min(least, value(quadrics[v], minus(row(vertices, u), row(vertices, v))) + quadrics[u, 9])
    return least


@kernel
def _collapse_some(mesh, vertices, normals, quadrics, kept, extra, limit, steps, costs, winner, into):
    """Remove at most `steps` vertices; return how many were removed."""
    halves, found = np.empty(MOST_AROUND, dtype=np.int64), np.empty(MOST_AROUND + 1, dtype=np.int64)
    others, beyond = np.empty(MOST_AROUND, dtype=np.int64), np.empty(MOST_AROUND + 1, dtype=np.int64)
    removed = 0
    while removed < steps:
        v = winner[1]
        if costs[v] == np.inf:
            break
        cost, u = _best(mesh, vertices, normals, quadrics, extra, limit, v, halves, found, others, beyond)
        if cost > costs[v]:  # what was known is a lower bound
            costs[v] = cost
            _play(costs, winner, v)
            if winner[1] != v or cost == np.inf:
                continue
        add_moved(quadrics[v], minus(row(vertices, u), row(vertices, v)), quadrics[u])
        move_triangles(mesh, v, u, halves)
        into[v] = u
        removed += 1
        costs[v] = np.inf
        _play(costs, winner, v)
        count, _, _ = neighbours(mesh, u, halves, found)
        for slot in range(count + 1):
            w = u if slot == count else found[slot]
            if not kept[w]:
                costs[w] = _least_cost(mesh, vertices, quadrics, w, others, beyond)
                _play(costs, winner, w)
    return removed


@kernel(allocates=False)
def _best(mesh, vertices, normals, quadrics, extra, limit, v, halves, found, others, beyond):
    """Return the cost and the neighbour of the cheapest collapse of v that is allowed; infinity and -1 if none is."""
    count, edges, closed = neighbours(mesh, v, halves, found)
    best, target = np.inf, -1
    for slot in range(count):
        u = found[slot]
        cost = value(quadrics[v], minus(row(vertices, u), row(vertices, v))) + quadrics[u, 9]
        if cost >= best or not is_allowed(mesh, v, slot, count, edges, closed, halves, found, others, beyond):
            continue
        cost += extra * thinness_after(mesh, vertices, normals, limit, v, u, edges, halves)
        if cost < best:
            best, target = cost, u
    return best, target


@kernel(allocates=False)
def is_allowed(mesh, v, slot, count, edges, closed, halves, found, others, beyond):
    """Return whether a collapse keeps the topology: the link condition, and no triangle or vertex left hanging."""
    u = found[slot]
    count_u, edges_u, closed_u = neighbours(mesh, u, others, beyond)
    on_left = slot < edges  # is there a triangle to the left of the edge from v to u
    on_right = closed or slot > 0
    if on_left and on_right and not closed and not closed_u:  # the edge would pinch the surface between two borders
        return False
    common = 0
    for i in range(count):
        for j in range(count_u):
            if found[i] == beyond[j]:
                common += 1
                break
    if common != on_left + on_right or edges + edges_u - 2 * common > MOST_AROUND:
        return False
    if closed and closed_u and edges == 3 and edges_u == 3:  # a tetrahedron
        return False
    if on_left and _is_ear(mesh, halves[slot]):
        return False
    return not (on_right and _is_ear(mesh, preceding(halves[slot - 1 if slot > 0 else edges - 1])))


@kernel(allocates=False)
def _is_ear(mesh, h):
    """Return whether the other two edges of the triangle of a half-edge are both on a border."""
    return mesh.opposite[following(h)] < 0 and mesh.opposite[preceding(h)] < 0


@kernel(allocates=False)
def thinness_after(mesh, vertices, normals, limit, v, u, edges, halves):
    """Return how thin the triangles would be that a collapse moves."""
    total = 0.0
    pu, pv = row(vertices, u), row(vertices, v)
    for slot in range(edges):
        a, b = mesh.origin[following(halves[slot])], mesh.origin[preceding(halves[slot])]
        if a == u or b == u:
            continue
        pa, pb = row(vertices, a), row(vertices, b)
        before, after = area_vector(pv, pa, pb), area_vector(pu, pa, pb)
        length = np.sqrt(dot(after, after))
        au, bu, ab = minus(pa, pu), minus(pb, pu), minus(pb, pa)
        squared = dot(au, au) + dot(bu, bu) + dot(ab, ab)
        if not has_area(pu, pa, pb):
            return np.inf
        if limit >= -1.0:
            if dot(before, after) < limit * np.sqrt(dot(before, before)) * length:
                return np.inf
            if dot(after, row(normals, u)) + dot(after, row(normals, a)) + dot(after, row(normals, b)) < 0.0:
                return np.inf
        thin = THIN_IN_COLLAPSE - quality(pu, pa, pb)
        if thin > 0.0:
            total += thin * squared
    return total


@kernel(allocates=False)
def move_triangles(mesh, v, u, halves):
    """Move the triangles around v to its neighbour u, and remove those that have both."""
    edges, _ = around(mesh, v, halves)
    forth = back = -1  # the half-edges from v to u and from u to v
    for slot in range(edges):
        if mesh.origin[following(halves[slot])] == u:
            forth = halves[slot]
        if mesh.origin[preceding(halves[slot])] == u:
            back = preceding(halves[slot])
    for slot in range(edges):
        mesh.origin[halves[slot]] = u
    mesh.leaving[v] = -1
    first = third = leaving_first = leaving_third = leaving_u = -1
    for h in (forth, back):
        if h < 0:
            continue
        x, y = mesh.opposite[following(h)], mesh.opposite[preceding(h)]
        if x >= 0:
            mesh.opposite[x] = y
        if y >= 0:
            mesh.opposite[y] = x
        first, leaving_first = third, leaving_third
        third = mesh.origin[preceding(h)]
        leaving_third = x if x >= 0 else following(y)
        leaving_u = y if y >= 0 else following(x)
        mesh.origin[h] = mesh.origin[following(h)] = mesh.origin[preceding(h)] = -1
    leave_by(mesh, u, leaving_u)
    leave_by(mesh, third, leaving_third)
    if first >= 0:
        leave_by(mesh, first, leaving_first)
