"""Vectors of three numbers for kernels, and the nearest point of a triangle, and of many."""

import math

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.box_distances import squared_distance_to_box
from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range, measure_boxes, nearer_child, unvisited_sibling


@kernel(fastmath=False)
def dot(a, b):
    """Return the dot product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel(fastmath=False)
def minus(a, b):
    """Return the difference a - b of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel(allocates=False)
def row(points, i):
    """Return a row of an array as a tuple. Shapes: points (n, 3)."""
    return points[i, 0], points[i, 1], points[i, 2]


@kernel(fastmath=False)
def cross(a, b):
    """Return the cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def unit(a):
    """Return a vector of the same direction and of length one; the vector itself if it is zero."""
    length = dot(a, a) ** 0.5
    return (a[0] / length, a[1] / length, a[2] / length) if length > 0.0 else a


@kernel
def area_vector(a, b, c):
    """Return the normal of a triangle whose length is twice its area."""
    return cross(minus(b, a), minus(c, a))


@kernel
def has_area(a, b, c):
    """Return whether a triangle has an area that rounding cannot explain: 1e-9 of its sum of squared edges."""
    normal, ab, bc, ca = area_vector(a, b, c), minus(b, a), minus(c, b), minus(a, c)
    return dot(normal, normal) > (1e-9 * (dot(ab, ab) + dot(bc, bc) + dot(ca, ca))) ** 2


@kernel(allocates=False)
def agreement(normal, normals, a, b, c):
    """Return the sum of the dot products of a triangle's normal with those of its corners, of (V, 3)."""
    return dot(normal, row(normals, a)) + dot(normal, row(normals, b)) + dot(normal, row(normals, c))


@kernel
def quality(a, b, c):
    """Return the quality of a triangle: 4 sqrt(3) times its area over the sum of its squared edges."""
    normal = area_vector(a, b, c)
    ab, bc, ca = minus(b, a), minus(c, b), minus(a, c)
    squared = dot(ab, ab) + dot(bc, bc) + dot(ca, ca)
    return 3.4641016151377544 * dot(normal, normal) ** 0.5 / squared if squared > 0.0 else 0.0


@kernel
def qualities(vertices, faces):
    """Return the qualities of triangles, (F,)."""
    values = np.empty(len(faces))
    for f in range(len(faces)):
        values[f] = quality(row(vertices, faces[f, 0]), row(vertices, faces[f, 1]), row(vertices, faces[f, 2]))
    return values


@kernel(inline="always")
def circumradius(a, b, c):
    """Return the radius of the circle through three points."""
    ab, bc, ca = minus(b, a), minus(c, b), minus(a, c)
    normal = area_vector(a, b, c)
    area = dot(normal, normal) ** 0.5
    product = (dot(ab, ab) * dot(bc, bc) * dot(ca, ca)) ** 0.5
    return product / (2.0 * area) if area > 0.0 else math.inf


@kernel
def nearest_in_triangle(a, b, c):
    """Return v and w such that a + v (b - a) + w (c - a) is nearest to the origin (Ericson, section 5.1.5)."""
    ab, ac = minus(b, a), minus(c, a)
    ab_a, ac_a, ab_b, ac_b, ab_c, ac_c = dot(ab, a), dot(ac, a), dot(ab, b), dot(ac, b), dot(ab, c), dot(ac, c)
    if ab_a >= 0.0 and ac_a >= 0.0:
        return 0.0, 0.0
    if ab_b <= 0.0 and ac_b >= ab_b:
        return 1.0, 0.0
    if ac_c <= 0.0 and ab_c >= ac_c:
        return 0.0, 1.0
    beside_ab, beside_ac, beside_bc = ab_a * ac_b - ab_b * ac_a, ab_c * ac_a - ab_a * ac_c, ab_b * ac_c - ab_c * ac_b
    if beside_ab <= 0.0 and ab_a <= 0.0 <= ab_b:
        return ab_a / (ab_a - ab_b), 0.0
    if beside_ac <= 0.0 and ac_a <= 0.0 <= ac_c:
        return 0.0, ac_a / (ac_a - ac_c)
    if beside_bc <= 0.0 and ab_b >= ac_b and ac_c >= ab_c:
        along = (ab_b - ac_b) / (ab_b - ac_b + ac_c - ab_c)
        return 1.0 - along, along
    area = beside_ab + beside_ac + beside_bc
    return beside_ac / area, beside_ab / area


@kernel
def point_in(a, b, c, v, w):
    """Return the point a + v (b - a) + w (c - a) of a triangle."""
    return (
        a[0] + v * (b[0] - a[0]) + w * (c[0] - a[0]),
        a[1] + v * (b[1] - a[1]) + w * (c[1] - a[1]),
        a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2]),
    )


@kernel
def squared_distance(a, b, c, v, w):
    """Return the squared length of a + v (b - a) + w (c - a)."""
    point = point_in(a, b, c, v, w)
    return dot(point, point)


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def approach(points, squared, a, b, c):
    """Lower the squared distances, (n,), of the first points, of (3, m), to those from a triangle, without branches.

    The points are contiguous: loops over parts of rows are vectorised, those over a part of all rows are not.
    """
    ab, bc, ca = minus(b, a), minus(c, b), minus(a, c)
    normal = cross(ab, minus(c, a))
    off_ab, off_bc, off_ca = cross(ab, normal), cross(bc, normal), cross(ca, normal)  # out of the triangle
    by_area, by_ab = 1.0 / max(dot(normal, normal), 1e-300), 1.0 / max(dot(ab, ab), 1e-300)
    by_bc, by_ca = 1.0 / max(dot(bc, bc), 1e-300), 1.0 / max(dot(ca, ca), 1e-300)
    x, y, z = points[0], points[1], points[2]
    for q in range(len(squared)):
        here = x[q], y[q], z[q]
        of_a, of_b, of_c = minus(here, a), minus(here, b), minus(here, c)
        outside = max(dot(of_a, off_ab), dot(of_b, off_bc), dot(of_c, off_ca))
        height = dot(of_a, normal)
        edges = min(
            _squared_from_edge(of_a, ab, by_ab),
            _squared_from_edge(of_b, bc, by_bc),
            _squared_from_edge(of_c, ca, by_ca),
        )
        nearest = edges if outside > 0.0 or by_area > 1e299 else height * height * by_area
        squared[q] = min(squared[q], nearest)


@kernel(inline="always", fastmath={"nsz", "arcp", "contract", "reassoc"})
def _squared_from_edge(step, edge, by_squared):
    """Return the squared distance of a step from an edge, with 1 over the squared length of this."""
    along = min(max(dot(step, edge) * by_squared, 0.0), 1.0)
    x, y, z = step[0] - along * edge[0], step[1] - along * edge[1], step[2] - along * edge[2]
    return x * x + y * y + z * z


def nearest_triangles(vertices: Floats, faces: Ints, queries: Floats) -> tuple[Ints, Floats, Floats]:
    """Find the nearest of triangles, (F, 3), to each query, (N, 3), exactly, by a tree of boxes.

    Returns its number, (N,), the squared distance, (N,), and the barycentric coordinates of the nearest point on it for
    its second and its third corner, (N, 2).
    """
    in_tree_order = KdTree.build(vertices[faces].mean(axis=1)).order
    corners, leaves = vertices[faces[in_tree_order]], 1
    while len(faces) > 4 * leaves:
        leaves *= 2
    lower, upper, unused = np.empty((3, 2 * leaves, 3))
    measure_boxes(np.ascontiguousarray(corners.min(axis=1).T), lower, unused)
    measure_boxes(np.ascontiguousarray(corners.max(axis=1).T), unused, upper)
    count = len(queries)
    nearest, squared, weights = np.zeros(count, dtype=np.int64), np.empty(count), np.empty((count, 2))
    order = KdTree.build(queries).order  # queries after each other see the same triangles, in the cache
    on_ranges(_find_all, count, corners, lower, upper, queries, order, nearest, squared, weights, minimum=256)
    return in_tree_order[nearest], squared, weights


@kernel
def _find_all(first, last, corners, lower, upper, queries, order, nearest, squared, weights):
    """Find the nearest triangles of a range of the queries in their order."""
    leaves = first_leaf(lower)
    for i in order[first:last]:
        query, smallest, node, visited = row(queries, i), np.inf, 1, 0
        while node:
            if squared_distance_to_box(lower[node], upper[node], *query) < smallest:
                if node < leaves:
                    node, visited = nearer_child(node, lower, upper, *query), 2 * visited
                    continue
                for f in range(*leaf_range(len(corners), leaves, node)):
                    a = minus(row(corners[f], 0), query)
                    b = minus(row(corners[f], 1), query)
                    c = minus(row(corners[f], 2), query)
                    d, s, t = _nearest_of_one(a, b, c)
                    if d < smallest:
                        smallest = d
                        nearest[i], weights[i, 0], weights[i, 1] = f, s, t
            node, visited = unvisited_sibling(node, visited)
        squared[i] = smallest


@kernel(allocates=False)
def _nearest_of_one(a, b, c):
    """Return the squared distance of a triangle to the origin, and where it is nearest; without area, of its edges."""
    if has_area(a, b, c):
        s, t = nearest_in_triangle(a, b, c)
        return squared_distance(a, b, c, s, t), s, t
    ab, _ = nearest_in_triangle(a, b, b)
    ac, _ = nearest_in_triangle(a, c, c)
    bc, _ = nearest_in_triangle(b, c, c)
    best = squared_distance(a, b, c, ab, 0.0), ab, 0.0
    for s, t in ((0.0, ac), (1.0 - bc, bc)):
        d = squared_distance(a, b, c, s, t)
        if d < best[0]:
            best = d, s, t
    return best
