"""Fit one vertex to the dense points of the triangles around it, its star, while all other vertices stay."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.flips import SHARP, price, thinness
from gppcs.meshing.halfedges import MOST_AROUND, Floats, HalfEdges, Ints, around, following, preceding
from gppcs.meshing.quadrics import add_borders
from gppcs.spatial.kdtree import KdTree, nearest_in_tree
from gppcs.spatial.triangles import area_vector, dot, has_area, minus, nearest_in_triangle, row, squared_distance, unit
from gppcs.surface.error_quadrics import NUMBERS, add_moved, value

SLIDE = 0.02  # weight of a point's step along its triangle, which costs no distance, beside that off it
PULL = 1e-3  # weight with which the vertex is held where it is, beside all its points
STEPS = 3  # of Gauss and Newton at most
ENOUGH = 0.99  # a step that leaves more of the energy is the last one
NEAR = 0.4  # a point is near the vertex if this is its weight at least: without such points, nothing holds it
TURN = -0.3  # least cosine between the normals of neighbouring triangles
ALONG = 1e-9  # weights of a corner below this are zero


class Surface(NamedTuple):
    """A mesh, and the dense points in its triangles. Kernels change it in place."""

    mesh: HalfEdges
    vertices: Floats  # (V, 3)
    borders: Floats  # (V, 10): quadrics of the planes through borders, which keep these where they are
    points: Floats  # (n, 3)
    assigned: Assignment
    first: Ints  # (F,): a point of each triangle, -1 if it has none
    after: Ints  # (n,): the next point of the same triangle, -1 after the last one
    limit: float  # of the squared distances of points; infinity if there is none
    reaches: Floats  # (m,): how far a vertex may be from each point with a triangle, if it is the nearest one; squared
    bounded: Floats  # (3, m): with a limit, these points, in the order of a tree
    low: Floats  # (nodes, 3): the boxes of that tree
    high: Floats  # (nodes, 3)

    @classmethod
    def of(cls, mesh: HalfEdges, vertices: Floats, points: Floats, assigned: Assignment) -> Self:
        """List the points of each triangle, without a limit to their distances."""
        return cls._of(mesh, vertices, points, assigned, np.inf, np.empty(0), KdTree.over(np.empty((3, 0))))

    @classmethod
    def within(
        cls, mesh: HalfEdges, vertices: Floats, points: Floats, assigned: Assignment, limit: float, reaches: Floats
    ) -> Self:
        """List the points of each triangle, with a limit to their squared distances, and squared reaches, (n,).

        The points are in the order of a tree.
        """
        there = assigned.face >= 0
        tree = KdTree.over(np.ascontiguousarray(points[there].T))
        return cls._of(mesh, vertices, points, assigned, limit, reaches[there], tree)

    @classmethod
    def _of(
        cls,
        mesh: HalfEdges,
        vertices: Floats,
        points: Floats,
        assigned: Assignment,
        limit: float,
        reaches: Floats,
        tree: KdTree,
    ) -> Self:
        """List the points of each triangle; the tree is over those that have reaches."""
        borders = np.zeros((len(vertices), NUMBERS))
        add_borders(mesh, vertices, len(points) / np.count_nonzero(mesh.leaving >= 0), borders)
        first, after = np.full(len(mesh.origin) // 3, -1), np.full(len(points), -1)
        surface = cls(
            mesh, vertices, borders, points, assigned, first, after, limit, reaches, tree.points, tree.lower, tree.upper
        )
        _list_points(surface)
        return surface


class Star(NamedTuple):
    """The triangles around a vertex, which is not part of it, counter-clockwise, and their dense points."""

    sizes: Ints  # (2,): the numbers of triangles and of points
    edges: Ints  # (triangles,): the half-edge of each that leads around the vertex
    ends: Floats  # (triangles, 2, 3): where these begin and end
    members: Ints  # (points,)
    triangles: Ints  # (points,): the nearest triangle of each; -1 before it is known
    weights: Floats  # (points, 2): barycentric coordinates of the nearest place, for the ends of the triangle's edge
    squared: Floats  # (points,): squared distances
    worst: Floats  # (1,): the largest squared distance before any change
    quadric: Floats  # (10,): that of the vertex's borders, relative to `base`
    base: Floats  # (3,)
    halves: Ints  # room for the ways around one vertex, and around another
    found: Ints
    others: Ints
    beyond: Ints
    nearest: Ints  # (1,): room for the point nearest to the vertex, and for its squared distance
    gap: Floats


@kernel
def room_for_star(n):
    """Return the arrays of a star with at most n points."""
    around = MOST_AROUND + 1
    return Star(
        np.zeros(2, dtype=np.int64), np.empty(2 * around, dtype=np.int64), np.empty((2 * around, 2, 3)),
        np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64), np.empty((n, 2)), np.empty(n),
        np.zeros(1), np.zeros(NUMBERS), np.zeros(3),
        np.empty(around, dtype=np.int64), np.empty(around, dtype=np.int64),
        np.empty(around, dtype=np.int64), np.empty(around, dtype=np.int64),
        np.empty(1, dtype=np.int64), np.empty(1),
    )  # fmt: skip


@kernel(allocates=False)
def _list_points(surface):
    """Fill the lists of the points of each triangle, which are empty."""
    for i in range(len(surface.points)):
        f = surface.assigned.face[i]
        if f >= 0:
            surface.after[i] = surface.first[f]
            surface.first[f] = i


@kernel(allocates=False)
def empty(star, place):
    """Take all triangles and points out of a star, and let its quadric be zero, relative to a place."""
    star.sizes[0] = star.sizes[1] = 0
    star.worst[0] = 0.0
    star.quadric[:] = 0.0
    star.base[0], star.base[1], star.base[2] = place


@kernel(allocates=False)
def add_triangle(surface, star, edge):
    """Add the triangle to the left of a half-edge to a star, without points; return its number there."""
    k = star.sizes[0]
    star.edges[k], star.sizes[0] = edge, k + 1
    for axis in range(3):
        star.ends[k, 0, axis] = surface.vertices[surface.mesh.origin[edge], axis]
        star.ends[k, 1, axis] = surface.vertices[surface.mesh.origin[following(edge)], axis]
    return k


@kernel(allocates=False)
def add_points(surface, star, f, nearest):
    """Add the points of a triangle to a star, with a triangle of this that may be the nearest; return their energy."""
    energy, count, i = 0.0, star.sizes[1], surface.first[f]
    while i >= 0:
        star.members[count], star.triangles[count] = i, nearest
        count += 1
        energy += price(surface.assigned.squared[i], surface.limit)
        star.worst[0] = max(star.worst[0], surface.assigned.squared[i])
        i = surface.after[i]
    star.sizes[1] = count
    return energy


@kernel(allocates=False)
def add_around(surface, star, v, other, extra):
    """Add the triangles around a vertex to a star, from its neighbour `other` on; return the energy of these.

    The triangles that have `other`, too, are not part of the star. Their points are, if `other` is the larger number.
    """
    mesh, here = surface.mesh, row(surface.vertices, v)
    add_moved(surface.borders[v], minus((star.base[0], star.base[1], star.base[2]), here), star.quadric)
    edges, _ = around(mesh, v, star.halves)
    energy, begin = surface.borders[v, 9], 0
    for step in range(edges):
        if mesh.origin[following(star.halves[step])] == other:
            begin = step
    for step in range(edges):
        edge = following(star.halves[(begin + step) % edges])
        a, b = mesh.origin[edge], mesh.origin[following(edge)]
        if a != other and b != other:
            energy += add_points(surface, star, edge // 3, add_triangle(surface, star, edge))
        elif v < other:
            energy += add_points(surface, star, edge // 3, -1)
        else:
            continue
        energy += extra * thinness(here, row(surface.vertices, a), row(surface.vertices, b))
    return energy


@kernel
def fit_star(surface, star, p, extra):
    """Return the least energy of a star found from a place of its vertex on, infinity if there is none, and the place.

    The energy is the sum of squared distances of the points, that of the borders, and the cost of thin triangles.
    """
    energy = place_points(surface, star, p, extra)
    least, best = energy if _is_allowed(surface, star, p) else np.inf, p
    for _ in range(STEPS):
        p = _stepped(surface, star, p)
        before, energy = energy, place_points(surface, star, p, extra)
        if energy >= before:
            break
        if energy < least and _is_allowed(surface, star, p):
            least, best = energy, p
        if energy > ENOUGH * before:
            break
    return least, best


@kernel(allocates=False)
def place_points(surface, star, p, extra):
    """Find the nearest places of the points of a star whose vertex is at p; return the energy."""
    for m in range(star.sizes[1]):
        _place(star, m, p, row(surface.points, star.members[m]))
    energy = value(star.quadric, minus(p, (star.base[0], star.base[1], star.base[2])))
    for k in range(star.sizes[0]):
        energy += extra * thinness(p, row(star.ends[k], 0), row(star.ends[k], 1))
    for m in range(star.sizes[1]):
        energy += price(star.squared[m], surface.limit)
    return energy


@kernel(allocates=False)
def _place(star, m, p, point):
    """Find the nearest place of a point: among all triangles, or on the way from the last nearest one around p."""
    count, begin = star.sizes[0], star.triangles[m]
    star.squared[m] = np.inf
    if begin < 0:
        for k in range(count):
            _is_nearer(star, m, p, point, k)
        return
    _is_nearer(star, m, p, point, begin)
    k = (begin + 1) % count
    while k != begin and _is_nearer(star, m, p, point, k):
        k = (k + 1) % count
    if star.triangles[m] == begin:
        k = (begin + count - 1) % count
        while k != begin and _is_nearer(star, m, p, point, k):
            k = (k + count - 1) % count


@kernel(allocates=False)
def _is_nearer(star, m, p, point, k):
    """Return whether a triangle is nearer to a point than all before; if so, keep its place."""
    a, b, c = minus(p, point), minus(row(star.ends[k], 0), point), minus(row(star.ends[k], 1), point)
    s, t = nearest_in_triangle(a, b, c)
    squared = squared_distance(a, b, c, s, t)
    if squared >= star.squared[m]:
        return False
    star.squared[m], star.triangles[m], star.weights[m, 0], star.weights[m, 1] = squared, k, s, t
    return True


@kernel(allocates=False)
def _stepped(surface, star, p):
    """Return the place of a star's vertex after a step of Gauss and Newton.

    A step off a point's triangle changes its distance; one along it hardly does, as the nearest place slides.
    """
    q, (x, y, z) = star.quadric, minus(p, (star.base[0], star.base[1], star.base[2]))
    xx, xy, xz, yy, yz, zz = q[0], q[1], q[2], q[3], q[4], q[5]
    right_x = -(q[6] + xx * x + xy * y + xz * z)
    right_y = -(q[7] + xy * x + yy * y + yz * z)
    right_z = -(q[8] + xz * x + yz * y + zz * z)
    total = 0.0
    for m in range(star.sizes[1]):
        s, t = star.weights[m, 0], star.weights[m, 1]
        share = 1.0 - s - t
        if share <= ALONG:
            continue
        a, b = row(star.ends[star.triangles[m]], 0), row(star.ends[star.triangles[m]], 1)
        foot = (
            share * p[0] + s * a[0] + t * b[0],
            share * p[1] + s * a[1] + t * b[1],
            share * p[2] + s * a[2] + t * b[2],
        )
        off = minus(row(surface.points, star.members[m]), foot)
        n = unit(off if min(s, t) < ALONG else area_vector(p, a, b))
        dearer = 1.0 + 4.0 * (SHARP * star.squared[m] / surface.limit) ** 3  # the slope of the price
        weight, along = (1.0 - SLIDE) * dearer * share * share, (1.0 - SLIDE) * dearer * share * dot(off, n)
        xx, xy, xz = xx + weight * n[0] * n[0], xy + weight * n[0] * n[1], xz + weight * n[0] * n[2]
        yy, yz, zz = yy + weight * n[1] * n[1], yz + weight * n[1] * n[2], zz + weight * n[2] * n[2]
        right_x += along * n[0] + SLIDE * share * off[0]
        right_y += along * n[1] + SLIDE * share * off[1]
        right_z += along * n[2] + SLIDE * share * off[2]
        total += share * share
    hold = (SLIDE + PULL) * total
    return _solved(p, xx + hold, xy, xz, yy + hold, yz, zz + hold, right_x, right_y, right_z)


@kernel
def _solved(p, xx, xy, xz, yy, yz, zz, x, y, z):
    """Return p plus the solution of three equations with a symmetric matrix; p if that is singular."""
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    d, e, f = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    volume = xx * a + xy * b + xz * c
    if not volume > 0.0:
        return p
    return (
        p[0] + (a * x + b * y + c * z) / volume,
        p[1] + (b * x + d * y + e * z) / volume,
        p[2] + (c * x + e * y + f * z) / volume,
    )


@kernel
def _is_allowed(surface, star, p):
    """Return whether the vertex of a star is near a point, and its triangles have areas and no sharp folds.

    No point may be beyond the limit, unless one already was as far.
    """
    mesh, count = surface.mesh, star.sizes[0]
    largest, most = 0.0, max(surface.limit, star.worst[0])
    for m in range(star.sizes[1]):
        if star.squared[m] > most:
            return False
        largest = max(largest, 1.0 - star.weights[m, 0] - star.weights[m, 1])
    if largest < NEAR or not _is_in_reach(surface, star, p):
        return False
    for k in range(count):
        a, b, edge = row(star.ends[k], 0), row(star.ends[k], 1), star.edges[k]
        if not has_area(p, a, b):
            return False
        normal, beyond, after = unit(area_vector(p, a, b)), mesh.opposite[edge], (k + 1) % count
        if beyond >= 0:
            third = row(surface.vertices, mesh.origin[preceding(beyond)])
            if dot(normal, unit(area_vector(b, a, third))) < TURN:
                return False
        if mesh.origin[star.edges[after]] == mesh.origin[following(edge)]:
            beside = unit(area_vector(p, b, row(star.ends[after], 1)))
            if dot(normal, beside) < TURN:
                return False
    return True


@kernel
def _is_in_reach(surface, star, p):
    """Return whether the nearest point is near enough to a vertex at p, if distances have a limit."""
    if surface.limit == np.inf:
        return True
    nearest_in_tree(surface.bounded, surface.low, surface.high, p[0], p[1], p[2], star.nearest, star.gap)
    return star.gap[0] <= max(surface.limit, surface.reaches[star.nearest[0]])


@kernel(allocates=False)
def store(surface, star, v, p, extra):
    """Put the vertex of a star in its place, and its points into the triangles that are now there."""
    for m in range(star.sizes[1]):
        star.triangles[m] = -1
    place_points(surface, star, p, extra)
    surface.vertices[v, 0], surface.vertices[v, 1], surface.vertices[v, 2] = p
    surface.borders[v] = 0.0
    add_moved(star.quadric, minus(p, (star.base[0], star.base[1], star.base[2])), surface.borders[v])
    for k in range(star.sizes[0]):
        surface.first[star.edges[k] // 3] = -1
    for m in range(star.sizes[1]):
        i, edge = star.members[m], star.edges[star.triangles[m]]
        f, corner = edge // 3, preceding(edge) % 3
        s, t = star.weights[m, 0], star.weights[m, 1]
        weights = (s, t) if corner == 0 else ((1.0 - s - t, s) if corner == 1 else (t, 1.0 - s - t))
        surface.assigned.face[i], surface.assigned.squared[i] = f, star.squared[m]
        surface.assigned.weights[i, 0], surface.assigned.weights[i, 1] = weights
        surface.after[i], surface.first[f] = surface.first[f], i
