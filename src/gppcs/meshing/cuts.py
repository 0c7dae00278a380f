"""Triangles that cut others: found by a tree of boxes, which follows the changes of the mesh.

Two triangles cut each other if they have more in common than their common corners, be it a single point. Only what
rounding cannot change counts as separate. So where no cut is found, there is none.
"""

from typing import NamedTuple, Self

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.halfedges import HalfEdges
from gppcs.spatial.kdtree import LEAF_SIZE, KdTree, after, first_leaf, join_boxes, leaf_range
from gppcs.spatial.triangles import area_vector, cross, dot, has_area, minus, row, unit

ROUNDING = 2.0**-48  # of coordinates and their differences, generously, as clouds are of about unit size


class TriangleTree(NamedTuple):
    """Boxes around triangles, in the nodes of a `KdTree` over their centroids."""

    order: Ints  # (f,): the triangles that were there when the tree was built, in tree order
    leaf: Ints  # (F,): the leaf of each triangle; -1 for one that was not there
    lower: Floats  # (nodes, 3): corners of the boxes; row 0 is unused
    upper: Floats  # (nodes, 3): corners of the boxes; row 0 is unused

    @classmethod
    def from_mesh(cls, mesh: HalfEdges, vertices: Floats) -> Self:
        """Build the tree of the triangles of a mesh."""
        faces = np.flatnonzero(mesh.origin[::3] >= 0)
        centroids = np.empty((len(faces), 3))
        on_ranges(_fill_centroids, len(faces), mesh, vertices, faces, centroids, minimum=1024)
        built = KdTree.build(centroids)
        lower, upper = np.full(built.lower.shape, np.inf), np.full(built.lower.shape, -np.inf)
        tree = cls(faces[built.order], np.full(len(mesh.corners()), -1), lower, upper)
        on_ranges(_fill_leaves, built.leaves, mesh, vertices, tree, minimum=32)
        join_boxes(tree.lower, tree.upper)
        return tree

    @classmethod
    def empty(cls) -> Self:
        """Return a tree without triangles, which nothing cuts."""
        return cls(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 3)))


@kernel(allocates=False)
def _fill_centroids(begin, end, mesh, vertices, faces, centroids):
    """Fill the centroids, (f, 3), of a range of triangles."""
    for i in range(begin, end):
        h = 3 * faces[i]
        a, b, c = row(vertices, mesh.origin[h]), row(vertices, mesh.origin[h + 1]), row(vertices, mesh.origin[h + 2])
        for axis in range(3):
            centroids[i, axis] = (a[axis] + b[axis] + c[axis]) / 3.0


@kernel(allocates=False)
def _fill_leaves(begin, end, mesh, vertices, tree):
    """Fill the boxes of a range of leaves, and the leaf of each triangle in them."""
    leaves = first_leaf(tree.lower)
    for node in range(leaves + begin, leaves + end):
        first, last = leaf_range(len(tree.order), leaves, node)
        for f in tree.order[first:last]:
            tree.leaf[f] = node
            for h in range(3 * f, 3 * f + 3):
                for axis in range(3):
                    x = vertices[mesh.origin[h], axis]
                    tree.lower[node, axis] = min(tree.lower[node, axis], x)
                    tree.upper[node, axis] = max(tree.upper[node, axis], x)


@kernel(allocates=False)
def follow(mesh, vertices, tree, f):
    """Widen the boxes of a tree after the triangle f has changed; an empty tree has none."""
    node = tree.leaf[f] if len(tree.leaf) else 0
    while node > 0:
        for h in range(3 * f, 3 * f + 3):
            for axis in range(3):
                x = vertices[mesh.origin[h], axis]
                tree.lower[node, axis] = min(tree.lower[node, axis], x)
                tree.upper[node, axis] = max(tree.upper[node, axis], x)
        node //= 2


def cutting(mesh: HalfEdges, vertices: Floats, tree: TriangleTree | None = None, among: Ints | None = None) -> Ints:
    """Return which triangles cut another one or have no area: of all, which the tree has, or of some."""
    cut = np.zeros(len(mesh.corners()), dtype=np.bool_)
    if among is None:
        tree = tree or TriangleTree.from_mesh(mesh, vertices)
        on_ranges(_mark_in_leaves, len(tree.lower) // 2, mesh, vertices, tree, cut, minimum=8)
        return np.flatnonzero(cut)
    faces = among[mesh.origin[3 * among] >= 0]
    if len(faces):
        inside = np.zeros(len(cut), dtype=np.bool_)
        tree = tree or TriangleTree.from_mesh(mesh, vertices)
        on_ranges(_mark_cutting, len(faces), mesh, vertices, tree, inside, faces, cut, minimum=256)
    return faces[cut[faces]]


@kernel
def _mark_in_leaves(begin, end, mesh, vertices, tree, cut):
    """Mark in `cut`, (F,), the triangles that cut others or have no area; of two leaves, the first one tests both."""
    leaves = first_leaf(tree.lower)
    boxes, near_boxes = np.empty((LEAF_SIZE, 2, 3)), np.empty((LEAF_SIZE, 2, 3))
    for leaf in range(leaves + begin, leaves + end):
        first, last = leaf_range(len(tree.order), leaves, leaf)
        faces = tree.order[first:last]
        _fill_boxes(mesh, vertices, faces, boxes)
        for f in faces:
            a, b, c = mesh.origin[3 * f], mesh.origin[3 * f + 1], mesh.origin[3 * f + 2]
            if a >= 0 and not has_area(row(vertices, a), row(vertices, b), row(vertices, c)):
                cut[f] = True
        lower, upper, node = row(tree.lower, leaf), row(tree.upper, leaf), 1
        while node:
            near = _overlap(lower, upper, row(tree.lower, node), row(tree.upper, node))
            if near and node < leaves:
                node *= 2
                continue
            if near and node >= leaf:
                first, last = leaf_range(len(tree.order), leaves, node)
                near_faces = tree.order[first:last]
                _fill_boxes(mesh, vertices, near_faces, near_boxes)
                _mark_between(mesh, vertices, faces, boxes, near_faces, near_boxes, node == leaf, cut)
            node = after(node, 1)


@kernel(allocates=False)
def _fill_boxes(mesh, vertices, faces, boxes):
    """Fill the corners of the boxes, (LEAF_SIZE, 2, 3), around triangles, (m,); those of removed ones overlap none."""
    for i in range(len(faces)):
        h = 3 * faces[i]
        lower, upper = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
        if mesh.origin[h] >= 0:
            lower, upper = _box(vertices, mesh.origin[h], mesh.origin[h + 1], mesh.origin[h + 2])
        for axis in range(3):
            boxes[i, 0, axis], boxes[i, 1, axis] = lower[axis], upper[axis]


@kernel(allocates=False)
def _mark_between(mesh, vertices, faces, boxes, near_faces, near_boxes, is_same, cut):
    """Mark triangles, (m,), that cut near ones, (k,), or later ones if these are the same; mark both."""
    for i in range(len(faces)):
        lower, upper = row(boxes[i], 0), row(boxes[i], 1)
        for j in range(i + 1 if is_same else 0, len(near_faces)):
            if not _overlap(lower, upper, row(near_boxes[j], 0), row(near_boxes[j], 1)):
                continue
            f, g = 3 * faces[i], 3 * near_faces[j]
            corners = mesh.origin[f], mesh.origin[f + 1], mesh.origin[f + 2]
            if are_cut(vertices, corners, (mesh.origin[g], mesh.origin[g + 1], mesh.origin[g + 2])):
                cut[faces[i]] = cut[near_faces[j]] = True


@kernel
def _mark_cutting(begin, end, mesh, vertices, tree, inside, faces, cut):
    """Mark in `cut`, (F,), which of the triangles `faces`, (m,), cut others; for a range of these."""
    for i in range(begin, end):
        cut[faces[i]] = is_cut(mesh, vertices, tree, inside, faces[i])


@kernel
def is_cut(mesh, vertices, tree, inside, f):
    """Return whether a triangle of the mesh has no area or cuts another; those marked in `inside` do not count."""
    a, b, c = mesh.origin[3 * f], mesh.origin[3 * f + 1], mesh.origin[3 * f + 2]
    if not has_area(row(vertices, a), row(vertices, b), row(vertices, c)):
        return True
    return cuts_tree(mesh, vertices, tree, inside, a, b, c)


@kernel
def is_free(mesh, vertices, tree, inside, patch, new):
    """Return whether new triangles, (T, 3), cut none of a tree that is not of a patch, (P,), and none of each other."""
    if len(tree.order) == 0:
        return True
    inside[patch] = True
    free = True
    for i in range(len(new)):
        free = free and not cuts_tree(mesh, vertices, tree, inside, new[i, 0], new[i, 1], new[i, 2])
        free = free and not cuts_earlier(vertices, new, i)
    inside[patch] = False
    return free


@kernel(allocates=False)
def cuts_earlier(vertices, new, i):
    """Return whether a triangle, of (T, 3), cuts one of those before it."""
    f = row(new, i)
    for j in range(i):  # noqa: SIM110 (Numba has no generators)
        if are_cut(vertices, f, row(new, j)):
            return True
    return False


@kernel(allocates=False)
def cuts_tree(mesh, vertices, tree, inside, a, b, c):
    """Return whether a triangle cuts one of a mesh that is not marked in `inside`, (F,)."""
    lower, upper = _box(vertices, a, b, c)
    leaves, node = first_leaf(tree.lower), 1
    while node:
        near = _overlap(lower, upper, row(tree.lower, node), row(tree.upper, node))
        if near and node < leaves:
            node *= 2
            continue
        begin, end = leaf_range(len(tree.order), leaves, node) if near else (0, 0)
        for f in tree.order[begin:end]:
            d, e, g = mesh.origin[3 * f], mesh.origin[3 * f + 1], mesh.origin[3 * f + 2]
            if d < 0 or inside[f]:
                continue
            minimum, maximum = _box(vertices, d, e, g)
            if _overlap(lower, upper, minimum, maximum) and are_cut(vertices, (a, b, c), (d, e, g)):
                return True
        node = after(node, 1)
    return False


@kernel(allocates=False)
def _box(vertices, a, b, c):
    """Return the corners of the box around a triangle."""
    pa, pb, pc = row(vertices, a), row(vertices, b), row(vertices, c)
    lower = min(pa[0], pb[0], pc[0]), min(pa[1], pb[1], pc[1]), min(pa[2], pb[2], pc[2])
    return lower, (max(pa[0], pb[0], pc[0]), max(pa[1], pb[1], pc[1]), max(pa[2], pb[2], pc[2]))


@kernel
def _overlap(lower_a, upper_a, lower_b, upper_b):
    """Return whether two boxes overlap."""
    return (
        lower_a[0] <= upper_b[0] and upper_a[0] >= lower_b[0]
        and lower_a[1] <= upper_b[1] and upper_a[1] >= lower_b[1]
        and lower_a[2] <= upper_b[2] and upper_a[2] >= lower_b[2]
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
        return not (_are_separated_in_space(a, b, c, d) or _are_separated_in_plane(a, b, c, d))
    return _may_meet(a, b, minus(row(vertices, g[at_g]), p), c, d)


@kernel(allocates=False)
def _is_folded(edge, a, b):
    """Return whether two triangles at a common edge, with the third corners a and b, lie on one another."""
    u, v = cross(edge, a), cross(edge, b)
    lengths = _length(edge) + _length(a) + _length(b)
    rounding = ROUNDING * lengths * (_length(u) + _length(v))
    return dot(u, v) >= -rounding and _length(cross(u, v)) <= rounding


@kernel(allocates=False)
def _are_separated_in_space(a, b, c, d):
    """Return whether a plane, which can be one through two of the four, surely separates the cones a b and c d."""
    abd, abc = _side(a, b, d), _side(a, b, c)
    if abd * abc > 0:
        return True
    bcd, acd = _side(b, c, d), _side(a, c, d)
    return bcd * acd > 0 or acd * abc > 0 or acd * abd < 0 or bcd * abc < 0 or bcd * abd > 0


@kernel(allocates=False)
def _side(a, b, c):
    """Return the sign of the volume of three vectors; 0 if rounding may change it."""
    la, lb, lc = _length(a), _length(b), _length(c)
    volume, rounding = dot(cross(a, b), c), ROUNDING * (la * lb + lb * lc + lc * la)
    return int(volume > rounding) - int(volume < -rounding)


@kernel(allocates=False)
def _are_separated_in_plane(a, b, c, d):
    """Return whether a line surely separates the cone of a and b from that of c and d, all in about one plane."""
    up, up_p = cross(a, b), cross(c, d)
    if dot(up_p, up_p) > dot(up, up):
        up = up_p
    rays = unit(a), unit(b), unit(minus((0.0, 0.0, 0.0), c)), unit(minus((0.0, 0.0, 0.0), d))
    for i in range(4):
        for j in range(4):
            axis = cross(up, minus(rays[i], rays[j]))
            rounding = ROUNDING * _length(axis)
            if min(dot(axis, a), dot(axis, b)) > rounding and max(dot(axis, c), dot(axis, d)) < -rounding:
                return True
    return False


@kernel(allocates=False)
def _may_meet(a, b, p, q, r):
    """Return whether no axis surely separates the triangles 0 a b and p q r."""
    up, up_p = cross(a, b), area_vector(p, q, r)
    if _separates(up, a, b, p, q, r) or _separates(up_p, a, b, p, q, r):
        return False
    edges, edges_p = (a, b, minus(b, a)), (minus(q, p), minus(r, p), minus(r, q))
    for i in range(3):
        for j in range(3):
            if _separates(cross(edges[i], edges_p[j]), a, b, p, q, r):
                return False
    for i in range(3):
        if _separates(cross(up, edges[i]), a, b, p, q, r) or _separates(cross(up_p, edges_p[i]), a, b, p, q, r):
            return False
    return True


@kernel(allocates=False)
def _separates(axis, a, b, p, q, r):
    """Return whether the triangles 0 a b and p q r are surely separated along an axis."""
    at_a, at_b, at_p, at_q, at_r = dot(axis, a), dot(axis, b), dot(axis, p), dot(axis, q), dot(axis, r)
    gap = max(min(at_p, at_q, at_r) - max(at_a, at_b, 0.0), min(at_a, at_b, 0.0) - max(at_p, at_q, at_r))
    return gap > ROUNDING * _length(axis)


@kernel
def _length(a):
    """Return the length of a vector."""
    return np.sqrt(dot(a, a))
