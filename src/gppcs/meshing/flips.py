"""Flip edges while that brings the mesh nearer to the dense points, and thin triangles vanish."""

from __future__ import annotations

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment, corners_from
from gppcs.meshing.halfedges import MOST_AROUND, Floats, HalfEdges, around, following, leave_by, preceding
from gppcs.spatial.triangles import area_vector, dot, minus, nearest_in_triangle, quality, row, squared_distance

SWEEPS = 8  # tries of each edge at most, on average
UPRIGHT = 0.1  # least cosine between a new triangle's normal and the mean of its corners'
THIN_IN_FLIPS = 0.22  # triangles below this quality cost extra
SHARP = 0.5  # a point at the limit of distances costs 1 + SHARP^3 times its squared distance
LESS = 1.0 - 1e-7  # an energy counts as lower if it is below this share: rounding flips nothing


def flip(mesh: HalfEdges, vertices: Floats, normals: Floats, points: Floats, assigned: Assignment, extra: float) -> int:
    """Flip edges while the energy falls.

    The energy is the sum of the squared distances of the dense points to their triangles, and a cost of thin
    triangles. A point stays with the two triangles of an edge that is flipped.
    """
    first = np.full(len(mesh.origin) // 3, -1)
    after = np.full(len(points), -1)
    return int(_flip_all(mesh, vertices, normals, points, assigned, extra, first, after))


@kernel
def _flip_all(mesh, vertices, normals, points, assigned, extra, first, after):
    """See `flip`; the points of a triangle are a list that starts at `first`, (F,), and goes on by `after`, (N,)."""
    for i in range(len(points)):
        if assigned.face[i] >= 0:
            after[i] = first[assigned.face[i]]
            first[assigned.face[i]] = i
    size = len(mesh.origin)
    queue, waiting = np.empty(size, dtype=np.int64), np.zeros(size, dtype=np.bool_)
    count = begin = flips = 0
    for h in range(size):
        if mesh.origin[h] >= 0 and mesh.opposite[h] > h:
            queue[count], waiting[h] = h, True
            count += 1
    tries = SWEEPS * count
    halves = np.empty(MOST_AROUND, dtype=np.int64)
    while count and tries:
        h = queue[begin]
        begin, count, tries = (begin + 1) % size, count - 1, tries - 1
        waiting[h] = False
        if not is_flippable(mesh, vertices, normals, h, halves):
            continue
        f, g = h // 3, mesh.opposite[h] // 3
        if not is_better(mesh, vertices, points, assigned, extra, first, after, np.inf, h):
            continue
        flip_edge(mesh, h)
        share_out(mesh, vertices, points, assigned, first, after, f, g)
        flips += 1
        for side in (f, g):
            for k in range(3):
                other = mesh.opposite[3 * side + k]
                e = min(3 * side + k, other)
                if other >= 0 and not waiting[e]:
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
    for slot in range(edges_c):
        if mesh.origin[following(halves[slot])] == d or mesh.origin[preceding(halves[slot])] == d:
            return False
    edges_d, _ = around(mesh, d, halves)
    if c == d or max(edges_c, edges_d) == MOST_AROUND:
        return False
    for v in (a, b):
        edges, closed = around(mesh, v, halves)
        if edges <= (3 if closed else 1):
            return False
    for v, w in ((a, d), (d, b)):
        normal = area_vector(row(vertices, v), row(vertices, w), row(vertices, c))
        length = np.sqrt(dot(normal, normal))
        cosine = dot(normal, row(normals, v)) + dot(normal, row(normals, w)) + dot(normal, row(normals, c))
        if not cosine > 3.0 * UPRIGHT * length:
            return False
    return True


@kernel(allocates=False)
def is_better(mesh, vertices, points, assigned, extra, first, after, limit, h):
    """Return whether the energy of the two triangles of an edge is lower after its flip.

    No point may be beyond the limit of squared distances, unless one already was as far.
    """
    o = mesh.opposite[h]
    a, b = mesh.origin[h], mesh.origin[o]
    c, d = mesh.origin[preceding(h)], mesh.origin[preceding(o)]
    pa, pb, pc, pd = row(vertices, a), row(vertices, b), row(vertices, c), row(vertices, d)
    old, most = extra * (thinness(pa, pb, pc) + thinness(pb, pa, pd)), limit
    for side in (h // 3, o // 3):
        i = first[side]
        while i >= 0:
            old += price(assigned.squared[i], limit)
            most = max(most, assigned.squared[i])
            i = after[i]
    new = extra * (thinness(pa, pd, pc) + thinness(pd, pb, pc))
    for side in (h // 3, o // 3):
        i = first[side]
        while i >= 0 and new < LESS * old:
            point = row(points, i)
            fa, fb, fc, fd = minus(pa, point), minus(pb, point), minus(pc, point), minus(pd, point)
            s, t = nearest_in_triangle(fa, fd, fc)
            u, v = nearest_in_triangle(fd, fb, fc)
            squared = min(squared_distance(fa, fd, fc, s, t), squared_distance(fd, fb, fc, u, v))
            if squared > most:
                return False
            new += price(squared, limit)
            i = after[i]
    return new < LESS * old


@kernel
def price(squared, limit):
    """Return what a squared distance costs: itself, and more the nearer it is to the limit."""
    return squared * (1.0 + (SHARP * squared / limit) ** 3)


@kernel
def thinness(a, b, c):
    """Return how far the quality of a triangle is below `THIN_IN_FLIPS`, as a share of this."""
    return max(0.0, 1.0 - quality(a, b, c) / THIN_IN_FLIPS)


@kernel(allocates=False)
def flip_edge(mesh, h):
    """Replace the edge of two triangles by the other diagonal.

    Triangles a b c and b a d, with h from a to b, become a d c and d b c, each in the place of one of them.
    """
    o = mesh.opposite[h]
    f, g = 3 * (h // 3), 3 * (o // 3)
    a, b = mesh.origin[h], mesh.origin[o]
    c, d = mesh.origin[preceding(h)], mesh.origin[preceding(o)]
    bc, ca = mesh.opposite[following(h)], mesh.opposite[preceding(h)]
    ad, db = mesh.opposite[following(o)], mesh.opposite[preceding(o)]
    mesh.origin[f], mesh.origin[f + 1], mesh.origin[f + 2] = a, d, c
    mesh.origin[g], mesh.origin[g + 1], mesh.origin[g + 2] = d, b, c
    mesh.opposite[f], mesh.opposite[f + 1], mesh.opposite[f + 2] = ad, g + 2, ca
    mesh.opposite[g], mesh.opposite[g + 1], mesh.opposite[g + 2] = db, bc, f + 1
    if ad >= 0:
        mesh.opposite[ad] = f
    if ca >= 0:
        mesh.opposite[ca] = f + 2
    if db >= 0:
        mesh.opposite[db] = g
    if bc >= 0:
        mesh.opposite[bc] = g + 1
    leave_by(mesh, a, f)
    leave_by(mesh, b, g + 1)
    leave_by(mesh, c, f + 2)
    leave_by(mesh, d, g)


@kernel(allocates=False)
def share_out(mesh, vertices, points, assigned, first, after, f, g):
    """Give each point of two triangles to the nearer one."""
    heads = first[f], first[g]
    first[f] = first[g] = -1
    for head in heads:
        i = head
        while i >= 0:
            behind = after[i]
            point = row(points, i)
            least = np.inf
            for side in (f, g):
                a, b, c = corners_from(mesh, vertices, side, point)
                s, t = nearest_in_triangle(a, b, c)
                squared = squared_distance(a, b, c, s, t)
                if squared < least:
                    least = squared
                    assigned.face[i], assigned.squared[i] = side, squared
                    assigned.weights[i, 0], assigned.weights[i, 1] = s, t
            after[i] = first[assigned.face[i]]
            first[assigned.face[i]] = i
            i = behind


def qualities(mesh: HalfEdges, vertices: Floats) -> Floats:
    """Return the qualities of the triangles, as `triangles.quality` defines them."""
    a, b, c = (vertices[corner] for corner in mesh.faces().T)
    squared = sum(((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a)))
    found: Floats = 2.0 * np.sqrt(3.0) * np.linalg.norm(np.cross(b - a, c - a), axis=1) / squared
    return found
