"""Triangles that cut others: found by a tree of boxes, which follows the changes of the mesh.

Two triangles cut each other if they have more in common than their common corners, be it a single place. Only what
rounding cannot change counts as apart. So where no cut is found, there is none.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.halfedges import Floats, HalfEdges, Ints
from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range
from gppcs.spatial.triangles import area_vector, cross, dot, has_area, minus, row, unit

ROUNDING = 2.0**-48  # of coordinates and their differences, generously, as clouds are of about unit size
TRIANGLES_AT_ONCE = 256  # triangles that a thread looks at at once, at least
DEEPEST = 64  # nodes that wait in a search; a tree of fewer than 2^62 leaves has no more


class TriangleTree(NamedTuple):
    """Boxes around triangles, in the nodes of a `KdTree` over their centroids."""

    order: Ints  # (f,): the triangles that were there when the tree was built, in tree order
    leaf: Ints  # (F,): the leaf of each triangle; -1 for one that was not there
    low: Floats  # (nodes, 3): corners of the boxes; row 0 is unused
    high: Floats  # (nodes, 3): corners of the boxes; row 0 is unused

    @classmethod
    def of(cls, mesh: HalfEdges, vertices: Floats) -> Self:
        """Build the tree of the triangles of a mesh."""
        there = np.flatnonzero(mesh.origin[::3] >= 0)
        points = KdTree.build(vertices[mesh.origin.reshape(-1, 3)[there]].mean(axis=1))
        low, high = np.full_like(points.lower, np.inf), np.full_like(points.upper, -np.inf)
        tree = cls(there[points.order], np.full(len(mesh.origin) // 3, -1), low, high)
        _fill_boxes(mesh, vertices, tree)
        return tree


@kernel(allocates=False)
def _fill_boxes(mesh, vertices, tree):
    """Fill `leaf`, `low` and `high` of a tree, whose boxes are empty."""
    leaves = first_leaf(tree.low)
    for node in range(leaves, 2 * leaves):
        begin, end = leaf_range(len(tree.order), leaves, node)
        for f in tree.order[begin:end]:
            tree.leaf[f] = node
            _widen(mesh, vertices, tree, f, node)
    for node in range(leaves - 1, 0, -1):
        for axis in range(3):
            tree.low[node, axis] = min(tree.low[2 * node, axis], tree.low[2 * node + 1, axis])
            tree.high[node, axis] = max(tree.high[2 * node, axis], tree.high[2 * node + 1, axis])


@kernel(allocates=False)
def _widen(mesh, vertices, tree, f, node):
    """Widen the box of a node so that it has the triangle f."""
    for h in range(3 * f, 3 * f + 3):
        for axis in range(3):
            x = vertices[mesh.origin[h], axis]
            tree.low[node, axis] = min(tree.low[node, axis], x)
            tree.high[node, axis] = max(tree.high[node, axis], x)


@kernel(allocates=False)
def follow(mesh, vertices, tree, f):
    """Widen the boxes of a tree after the triangle f has changed."""
    node = tree.leaf[f]
    while node > 0:
        _widen(mesh, vertices, tree, f, node)
        node //= 2


def cutting(mesh: HalfEdges, vertices: Floats, tree: TriangleTree | None = None, among: Ints | None = None) -> Ints:
    """Return which triangles cut another one or have no area: of all, or of some."""
    faces = np.flatnonzero(mesh.origin[::3] >= 0) if among is None else among[mesh.origin[3 * among] >= 0]
    found = np.zeros(len(faces), dtype=np.bool_)
    if len(faces):
        tree = tree or TriangleTree.of(mesh, vertices)
        inside = np.zeros(len(mesh.origin) // 3, dtype=np.bool_)
        on_ranges(_mark_cutting, len(faces), mesh, vertices, tree, inside, faces, found, least=TRIANGLES_AT_ONCE)
    return faces[found]


@kernel
def _mark_cutting(begin, end, mesh, vertices, tree, inside, faces, found):
    """Mark in `found`, (m,), which of the triangles `faces`, (m,), cut others; for a range of these."""
    for i in range(begin, end):
        found[i] = is_cut(mesh, vertices, tree, inside, faces[i])


@kernel
def is_cut(mesh, vertices, tree, inside, f):
    """Return whether a triangle of the mesh has no area or cuts another; those marked in `inside` do not count."""
    a, b, c = mesh.origin[3 * f], mesh.origin[3 * f + 1], mesh.origin[3 * f + 2]
    if not has_area(row(vertices, a), row(vertices, b), row(vertices, c)):
        return True
    return first_cut(mesh, vertices, tree, inside, a, b, c) >= 0


@kernel
def first_cut(mesh, vertices, tree, inside, a, b, c):
    """Return a triangle of a mesh that a triangle cuts."""
    low, high = _box(vertices, a, b, c)
    leaves = first_leaf(tree.low)
    waiting = np.empty(DEEPEST, dtype=np.int64)
    waiting[0], height = 1, 1
    while height:
        height -= 1
        node = waiting[height]
        if not _overlap(low, high, row(tree.low, node), row(tree.high, node)):
            continue
        if node < leaves:
            waiting[height], waiting[height + 1] = 2 * node, 2 * node + 1
            height += 2
            continue
        begin, end = leaf_range(len(tree.order), leaves, node)
        for f in tree.order[begin:end]:
            d, e, g = mesh.origin[3 * f], mesh.origin[3 * f + 1], mesh.origin[3 * f + 2]
            if d < 0 or inside[f]:
                continue
            least, most = _box(vertices, d, e, g)
            if _overlap(low, high, least, most) and are_cut(vertices, (a, b, c), (d, e, g)):
                return f
    return -1


@kernel(allocates=False)
def _box(vertices, a, b, c):
    """Return the corners of the box around a triangle."""
    pa, pb, pc = row(vertices, a), row(vertices, b), row(vertices, c)
    low = min(pa[0], pb[0], pc[0]), min(pa[1], pb[1], pc[1]), min(pa[2], pb[2], pc[2])
    return low, (max(pa[0], pb[0], pc[0]), max(pa[1], pb[1], pc[1]), max(pa[2], pb[2], pc[2]))


@kernel
def _overlap(low, high, least, most):
    """Return whether two boxes overlap."""
    return (
        low[0] <= most[0] and high[0] >= least[0]
        and low[1] <= most[1] and high[1] >= least[1]
        and low[2] <= most[2] and high[2] >= least[2]
    )  # fmt: skip


@kernel(allocates=False)
def are_cut(vertices, f, g):
    """Return whether two triangles meet in more than common corners, or are too near for rounding to tell."""
    shared = at_f = at_g = sum_f = sum_g = 0
    for i in range(3):
        for j in range(3):
            if f[i] == g[j]:
                shared, at_f, at_g, sum_f, sum_g = shared + 1, i, j, sum_f + i, sum_g + j
    if shared == 3:  # the same triangle, or one lies on the other
        return f[(at_f + 1) % 3] != g[(at_g + 1) % 3]
    p = row(vertices, f[at_f])
    if shared == 2:
        q = row(vertices, f[sum_f - at_f])
        return _is_folded(minus(q, p), minus(row(vertices, f[3 - sum_f]), p), minus(row(vertices, g[3 - sum_g]), p))
    a, b = minus(row(vertices, f[(at_f + 1) % 3]), p), minus(row(vertices, f[(at_f + 2) % 3]), p)
    c, d = minus(row(vertices, g[(at_g + 1) % 3]), p), minus(row(vertices, g[(at_g + 2) % 3]), p)
    if shared == 1:
        return not (_are_apart_in_space(a, b, c, d) or _are_apart_in_plane(a, b, c, d))
    return _may_have_common_place(a, b, minus(row(vertices, g[at_g]), p), c, d)


@kernel(allocates=False)
def _is_folded(edge, a, b):
    """Return whether two triangles at a common edge, with the third corners a and b, lie on one another."""
    u, v = cross(edge, a), cross(edge, b)
    lengths = _length(edge) + _length(a) + _length(b)
    least = ROUNDING * lengths * (_length(u) + _length(v))
    return dot(u, v) >= -least and _length(cross(u, v)) <= least


@kernel(allocates=False)
def _are_apart_in_space(a, b, c, d):
    """Return whether a plane surely has the cone of a and b on one side, that of c and d on the other.

    If any does, so does one through two of the four vectors.
    """
    abd, abc = _side(a, b, d), _side(a, b, c)
    if abd * abc > 0:
        return True
    bcd, acd = _side(b, c, d), _side(a, c, d)
    return bcd * acd > 0 or acd * abc > 0 or acd * abd < 0 or bcd * abc < 0 or bcd * abd > 0


@kernel(allocates=False)
def _side(a, b, c):
    """Return the sign of the volume of three vectors; 0 if rounding may change it."""
    la, lb, lc = _length(a), _length(b), _length(c)
    volume, least = dot(cross(a, b), c), ROUNDING * (la * lb + lb * lc + lc * la)
    return int(volume > least) - int(volume < -least)


@kernel(allocates=False)
def _are_apart_in_plane(a, b, c, d):
    """Return whether a line surely parts the cone of a and b from that of c and d, all in about one plane."""
    up, other = cross(a, b), cross(c, d)
    if dot(other, other) > dot(up, up):
        up = other
    rays = unit(a), unit(b), unit(minus((0.0, 0.0, 0.0), c)), unit(minus((0.0, 0.0, 0.0), d))
    for i in range(4):
        for j in range(4):
            axis = cross(up, minus(rays[i], rays[j]))
            least = ROUNDING * _length(axis)
            if min(dot(axis, a), dot(axis, b)) > least and max(dot(axis, c), dot(axis, d)) < -least:
                return True
    return False


@kernel(allocates=False)
def _may_have_common_place(a, b, p, q, r):
    """Return whether no axis surely parts the triangles 0 a b and p q r."""
    up, other = cross(a, b), area_vector(p, q, r)
    if _part(up, a, b, p, q, r) or _part(other, a, b, p, q, r):
        return False
    edges, others = (a, b, minus(b, a)), (minus(q, p), minus(r, p), minus(r, q))
    for i in range(3):
        for j in range(3):
            if _part(cross(edges[i], others[j]), a, b, p, q, r):
                return False
    for i in range(3):
        if _part(cross(up, edges[i]), a, b, p, q, r) or _part(cross(other, others[i]), a, b, p, q, r):
            return False
    return True


@kernel(allocates=False)
def _part(axis, a, b, p, q, r):
    """Return whether the triangles 0 a b and p q r surely lie apart along an axis."""
    at_a, at_b, at_p, at_q, at_r = dot(axis, a), dot(axis, b), dot(axis, p), dot(axis, q), dot(axis, r)
    least = ROUNDING * _length(axis)
    return min(at_p, at_q, at_r) - max(at_a, at_b, 0.0) > least or min(at_a, at_b, 0.0) - max(at_p, at_q, at_r) > least


@kernel
def _length(a):
    """Return the length of a vector."""
    return np.sqrt(dot(a, a))
