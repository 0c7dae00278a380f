"""Let vertices go where they matter least, and others come where they help most, each fitted to the dense points.

The energy is that of Hoppe et al. 1993, *Mesh Optimization*, with a cost of thin triangles in the place of springs: the
sum of squared distances of the dense points. A collapse of an edge puts one vertex in the place of two, which costs
energy; a split of an edge adds a vertex, which gains some. Both fit the vertex, while all others stay.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.collapse import is_allowed, move_triangles
from gppcs.meshing.flips import thinness
from gppcs.meshing.halfedges import (
    MOST_AROUND,
    Flags,
    Floats,
    Ints,
    around,
    following,
    leave_by,
    neighbours,
    preceding,
)
from gppcs.meshing.stars import (
    Surface,
    add_around,
    add_points,
    add_triangle,
    empty,
    fit_star,
    room_for_star,
    store,
)
from gppcs.spatial.triangles import dot, minus, row

WORTH = 0.6  # least gain of a split, in costs of a collapse: fits and flips then raise the gain
AT_ONCE = 64  # edges or vertices that a thread takes at once, at least


def exchange(surface: Surface, level: Ints, extra: float) -> None:
    """Collapse edges while a split elsewhere is worth it, split as many edges, and fit all vertices, one by one.

    Each vertex is of a dense point, its `level`, (V,). In a very small mesh, some vertices may not find a place again.
    """
    mesh = surface.mesh
    edges, rises, stale = mesh.inner_edges(), np.empty(len(mesh.origin)), np.ones(len(surface.first), dtype=np.bool_)
    costs = tried(try_collapses, surface, edges, extra)
    _try_stale_splits(surface, edges, extra, rises, stale)
    cheapest, best = np.argsort(costs, kind="stable"), np.argsort(rises[edges], kind="stable")
    worthless = np.flatnonzero(~(-rises[edges[best]] >= WORTH * costs[cheapest]))
    count = worthless[0] if len(worthless) else len(edges)
    missing = _collapse_all(surface, edges[cheapest[:count]], level, extra, stale)
    added = -1
    while missing and added:
        edges = mesh.inner_edges()
        _try_stale_splits(surface, edges, extra, rises, stale)
        order = np.argsort(rises[edges], kind="stable")
        added = _split_all(surface, edges[order], level, extra, missing, stale)
        missing -= added
    _fit_all(surface, extra)


def _try_stale_splits(surface: Surface, edges: Ints, extra: float, rises: Floats, stale: Flags) -> None:
    """Fill `rises`, (3 F,), with what splits cost near triangles that are stale, (F,); then none is.

    A split depends on the triangles of its edge, and on those across their other edges.
    """
    beyond = surface.mesh.opposite.reshape(-1, 3)
    near = stale | (stale[beyond // 3] & (beyond >= 0)).any(axis=1)
    again = edges[near[edges // 3] | near[surface.mesh.opposite[edges] // 3]]
    rises[again] = tried(_try_splits, surface, again, extra)
    stale[:] = False


def tried(kernel: Callable[..., None], surface: Surface, edges: Ints, extra: float) -> Floats:
    """Return by how much the energy would rise with a change of each edge, infinity where it is not allowed."""
    found = np.empty(len(edges))
    on_ranges(kernel, len(edges), surface, edges, extra, found, least=AT_ONCE)
    return found


@kernel
def try_collapses(begin, end, surface, edges, extra, found):
    """Fill `found`, (m,), with what collapses of edges, (m,), cost; for a range of these."""
    star = room_for_star(len(surface.points))
    for i in range(begin, end):
        found[i], _ = collapsed(surface, star, edges[i], extra)


@kernel
def collapsed(surface, star, h, extra):
    """Return by how much the energy rises if the ends of an edge become one vertex, and the best place for this.

    The fit starts in the middle of the edge. With a limit, if it finds no allowed place, as beside a corner, it starts
    at each end; without one, such collapses are too dear to be made.
    """
    mesh = surface.mesh
    v, u = mesh.origin[h], mesh.origin[following(h)]
    a, b = row(surface.vertices, v), row(surface.vertices, u)
    middle = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])
    count, edges, closed = neighbours(mesh, v, star.halves, star.found)
    slot = 0
    while star.found[slot] != u:
        slot += 1
    if not is_allowed(mesh, v, slot, count, edges, closed, star.halves, star.found, star.others, star.beyond):
        return np.inf, middle
    empty(star, middle)
    energy = add_around(surface, star, v, u, extra) + add_around(surface, star, u, v, extra)
    if star.worst[0] > surface.limit:
        return np.inf, middle
    least, place = fit_star(surface, star, middle, extra)
    if least == np.inf and surface.limit < np.inf:
        for end in (a, b):
            star.triangles[: star.sizes[1]] = -1
            found, there = fit_star(surface, star, end, extra)
            if found < least:
                least, place = found, there
    return least - energy, place


@kernel
def _collapse_all(surface, edges, level, extra, stale):
    """Collapse edges, (m,), but none whose surroundings an earlier one has changed; return their number.

    Mark in `stale`, (F,), the triangles that differ then.
    """
    mesh, count = surface.mesh, 0
    star = room_for_star(len(surface.points))
    changed = np.zeros(len(surface.vertices), dtype=np.bool_)
    for h in edges:
        v, u = mesh.origin[h], mesh.origin[following(h)]
        if v < 0 or changed[v] or changed[u]:
            continue
        cost, place = collapsed(surface, star, h, extra)
        if cost == np.inf:
            continue
        collapse_edge(surface, star, v, u, place, level, extra, changed)
        for k in range(star.sizes[0]):
            stale[star.edges[k] // 3] = True
        count += 1
    return count


@kernel(allocates=False)
def collapse_edge(surface, star, v, u, place, level, extra, changed):
    """Let the vertex u take the triangles and points of v at a place; mark both and all around them as changed."""
    mesh = surface.mesh
    if _squared(surface, level[v], place) < _squared(surface, level[u], place):
        level[u] = level[v]
    move_triangles(mesh, v, u, star.halves)
    store(surface, star, u, place, extra)
    changed[v] = changed[u] = True
    for k in range(star.sizes[0]):
        changed[mesh.origin[star.edges[k]]] = changed[mesh.origin[following(star.edges[k])]] = True


@kernel
def _squared(surface, i, place):
    """Return the squared distance of a dense point from a place."""
    step = minus(row(surface.points, i), place)
    return dot(step, step)


@kernel
def _try_splits(begin, end, surface, edges, extra, found):
    """Fill `found`, (m,), with what splits of edges, (m,), cost: less than nothing; for a range of these."""
    star = room_for_star(len(surface.points))
    for i in range(begin, end):
        found[i], _ = _split(surface, star, edges[i], extra)


@kernel
def _split(surface, star, h, extra):
    """Return by how much the energy rises if an edge is split by a new vertex, and the best place for this."""
    mesh = surface.mesh
    o = mesh.opposite[h]
    a, b = row(surface.vertices, mesh.origin[h]), row(surface.vertices, mesh.origin[o])
    c, d = row(surface.vertices, mesh.origin[preceding(h)]), row(surface.vertices, mesh.origin[preceding(o)])
    middle = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])
    empty(star, middle)
    energy = extra * (thinness(a, b, c) + thinness(b, a, d))
    for edge in (following(h), preceding(h), following(o), preceding(o)):
        add_triangle(surface, star, edge)
    energy += add_points(surface, star, h // 3, -1) + add_points(surface, star, o // 3, -1)
    least, place = fit_star(surface, star, middle, extra)
    return least - energy, place


@kernel
def _split_all(surface, edges, level, extra, most, stale):
    """Split at most so many edges, of (m,), but none of a triangle that is split already; return their number.

    Mark in `stale`, (F,), at first all False, the parts of split triangles. New vertices and triangles take the numbers
    of removed ones. Each vertex is of the nearest point that none has.
    """
    mesh, count, w, f = surface.mesh, 0, 0, 0
    star = room_for_star(len(surface.points))
    used = np.zeros(len(surface.points), dtype=np.bool_)
    for v in range(len(level)):
        used[level[v]] = used[level[v]] or mesh.leaving[v] >= 0
    for h in edges:
        if count == most:
            break
        o = mesh.opposite[h]
        crowded = max(
            around(mesh, mesh.origin[preceding(h)], star.halves)[0],
            around(mesh, mesh.origin[preceding(o)], star.halves)[0],
        )
        if stale[h // 3] or stale[o // 3] or crowded == MOST_AROUND:
            continue
        cost, place = _split(surface, star, h, extra)
        nearest = _nearest_member(surface, star, used, place)
        if cost == np.inf or nearest < 0:
            continue
        while mesh.leaving[w] >= 0:
            w += 1
        pair = np.empty(2, dtype=np.int64)
        for side in range(2):
            while mesh.origin[3 * f] >= 0:
                f += 1
            pair[side], f = f, f + 1
        faces = h // 3, pair[0], o // 3, pair[1]
        split_edge(mesh, h, w, faces)
        for k in range(4):
            star.edges[k], stale[faces[k]] = 3 * faces[k] + 1, True
        level[w], used[nearest] = nearest, True
        store(surface, star, w, place, extra)
        count += 1
    return count


@kernel(allocates=False)
def _nearest_member(surface, star, used, place):
    """Return the point of a star that is nearest to a place, of those that are not used; -1 if there is none."""
    least, nearest = np.inf, -1
    for m in range(star.sizes[1]):
        squared = _squared(surface, star.members[m], place)
        if squared < least and not used[star.members[m]]:
            least, nearest = squared, star.members[m]
    return nearest


@kernel(allocates=False)
def split_edge(mesh, h, w, faces):
    """Split an edge by a vertex without triangles, and the two triangles of the edge in two each.

    Triangles a b c and b a d, with h from a to b, become w b c, w c a, w a d and w d b, with the numbers `faces`, of
    which the first and the third are those of the old ones.
    """
    o = mesh.opposite[h]
    a, b = mesh.origin[h], mesh.origin[o]
    c, d = mesh.origin[preceding(h)], mesh.origin[preceding(o)]
    outer = (
        mesh.opposite[following(h)], mesh.opposite[preceding(h)],
        mesh.opposite[following(o)], mesh.opposite[preceding(o)],
    )  # fmt: skip
    ring = b, c, a, d, b
    for k in range(4):
        f = 3 * faces[k]
        mesh.origin[f], mesh.origin[f + 1], mesh.origin[f + 2] = w, ring[k], ring[k + 1]
        mesh.opposite[f], mesh.opposite[f + 1] = 3 * faces[(k + 3) % 4] + 2, outer[k]
        mesh.opposite[f + 2] = 3 * faces[(k + 1) % 4]
        if outer[k] >= 0:
            mesh.opposite[outer[k]] = f + 1
    for k in range(4):
        leave_by(mesh, ring[k], 3 * faces[k] + 1)
    leave_by(mesh, w, 3 * faces[0])


@kernel
def _fit_all(surface, extra):
    """Fit all vertices to the points around them, one after another."""
    star = room_for_star(len(surface.points))
    for v in range(len(surface.vertices)):
        if surface.mesh.leaving[v] < 0:
            continue
        here = row(surface.vertices, v)
        empty(star, here)
        energy = add_around(surface, star, v, -1, extra)
        least, place = fit_star(surface, star, here, extra)
        if least < energy:
            store(surface, star, v, place, extra)
