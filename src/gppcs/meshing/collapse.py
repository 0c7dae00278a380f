"""Remove vertices by half-edge collapses, the cheapest first (Garland and Heckbert 1997, with the points' quadrics)."""

from collections.abc import Callable

import numpy as np

from gppcs.engine.arrays import Ints
from gppcs.engine.kernels import kernel
from gppcs.meshing.draft import Draft
from gppcs.meshing.energy import add_boundaries
from gppcs.meshing.halfedges import (
    MAX_VALENCE,
    around,
    following,
    half_edge,
    neighbours,
    position_of,
    preceding,
    replace_triangles,
    room_for_ring,
)
from gppcs.spatial.triangles import agreement, area_vector, dot, has_area, minus, quality, row
from gppcs.surface.error_quadrics import NUMBERS, add_moved, add_plane, value


def collapse(
    draft: Draft, target: int, counts_faces: bool = False, on_progress: Callable[[int], None] | None = None
) -> None:
    """Remove vertices, the lowest sum of two quadrics first, where that keeps the topology and turns no triangle."""
    mesh, vertices, dense = draft.mesh, draft.vertices, draft.dense
    density = len(draft.nearest) / draft.n_vertices
    quadrics = dense_quadrics(dense.positions, dense.normals, vertices, draft.nearest)
    add_boundaries(mesh, vertices, density, quadrics)
    thin_cost = 1e-2 * density  # in squared edges, for each unit of quality
    into, costs = np.arange(len(vertices)), np.full(len(vertices), np.inf)
    winner = np.empty(2 * len(vertices), dtype=np.int64)
    for min_cosine in (0.2, -2.0):  # between a triangle's normals before and after
        _start(mesh, vertices, quadrics, draft.fixed, costs, winner)
        while (excess := (len(mesh.faces()) if counts_faces else draft.n_vertices) - target) > 0:
            steps = min(16_384, -(-excess // 2) if counts_faces else excess)  # until progress is reported
            removed = _collapse_some(
                mesh, vertices, draft.normals, quadrics, draft.fixed, thin_cost, min_cosine, steps, costs, winner, into
            )
            if on_progress:
                on_progress(removed)
            if removed == 0:
                break
        else:
            break
    draft.merge(ends(into))


@kernel
def dense_quadrics(points, normals, vertices, nearest):
    """Return for each vertex the quadric of the tangent planes of the dense points nearest to it, (V, 10)."""
    quadrics = np.zeros((len(vertices), NUMBERS))
    for i in range(len(points)):
        v = nearest[i]
        if v >= 0:
            normal = row(normals, i)
            add_plane(quadrics[v], normal, dot(normal, minus(row(vertices, v), row(points, i))), 1.0)
    return quadrics


def ends(into: Ints) -> Ints:
    """Return where each vertex went in the end."""
    while not np.array_equal(further := into[into], into):
        into = further
    return into


@kernel
def _start(mesh, vertices, quadrics, fixed, costs, winner):
    """Fill the costs, (V,), and the tournament tree `winner`, (2 V,): vertex v is at V + v, and the cheapest at 1."""
    n = len(costs)
    halves, ring = room_for_ring()
    for v in range(n):
        costs[v] = np.inf if fixed[v] else _lower_bound(mesh, vertices, quadrics, v, halves, ring)
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
def _cost(vertices, quadrics, v, u):
    """Return the sum of the quadrics of two vertices at the second one."""
    return value(quadrics[v], minus(row(vertices, u), row(vertices, v))) + quadrics[u, 9]


@kernel(allocates=False)
def _lower_bound(mesh, vertices, quadrics, v, halves, ring):
    """Return the cost of the cheapest collapse of a vertex, whether it is allowed or not."""
    count, _, _ = neighbours(mesh, v, halves, ring)
    cheapest = np.inf
    for slot in range(count):
        cheapest = min(cheapest, _cost(vertices, quadrics, v, ring[slot]))
    return cheapest


@kernel
def _collapse_some(mesh, vertices, normals, quadrics, fixed, thin_cost, min_cosine, steps, costs, winner, into):
    """Remove at most `steps` vertices; return how many were removed."""
    halves, ring = room_for_ring()
    halves_u, ring_u = room_for_ring()
    bounds, removed = np.empty(len(ring)), 0
    while removed < steps:
        v = winner[1]
        if costs[v] == np.inf:
            break
        cost, u = _best(
            mesh, vertices, normals, quadrics, thin_cost, min_cosine, v, halves, ring, halves_u, ring_u, bounds
        )
        if cost > costs[v]:  # which was a lower bound
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
        count, _, _ = neighbours(mesh, u, halves, ring)
        for slot in range(count + 1):
            w = u if slot == count else ring[slot]
            if not fixed[w]:
                costs[w] = _lower_bound(mesh, vertices, quadrics, w, halves_u, ring_u)
                _play(costs, winner, w)
    return removed


@kernel(allocates=False)
def _best(mesh, vertices, normals, quadrics, thin_cost, min_cosine, v, halves, ring, halves_u, ring_u, bounds):
    """Return the cost and the neighbour of the cheapest collapse of v that is allowed; infinity and -1 if none is."""
    count, edges, closed = neighbours(mesh, v, halves, ring)
    best, target = np.inf, count
    for slot in range(count):
        bounds[slot] = _cost(vertices, quadrics, v, ring[slot])
    for _ in range(count):  # those of the lowest bound first, as later ones then need no checks
        slot = 0
        for later in range(1, count):
            slot = later if bounds[later] < bounds[slot] else slot
        cost = bounds[slot]
        bounds[slot] = np.inf
        if cost > best:
            break
        if not is_allowed(mesh, v, slot, count, edges, closed, halves, ring, halves_u, ring_u):
            continue
        cost += thin_cost * _thinness_after(mesh, vertices, normals, min_cosine, v, ring[slot], edges, halves)
        if cost < best or (cost == best and slot < target):
            best, target = cost, slot
    return best, ring[target] if best < np.inf else -1


@kernel(allocates=False)
def is_allowed(mesh, v, slot, count, edges, closed, halves, ring, halves_u, ring_u):
    """Return whether a collapse keeps the topology: the link condition, and no triangle or vertex left hanging."""
    u = ring[slot]
    count_u, edges_u, closed_u = neighbours(mesh, u, halves_u, ring_u)
    on_left = slot < edges  # is there a triangle to the left of the edge from v to u
    on_right = closed or slot > 0
    if on_left and on_right and not closed and not closed_u:  # the edge would pinch the surface between two boundaries
        return False
    common = 0
    for i in range(count):
        common += position_of(ring_u, count_u, ring[i]) >= 0
    if common != on_left + on_right or edges + edges_u - 2 * common > MAX_VALENCE:
        return False
    if closed and closed_u and edges == 3 and edges_u == 3:  # a tetrahedron
        return False
    if on_left and _is_ear(mesh, halves[slot]):
        return False
    return not (on_right and _is_ear(mesh, preceding(halves[slot - 1 if slot > 0 else edges - 1])))


@kernel(allocates=False)
def _is_ear(mesh, h):
    """Return whether the other two edges of the triangle of a half-edge are both boundary edges."""
    return mesh.opposite[following(h)] < 0 and mesh.opposite[preceding(h)] < 0


@kernel(allocates=False)
def _thinness_after(mesh, vertices, normals, min_cosine, v, u, edges, halves):
    """Return how thin the triangles would be that a collapse moves; infinity if one turns over or has no area."""
    total = 0.0
    pu, pv = row(vertices, u), row(vertices, v)
    for slot in range(edges):
        a, b = mesh.origin[following(halves[slot])], mesh.origin[preceding(halves[slot])]
        if a == u or b == u:
            continue
        pa, pb = row(vertices, a), row(vertices, b)
        if not has_area(pu, pa, pb):
            return np.inf
        before, after = area_vector(pv, pa, pb), area_vector(pu, pa, pb)
        if min_cosine >= -1.0:
            lengths = np.sqrt(dot(before, before)) * np.sqrt(dot(after, after))
            if dot(before, after) < min_cosine * lengths or agreement(after, normals, u, a, b) < 0.0:
                return np.inf
        thin = 0.3 - quality(pu, pa, pb)  # triangles of a lower quality cost extra
        if thin > 0.0:
            au, bu, ab = minus(pa, pu), minus(pb, pu), minus(pb, pa)
            total += thin * (dot(au, au) + dot(bu, bu) + dot(ab, ab))
    return total


@kernel
def move_triangles(mesh, v, u, halves):
    """Move the triangles around v to its neighbour u, and remove those that have both."""
    both = np.array([half_edge(mesh, u, v) // 3, half_edge(mesh, v, u) // 3])
    edges, _ = around(mesh, v, halves)
    for slot in range(edges):
        mesh.origin[halves[slot]] = u
    mesh.leaving[v] = -1
    replace_triangles(mesh, both[both >= 0], np.empty((0, 3), dtype=np.int64))
