"""Flip edges while that brings the mesh nearer to the dense points, and thin triangles vanish."""

import numpy as np

from gppcs.engine.arrays import Floats
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.assignment import Assignment, corners_from
from gppcs.meshing.cuts import TriangleTree, follow, is_free
from gppcs.meshing.draft import Draft
from gppcs.meshing.energy import FittedMesh, price, thinness
from gppcs.meshing.halfedges import MAX_VALENCE, around, following, half_edge, preceding, replace_triangles
from gppcs.spatial.triangles import (
    agreement,
    area_vector,
    dot,
    minus,
    nearest_in_triangle,
    qualities,
    row,
    squared_distance,
    unit,
)

FEW_OTHERS = 1.1  # dense points for each vertex, up to which nearly all are vertices


def flip(draft: Draft, assigned: Assignment | None = None) -> Assignment:
    """Flip edges while the energy falls; return the triangles of the dense points; many thin ones raise their cost.

    If nearly all points are vertices, others tell little: edges are flipped where that bends the surface less.
    """
    assigned = assigned or draft.assigned()
    if draft.thin_cost == 0.0 and len(draft.nearest) > FEW_OTHERS * draft.n_vertices:
        # At first, five mean squared distances of the points of a triangle.
        draft.thin_cost = 5.0 * float(assigned.squared.sum()) / len(draft.mesh.faces())
    fitted = FittedMesh.from_points(draft.mesh, draft.vertices, draft.dense.positions, assigned)
    flip_all(fitted, TriangleTree.empty(), draft.normals, draft.thin_cost, 8)
    if (qualities(draft.vertices, draft.mesh.faces()) < 0.2).mean() > 0.012:  # too many are thin
        draft.thin_cost *= 2.0
    return assigned


def flip_all(fitted: FittedMesh, tree: TriangleTree, normals: Floats, thin_cost: float, sweeps: int) -> int:
    """Flip edges while the energy falls and nothing cuts a tree, in few `sweeps`; return how many were."""
    edges = fitted.mesh.inner_edges()
    lowers = np.zeros(len(edges), dtype=np.bool_)
    on_ranges(_mark_lowering, len(edges), fitted, normals, thin_cost, edges, lowers, minimum=256)
    return _flip_queued(fitted, tree, normals, thin_cost, edges[lowers], sweeps * len(edges))


@kernel
def _mark_lowering(begin, end, fitted, normals, thin_cost, edges, lowers):
    """Mark which of the edges, (m,), lower the energy by a flip; for a range of these."""
    halves = np.empty(MAX_VALENCE, dtype=np.int64)
    for i in range(begin, end):
        lowers[i] = _lowers_energy(fitted, normals, thin_cost, edges[i], halves)


@kernel
def _lowers_energy(fitted, normals, thin_cost, h, halves):
    """Return whether an edge can be flipped, and that lowers the energy."""
    if not is_flippable(fitted.mesh, fitted.vertices, normals, h, halves):
        return False
    return _is_better(fitted, thin_cost, h) if thin_cost > 0.0 else _is_smoother(fitted.mesh, fitted.vertices, h)


@kernel
def _flip_queued(fitted, tree, normals, thin_cost, edges, tries):
    """Flip edges, (m,), and those around them, while the energy falls; return how many were."""
    mesh, size = fitted.mesh, len(fitted.mesh.origin)
    queue, waiting = np.empty(size, dtype=np.int64), np.zeros(size, dtype=np.bool_)
    queue[: len(edges)], waiting[edges] = edges, True
    count, begin, flips = len(edges), 0, 0
    halves = np.empty(MAX_VALENCE, dtype=np.int64)
    inside = np.zeros(size // 3, dtype=np.bool_)
    while count and tries:
        h = queue[begin]
        begin, count, tries = (begin + 1) % size, count - 1, tries - 1
        waiting[h] = False
        if not _lowers_energy(fitted, normals, thin_cost, h, halves):
            continue
        patch, new = flipped(mesh, h)
        if not is_free(mesh, fitted.vertices, tree, inside, patch, new):
            continue
        replace_triangles(mesh, patch, new)
        _share_out(fitted, patch[0], patch[1])
        flips += 1
        for side in patch:
            follow(mesh, fitted.vertices, tree, side)
            for k in range(3):
                opposite = mesh.opposite[3 * side + k]
                e = min(3 * side + k, opposite)
                if opposite >= 0 and not waiting[e]:
                    queue[(begin + count) % size], waiting[e] = e, True
                    count += 1
    return flips


@kernel(allocates=False)
def is_flippable(mesh, vertices, normals, h, halves):
    """Return whether an edge can be flipped: the mesh stays a manifold, and no triangle degenerates or turns over."""
    o = mesh.opposite[h]
    if mesh.origin[h] < 0 or o < 0:
        return False
    a, b = mesh.origin[h], mesh.origin[o]
    c, d = mesh.origin[preceding(h)], mesh.origin[preceding(o)]
    edges_c, _ = around(mesh, c, halves)
    edges_d, _ = around(mesh, d, halves)
    if c == d or max(edges_c, edges_d) == MAX_VALENCE or half_edge(mesh, c, d) >= 0 or half_edge(mesh, d, c) >= 0:
        return False
    for v in (a, b):
        edges, closed = around(mesh, v, halves)
        if edges <= (3 if closed else 1):
            return False
    for v, w in ((a, d), (d, b)):
        normal = area_vector(row(vertices, v), row(vertices, w), row(vertices, c))
        # The cosine between the normal and the mean of those of the corners must be above 0.1.
        if not agreement(normal, normals, v, w, c) > 0.3 * np.sqrt(dot(normal, normal)):
            return False
    return True


@kernel(allocates=False)
def _is_better(fitted, thin_cost, h):
    """Return whether the energy is lower after the flip of an edge, and no other point is beyond the limit."""
    mesh, vertices, limit = fitted.mesh, fitted.vertices, fitted.limit
    o = mesh.opposite[h]
    pa, pb = row(vertices, mesh.origin[h]), row(vertices, mesh.origin[o])
    pc, pd = row(vertices, mesh.origin[preceding(h)]), row(vertices, mesh.origin[preceding(o)])
    old, farthest = thin_cost * (thinness(pa, pb, pc) + thinness(pb, pa, pd)), limit
    for side in (h // 3, o // 3):
        i = fitted.first[side]
        while i >= 0:
            old += price(fitted.assigned.squared[i], limit)
            farthest = max(farthest, fitted.assigned.squared[i])
            i = fitted.after[i]
    new, enough = thin_cost * (thinness(pa, pd, pc) + thinness(pd, pb, pc)), (1.0 - 1e-7) * old  # rounding flips none
    for side in (h // 3, o // 3):
        i = fitted.first[side]
        while i >= 0 and new < enough:
            point = row(fitted.points, i)
            fa, fb, fc, fd = minus(pa, point), minus(pb, point), minus(pc, point), minus(pd, point)
            s, t = nearest_in_triangle(fa, fd, fc)
            u, v = nearest_in_triangle(fd, fb, fc)
            squared = min(squared_distance(fa, fd, fc, s, t), squared_distance(fd, fb, fc, u, v))
            if squared > farthest:
                return False
            new += price(squared, limit)
            i = fitted.after[i]
    return new < enough


@kernel(allocates=False)
def _is_smoother(mesh, vertices, h):
    """Return whether the angles between triangles, times their edges, are smaller after a flip (Dyn et al. 1990)."""
    o = mesh.opposite[h]
    a, b = row(vertices, mesh.origin[h]), row(vertices, mesh.origin[o])
    c, d = row(vertices, mesh.origin[preceding(h)]), row(vertices, mesh.origin[preceding(o)])
    left, right = unit(area_vector(a, b, c)), unit(area_vector(b, a, d))
    at_a, at_b = unit(area_vector(a, d, c)), unit(area_vector(d, b, c))
    old, new = _bend(a, b, left, right), _bend(c, d, at_a, at_b)
    sides = (
        (preceding(h), c, a, left, at_a), (following(h), b, c, left, at_b),
        (following(o), a, d, right, at_a), (preceding(o), d, b, right, at_b),
    )  # fmt: skip
    for e, p, q, before, after in sides:
        if mesh.opposite[e] >= 0:
            f = mesh.opposite[e] // 3
            i, j, k = mesh.origin[3 * f], mesh.origin[3 * f + 1], mesh.origin[3 * f + 2]
            beside = unit(area_vector(row(vertices, i), row(vertices, j), row(vertices, k)))
            old += _bend(p, q, before, beside)
            new += _bend(p, q, after, beside)
    return new < (1.0 - 1e-7) * old - 1e-12


@kernel(allocates=False)
def _bend(p, q, normal, other):
    """Return the length of an edge, times the angle between the normals of its triangles."""
    edge = minus(q, p)
    return np.sqrt(dot(edge, edge)) * np.arccos(min(1.0, max(-1.0, dot(normal, other))))


@kernel
def flipped(mesh, h):
    """Return the triangles of an edge, and those after its flip: of a b c and b a d, they are a d c and d b c."""
    o = mesh.opposite[h]
    a, b = mesh.origin[h], mesh.origin[o]
    c, d = mesh.origin[preceding(h)], mesh.origin[preceding(o)]
    return np.array([h // 3, o // 3]), np.array([[a, d, c], [d, b, c]])


@kernel(allocates=False)
def _share_out(fitted, f, g):
    """Give each point of two triangles to the nearer one."""
    assigned, begins = fitted.assigned, (fitted.first[f], fitted.first[g])
    fitted.first[f] = fitted.first[g] = -1
    for begin in begins:
        i = begin
        while i >= 0:
            behind = fitted.after[i]
            point = row(fitted.points, i)
            assigned.squared[i] = np.inf
            for side in (f, g):
                a, b, c = corners_from(fitted.mesh, fitted.vertices, side, point)
                s, t = nearest_in_triangle(a, b, c)
                squared = squared_distance(a, b, c, s, t)
                if squared < assigned.squared[i]:
                    assigned.face[i], assigned.squared[i] = side, squared
                    assigned.weights[i, 0], assigned.weights[i, 1] = s, t
            fitted.after[i] = fitted.first[assigned.face[i]]
            fitted.first[assigned.face[i]] = i
            i = behind
