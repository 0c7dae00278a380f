"""Let vertices go where they matter least, and others come where they help most, each fitted to the dense points.

A collapse of an edge puts one vertex in the place of two, which costs energy (see `energy.py`); a split of an edge adds
a vertex, which gains some. Both fit the vertex, while all others stay.
"""

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.collapse import is_allowed, move_triangles
from gppcs.meshing.cuts import TriangleTree
from gppcs.meshing.draft import Draft
from gppcs.meshing.energy import FittedMesh, thinness
from gppcs.meshing.fit import fit, fit_all, is_star_free, mark
from gppcs.meshing.flips import flip
from gppcs.meshing.halfedges import (
    MAX_VALENCE,
    around,
    following,
    neighbours,
    position_of,
    preceding,
    replace_triangles,
)
from gppcs.meshing.stars import add_around, add_points, add_triangle, empty, fit_star, room_for_star, store
from gppcs.spatial.triangles import dot, minus, row

WORTH = 0.6  # minimum gain of a split, in costs of a collapse: fits and flips then raise the gain


def exchanged(draft: Draft, assigned: Assignment) -> tuple[Draft, Assignment]:
    """Return a draft whose vertices went to where they help more, and the triangles of points; both are new."""
    changed = draft.copy()
    assigned = Assignment(assigned.face.copy(), assigned.squared.copy(), assigned.weights.copy())
    mesh = changed.mesh
    fitted = FittedMesh.from_points(mesh, changed.vertices, draft.dense.positions, assigned)
    exchange(fitted, changed.dense_index, draft.thin_cost)
    changed.normals = draft.dense.normals[changed.dense_index]
    changed.nearest = np.where(assigned.face >= 0, mesh.origin[3 * assigned.face], -1)
    after = flip(changed)
    for _ in range(2):
        after = flip(changed, fit(changed, after))
    return changed, after


def exchange(fitted: FittedMesh, dense_index: Ints, thin_cost: float) -> None:
    """Collapse edges while a split elsewhere is worth it, split as many edges, and fit all vertices, one by one."""
    mesh, tree, edges = fitted.mesh, TriangleTree.empty(), fitted.mesh.inner_edges()
    costs, gains = np.full(len(mesh.origin), np.inf), np.full(len(mesh.origin), -np.inf)
    costs[edges] = changes(fitted, edges, thin_cost, split=False)
    gains[edges] = -changes(fitted, edges, thin_cost, split=True)
    cheapest = edges[np.argsort(costs[edges], kind="stable")]
    best = edges[np.argsort(-gains[edges], kind="stable")]
    worthless = np.flatnonzero(~(gains[best] >= WORTH * costs[cheapest]))
    count = worthless[0] if len(worthless) else len(edges)
    changed = np.zeros(len(fitted.vertices), dtype=np.bool_)
    missing = collapse_all(fitted, tree, cheapest[:count], dense_index, thin_cost, costs, changed)
    added = -1
    while missing and added:
        edges = mesh.inner_edges()
        stale = edges[_are_near(fitted, edges, changed)]
        gains[stale], changed[:] = -changes(fitted, stale, thin_cost, split=True), False
        best = edges[np.argsort(-gains[edges], kind="stable")]
        added = _split_all(fitted, tree, best, dense_index, thin_cost, missing, changed)
        missing -= added
    fit_all(fitted, tree, thin_cost)


def _are_near(fitted: FittedMesh, edges: Ints, changed: Flags) -> Flags:
    """Return which edges have a triangle that shares an edge with one that has changed: the gain of these may have."""
    mesh = fitted.mesh
    near = changed[mesh.corners()].sum(axis=1) >= 2
    return near[edges // 3] | near[mesh.opposite[edges] // 3]


def changes(fitted: FittedMesh, edges: Ints, thin_cost: float, split: bool) -> Floats:
    """Return by how much the energy would rise with a split or a collapse of each edge, infinity if not allowed."""
    energies = np.empty(len(edges))
    on_ranges(_try_all, len(edges), fitted, edges, thin_cost, split, energies, minimum=64)
    return energies


@kernel
def _try_all(begin, end, fitted, edges, thin_cost, split, energies):
    """Fill `energies`, (m,), with what splits or collapses of edges, (m,), cost; for a range of these."""
    star = room_for_star(len(fitted.points))
    for i in range(begin, end):
        if split:
            energies[i], _ = _split(fitted, star, edges[i], thin_cost)
        else:
            energies[i], _ = _collapsed(fitted, star, edges[i], thin_cost)


@kernel
def _collapsed(fitted, star, h, thin_cost):
    """Return the rise in energy if the ends of an edge become one vertex, and the best position for this."""
    mesh = fitted.mesh
    v, u = mesh.origin[h], mesh.origin[following(h)]
    a, b = row(fitted.vertices, v), row(fitted.vertices, u)
    middle = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])
    count, edges, closed = neighbours(mesh, v, star.halves, star.ring)
    slot = position_of(star.ring, count, u)
    if not is_allowed(mesh, v, slot, count, edges, closed, star.halves, star.ring, star.halves_u, star.ring_u):
        return np.inf, middle
    empty(star, middle)
    before = add_around(fitted, star, v, u, thin_cost) + add_around(fitted, star, u, v, thin_cost)
    if star.farthest[0] > fitted.limit:
        return np.inf, middle
    lowest, position = fit_star(fitted, star, middle, thin_cost)
    if lowest == np.inf and fitted.limit < np.inf:  # as beside a corner; without a limit, these are too dear
        for end in (a, b):
            star.triangles[: star.sizes[1]] = -1
            energy, fit = fit_star(fitted, star, end, thin_cost)
            if energy < lowest:
                lowest, position = energy, fit
    return lowest - before, position


@kernel
def collapse_all(fitted, tree, edges, dense_index, thin_cost, costs, changed):
    """Collapse edges, (m,), that no earlier one has `changed`, (V,), and that cut nothing; return their number."""
    mesh, count = fitted.mesh, 0
    star = room_for_star(len(fitted.points))
    inside = np.zeros(len(fitted.first), dtype=np.bool_)
    for h in edges:
        v, u = mesh.origin[h], mesh.origin[following(h)]
        if v < 0 or changed[v] or changed[u]:
            continue
        cost, position = _collapsed(fitted, star, h, thin_cost)
        removed = h // 3, (mesh.opposite[h] // 3 if mesh.opposite[h] >= 0 else h // 3)
        if cost == np.inf or not is_star_free(fitted, tree, star, u, position, removed, inside):
            costs[h] = np.inf
            continue
        if _squared(fitted, dense_index[v], position) < _squared(fitted, dense_index[u], position):
            dense_index[u] = dense_index[v]
        move_triangles(mesh, v, u, star.halves)
        store(fitted, star, u, position, thin_cost)
        changed[v] = True
        mark(fitted, tree, star, u, changed)
        count += 1
    return count


@kernel
def _squared(fitted, i, position):
    """Return the squared distance of a dense point from a position."""
    step = minus(row(fitted.points, i), position)
    return dot(step, step)


@kernel
def _split(fitted, star, h, thin_cost):
    """Return by how much the energy rises if an edge is split by a new vertex, and the best position for this."""
    mesh = fitted.mesh
    o = mesh.opposite[h]
    a, b = row(fitted.vertices, mesh.origin[h]), row(fitted.vertices, mesh.origin[o])
    c, d = row(fitted.vertices, mesh.origin[preceding(h)]), row(fitted.vertices, mesh.origin[preceding(o)])
    middle = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])
    empty(star, middle)
    before = thin_cost * (thinness(a, b, c) + thinness(b, a, d))
    for edge in (following(h), preceding(h), following(o), preceding(o)):
        add_triangle(fitted, star, edge)
    before += add_points(fitted, star, h // 3, -1) + add_points(fitted, star, o // 3, -1)
    lowest, position = fit_star(fitted, star, middle, thin_cost)
    return lowest - before, position


@kernel
def _split_all(fitted, tree, edges, dense_index, thin_cost, max_count, changed):
    """Split at most so many edges, (m,), of unsplit triangles, each for an unused point; return their number."""
    mesh, count, w, f = fitted.mesh, 0, 0, 0
    star = room_for_star(len(fitted.points))
    used, divided = np.zeros(len(fitted.points), dtype=np.bool_), np.zeros(len(fitted.first), dtype=np.bool_)
    for v in range(len(dense_index)):
        used[dense_index[v]] = used[dense_index[v]] or mesh.leaving[v] >= 0
    for h in edges:
        if count == max_count:
            break
        o = mesh.opposite[h]
        valence = max(
            around(mesh, mesh.origin[preceding(h)], star.halves)[0],
            around(mesh, mesh.origin[preceding(o)], star.halves)[0],
        )
        if divided[h // 3] or divided[o // 3] or valence == MAX_VALENCE:
            continue
        cost, position = _split(fitted, star, h, thin_cost)
        nearest = _nearest_member(fitted, star, used, position)
        if cost == np.inf or nearest < 0:
            continue
        while mesh.leaving[w] >= 0:
            w += 1
        faces = np.array([h // 3, -1, o // 3, -1])
        for k in (1, 3):
            while mesh.origin[3 * f] >= 0:
                f += 1
            faces[k], f = f, f + 1
        split_edge(mesh, h, w, faces)
        for k in range(4):
            star.edges[k], divided[faces[k]] = 3 * faces[k] + 1, True
        dense_index[w], used[nearest] = nearest, True
        store(fitted, star, w, position, thin_cost)
        mark(fitted, tree, star, w, changed)
        count += 1
    return count


@kernel(allocates=False)
def _nearest_member(fitted, star, used, position):
    """Return the point of a star that is nearest to a position, of those that are not used; -1 if there is none."""
    lowest, nearest = np.inf, -1
    for m in range(star.sizes[1]):
        squared = _squared(fitted, star.members[m], position)
        if squared < lowest and not used[star.members[m]]:
            lowest, nearest = squared, star.members[m]
    return nearest


@kernel
def split_edge(mesh, h, w, faces):
    """Split an edge and its triangles by a vertex w without triangles; the four that result get the numbers `faces`."""
    o = mesh.opposite[h]
    a, b = mesh.origin[h], mesh.origin[o]
    c, d = mesh.origin[preceding(h)], mesh.origin[preceding(o)]
    replace_triangles(mesh, faces, np.array([[w, b, c], [w, c, a], [w, a, d], [w, d, b]]))
