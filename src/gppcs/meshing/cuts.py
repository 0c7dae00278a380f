"""Triangles that cut others: found by a tree of boxes, which follows the changes of the mesh."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.halfedges import HalfEdges
from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range
from gppcs.spatial.triangles import area_vector, cross, dot, minus, row

PARALLEL = 1e-18  # an edge lies in a plane if the squared sine of their angle is below this
TRIANGLES_AT_ONCE = 256  # triangles that a thread looks at at once, at least
DEEPEST = 64  # nodes that wait in a search; a tree of fewer than 2^62 leaves has no more


class TriangleTree(NamedTuple):
    """Boxes around triangles, in the nodes of a `KdTree` over their centroids.

    Attributes
    ----------
    order : (f,) array, int64
        The triangles that were there when the tree was built, in tree order.
    leaf : (F,) array, int64
        The leaf of each triangle; -1 for one that was not there.
    low, high : (nodes, 3) arrays, float64
        Corners of the boxes; row 0 is unused.
    """

    order: NDArray[np.int64]
    leaf: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def of(cls, mesh: HalfEdges, vertices: NDArray[np.float64]) -> Self:
        """Build the tree of the triangles of a mesh.

        Shapes: vertices (V, 3).
        """
        there = np.flatnonzero(mesh.origin[::3] >= 0)
        points = KdTree.build(vertices[mesh.origin.reshape(-1, 3)[there]].mean(axis=1))
        low, high = np.full_like(points.low, np.inf), np.full_like(points.high, -np.inf)
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
    """Widen the boxes of a tree after the triangle f has changed.

    Shapes: vertices (V, 3).
    """
    node = tree.leaf[f]
    while node > 0:
        _widen(mesh, vertices, tree, f, node)
        node //= 2


def cutting(mesh: HalfEdges, vertices: NDArray[np.float64], tree: TriangleTree | None = None) -> NDArray[np.int64]:
    """Return the triangles that cut another one.

    Triangles with a common edge do not cut each other, and those in one plane are not looked for.

    Shapes: vertices (V, 3); returns (m,).
    """
    found = np.zeros(len(mesh.origin) // 3, dtype=np.bool_)
    if len(mesh.faces()):
        tree = tree or TriangleTree.of(mesh, vertices)
        inside = np.zeros_like(found)
        on_ranges(_mark_cutting, len(found), mesh, vertices, tree, inside, found, least=TRIANGLES_AT_ONCE)
    return np.flatnonzero(found)


@kernel
def _mark_cutting(begin, end, mesh, vertices, tree, inside, found):
    """Mark in `found`, (F,), the triangles of a range that cut others."""
    for f in range(begin, end):
        a, b, c = mesh.origin[3 * f], mesh.origin[3 * f + 1], mesh.origin[3 * f + 2]
        found[f] = a >= 0 and first_cut(mesh, vertices, tree, inside, a, b, c) >= 0


@kernel
def first_cut(mesh, vertices, tree, inside, a, b, c):
    """Return a triangle of a mesh that a triangle cuts.

    Shapes: vertices (V, 3), inside (F,).
    """
    pa, pb, pc = row(vertices, a), row(vertices, b), row(vertices, c)
    low = min(pa[0], pb[0], pc[0]), min(pa[1], pb[1], pc[1]), min(pa[2], pb[2], pc[2])
    high = max(pa[0], pb[0], pc[0]), max(pa[1], pb[1], pc[1]), max(pa[2], pb[2], pc[2])
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
            if d < 0 or inside[f] or not _may_meet(vertices, low, high, d, e, g):
                continue
            if are_cut(vertices, (a, b, c), (d, e, g)):
                return f
    return -1


@kernel(allocates=False)
def _may_meet(vertices, low, high, a, b, c):
    """Return whether the box around a triangle meets another."""
    pa, pb, pc = row(vertices, a), row(vertices, b), row(vertices, c)
    least = min(pa[0], pb[0], pc[0]), min(pa[1], pb[1], pc[1]), min(pa[2], pb[2], pc[2])
    most = max(pa[0], pb[0], pc[0]), max(pa[1], pb[1], pc[1]), max(pa[2], pb[2], pc[2])
    return _overlap(low, high, least, most)


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
    """Return whether two triangles cut each other.

    Shapes: vertices (V, 3).
    """
    shared = at_f = at_g = 0
    for i in range(3):
        for j in range(3):
            if f[i] == g[j]:
                shared, at_f, at_g = shared + 1, i, j
    if shared > 1:  # with three, they are the same triangle, or one lies on the other
        return shared == 3 and f[(at_f + 1) % 3] != g[(at_g + 1) % 3]
    for this, other, corner in ((f, g, at_f), (g, f, at_g)):
        a, b, c = row(vertices, other[0]), row(vertices, other[1]), row(vertices, other[2])
        for k in range(3):
            i = (corner + 1 + k) % 3  # with a shared corner, the edge opposite to it comes first
            if _crosses(row(vertices, this[i]), row(vertices, this[(i + 1) % 3]), a, b, c):
                return True
            if shared:
                break
    return False


@kernel(allocates=False)
def _crosses(p, q, a, b, c):
    """Return whether a segment from p to q goes through a triangle."""
    normal, step, turned = area_vector(a, b, c), minus(q, p), cross(minus(q, p), minus(p, a))
    above, below = dot(minus(p, a), normal), dot(minus(q, a), normal)
    height = below - above
    if above * below > 0.0 or height * height <= PARALLEL * dot(normal, normal) * dot(step, step):
        return False
    v, w = dot(minus(c, a), turned) / height, -dot(minus(b, a), turned) / height
    return v >= 0.0 and w >= 0.0 and v + w <= 1.0
