"""Fit one vertex to the dense points of the triangles around it, its star, while all other vertices stay."""

from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.meshing.energy import SHARP, price, thinness
from gppcs.meshing.halfedges import MAX_VALENCE, around, following, preceding, room_for_ring
from gppcs.spatial.kdtree import nearest_in_tree
from gppcs.spatial.triangles import (
    area_vector,
    dot,
    has_area,
    minus,
    nearest_in_triangle,
    point_in,
    row,
    squared_distance,
    unit,
)
from gppcs.surface.error_quadrics import NUMBERS, add_moved, add_plane, value

SLIDE = 0.02  # weight of a point's step along its triangle, which costs no distance, beside that off it


class Star(NamedTuple):
    """The triangles around a vertex, which is not part of it, counter-clockwise, and their dense points."""

    sizes: Ints  # (2,): the numbers of triangles and of points
    edges: Ints  # (triangles,): the half-edge of each that leads around the vertex
    ends: Floats  # (triangles, 2, 3): where these begin and end
    members: Ints  # (points,)
    triangles: Ints  # (points,): the nearest triangle of each; -1 before it is computed
    weights: Floats  # (points, 2): barycentric coordinates of the foot, for the ends of the triangle's edge
    squared: Floats  # (points,): squared distances
    farthest: Floats  # (1,): the largest squared distance before any change
    quadric: Floats  # (10,): that of the vertex's boundary edges, relative to `base`
    base: Floats  # (3,)
    halves: Ints  # buffers for the ring around one vertex, and around another
    ring: Ints
    halves_u: Ints
    ring_u: Ints
    nearest: Ints  # (1,): buffers for the point nearest to the vertex, and for its squared distance
    gap: Floats


@kernel
def room_for_star(n):
    """Return the arrays of a star with at most n points."""
    size = 2 * MAX_VALENCE + 2
    halves, ring = room_for_ring()
    halves_u, ring_u = room_for_ring()
    return Star(
        np.empty(2, dtype=np.int64), np.empty(size, dtype=np.int64), np.empty((size, 2, 3)),
        np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64), np.empty((n, 2)), np.empty(n),
        np.empty(1), np.empty(NUMBERS), np.empty(3), halves, ring, halves_u, ring_u,
        np.empty(1, dtype=np.int64), np.empty(1),
    )  # fmt: skip


@kernel(allocates=False)
def empty(star, position):
    """Begin a star without triangles, whose quadric is relative to a position."""
    star.sizes[0] = star.sizes[1] = 0
    star.farthest[0] = 0.0
    star.quadric[:] = 0.0
    star.base[0], star.base[1], star.base[2] = position


@kernel(allocates=False)
def add_triangle(fitted, star, edge):
    """Add the triangle to the left of a half-edge to a star, without points; return its number there."""
    k = star.sizes[0]
    star.edges[k], star.sizes[0] = edge, k + 1
    for axis in range(3):
        star.ends[k, 0, axis] = fitted.vertices[fitted.mesh.origin[edge], axis]
        star.ends[k, 1, axis] = fitted.vertices[fitted.mesh.origin[following(edge)], axis]
    return k


@kernel(allocates=False)
def add_points(fitted, star, f, nearest):
    """Add the points of a triangle to a star, with a triangle of this that may be the nearest; return their energy."""
    energy, count, i = 0.0, star.sizes[1], fitted.first[f]
    while i >= 0:
        star.members[count], star.triangles[count] = i, nearest
        count += 1
        energy += price(fitted.assigned.squared[i], fitted.limit)
        star.farthest[0] = max(star.farthest[0], fitted.assigned.squared[i])
        i = fitted.after[i]
    star.sizes[1] = count
    return energy


@kernel(allocates=False)
def add_around(fitted, star, v, u, thin_cost):
    """Add to a star the triangles around v without u, and their points; those of both if u > v; return the energy."""
    mesh, here = fitted.mesh, row(fitted.vertices, v)
    add_moved(fitted.boundaries[v], minus((star.base[0], star.base[1], star.base[2]), here), star.quadric)
    edges, _ = around(mesh, v, star.halves)
    energy, begin = fitted.boundaries[v, 9], 0
    for step in range(edges):
        if mesh.origin[following(star.halves[step])] == u:
            begin = step
    for step in range(edges):
        edge = following(star.halves[(begin + step) % edges])
        a, b = mesh.origin[edge], mesh.origin[following(edge)]
        if a != u and b != u:
            energy += add_points(fitted, star, edge // 3, add_triangle(fitted, star, edge))
        elif v < u:
            energy += add_points(fitted, star, edge // 3, -1)
        else:
            continue
        energy += thin_cost * thinness(here, row(fitted.vertices, a), row(fitted.vertices, b))
    return energy


@kernel
def fit_star(fitted, star, p, thin_cost):
    """Return the lowest energy of a star, from a position of its vertex on, infinity if none is allowed, and where."""
    energy = _place_points(fitted, star, p, thin_cost)
    lowest, best = energy if _is_allowed(fitted, star, p) else np.inf, p
    for _ in range(3):
        p = _stepped(fitted, star, p)
        before, energy = energy, _place_points(fitted, star, p, thin_cost)
        if energy >= before:
            break
        if energy < lowest and _is_allowed(fitted, star, p):
            lowest, best = energy, p
        if energy > 0.99 * before:
            break
    return lowest, best


@kernel(allocates=False)
def _place_points(fitted, star, p, thin_cost):
    """Find the feet of the points of a star whose vertex is at p; return the energy."""
    for m in range(star.sizes[1]):
        _find_foot(star, m, p, row(fitted.points, star.members[m]))
    energy = value(star.quadric, minus(p, (star.base[0], star.base[1], star.base[2])))
    for k in range(star.sizes[0]):
        energy += thin_cost * thinness(p, row(star.ends[k], 0), row(star.ends[k], 1))
    for m in range(star.sizes[1]):
        energy += price(star.squared[m], fitted.limit)
    return energy


@kernel(allocates=False)
def _find_foot(star, m, p, point):
    """Find the foot of a point: among all triangles, or from the last nearest one around p while they come nearer."""
    count, begin = star.sizes[0], star.triangles[m]
    star.squared[m] = np.inf
    if begin < 0:
        for k in range(count):
            _is_nearer(star, m, p, point, k)
        return
    _is_nearer(star, m, p, point, begin)
    for step in (1, count - 1):
        k = (begin + step) % count
        while k != begin and _is_nearer(star, m, p, point, k):
            k = (k + step) % count
        if star.triangles[m] != begin:
            break


@kernel(allocates=False)
def _is_nearer(star, m, p, point, k):
    """Return whether a triangle is nearer to a point than all before; if so, keep its foot there."""
    a, b, c = minus(p, point), minus(row(star.ends[k], 0), point), minus(row(star.ends[k], 1), point)
    s, t = nearest_in_triangle(a, b, c)
    squared = squared_distance(a, b, c, s, t)
    if squared >= star.squared[m]:
        return False
    star.squared[m], star.triangles[m], star.weights[m, 0], star.weights[m, 1] = squared, k, s, t
    return True


@kernel
def _stepped(fitted, star, p):
    """Return the position of a star's vertex after a Gauss-Newton step along which feet slide nearly free."""
    q, total = np.zeros(NUMBERS), 0.0
    add_moved(star.quadric, minus(p, (star.base[0], star.base[1], star.base[2])), q)
    for m in range(star.sizes[1]):
        s, t = star.weights[m, 0], star.weights[m, 1]
        r = 1.0 - s - t
        if r <= 1e-9:
            continue
        a, b = row(star.ends[star.triangles[m]], 0), row(star.ends[star.triangles[m]], 1)
        off = minus(row(fitted.points, star.members[m]), point_in(p, a, b, s, t))
        normal = unit(off if min(s, t) < 1e-9 else area_vector(p, a, b))
        slope = 1.0 + 4.0 * (SHARP * star.squared[m] / fitted.limit) ** 3  # of the price
        add_plane(q, normal, -dot(off, normal) / r, (1.0 - SLIDE) * slope * r * r)
        for axis in range(3):
            q[6 + axis] -= SLIDE * r * off[axis]
        total += r * r
    hold = (SLIDE + 1e-3) * total  # the second weight holds the vertex where it is
    return _solved(p, q[0] + hold, q[1], q[2], q[3] + hold, q[4], q[5] + hold, -q[6], -q[7], -q[8])


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
def _is_allowed(fitted, star, p):
    """Return whether a vertex at p is near a point, folds no triangle, and has no other point beyond the limit."""
    mesh, count = fitted.mesh, star.sizes[0]
    min_cosine = -0.3  # between the normals of neighbouring triangles
    largest, farthest = 0.0, max(fitted.limit, star.farthest[0])
    for m in range(star.sizes[1]):
        if star.squared[m] > farthest:
            return False
        largest = max(largest, 1.0 - star.weights[m, 0] - star.weights[m, 1])
    if largest < 0.4:  # no point with such a weight: nothing holds the vertex
        return False
    if fitted.limit < np.inf:
        nearest_in_tree(fitted.bounded, fitted.lower, fitted.upper, p[0], p[1], p[2], star.nearest, star.gap)
        if star.gap[0] > max(fitted.limit, fitted.squared_radii[star.nearest[0]]):
            return False
    for k in range(count):
        a, b, edge = row(star.ends[k], 0), row(star.ends[k], 1), star.edges[k]
        if not has_area(p, a, b):
            return False
        normal, beyond, after = unit(area_vector(p, a, b)), mesh.opposite[edge], (k + 1) % count
        if beyond >= 0:
            third = row(fitted.vertices, mesh.origin[preceding(beyond)])
            if dot(normal, unit(area_vector(b, a, third))) < min_cosine:
                return False
        if mesh.origin[star.edges[after]] == mesh.origin[following(edge)]:
            beside = unit(area_vector(p, b, row(star.ends[after], 1)))
            if dot(normal, beside) < min_cosine:
                return False
    return True


@kernel(allocates=False)
def store(fitted, star, v, p, thin_cost):
    """Move the vertex of a star to p, and its points into the triangles that are now there."""
    for m in range(star.sizes[1]):
        star.triangles[m] = -1
    _place_points(fitted, star, p, thin_cost)
    fitted.vertices[v, 0], fitted.vertices[v, 1], fitted.vertices[v, 2] = p
    fitted.boundaries[v] = 0.0
    add_moved(star.quadric, minus(p, (star.base[0], star.base[1], star.base[2])), fitted.boundaries[v])
    for k in range(star.sizes[0]):
        fitted.first[star.edges[k] // 3] = -1
    for m in range(star.sizes[1]):
        i, edge = star.members[m], star.edges[star.triangles[m]]
        f, corner = edge // 3, preceding(edge) % 3
        s, t = star.weights[m, 0], star.weights[m, 1]
        weights = (s, t) if corner == 0 else ((1.0 - s - t, s) if corner == 1 else (t, 1.0 - s - t))
        fitted.assigned.face[i], fitted.assigned.squared[i] = f, star.squared[m]
        fitted.assigned.weights[i, 0], fitted.assigned.weights[i, 1] = weights
        fitted.after[i], fitted.first[f] = fitted.first[f], i
