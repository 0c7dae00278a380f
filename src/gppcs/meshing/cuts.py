"""Triangles that cut others: find them, and flip edges or remove vertices until they no longer do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.meshing.collapse import ends, is_allowed, move_triangles, thinness_after
from gppcs.meshing.flips import flip_edge, is_flippable
from gppcs.meshing.halfedges import MOST_AROUND, HalfEdges, around, following, neighbours, preceding
from gppcs.spatial.triangles import area_vector, cross, dot, minus, row

PARALLEL = 1e-18  # an edge lies in a plane if the squared sine of their angle is below this
MEND_ROUNDS = 4  # of mending all triangles that cut others
TURN_IN_MENDING = -0.3  # least cosine between a triangle's normals before and after a vertex of it is removed


def cutting(mesh: HalfEdges, vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the triangles that cut another one.

    Triangles with a common edge do not cut each other, and those in one plane are not looked for.

    Parameters
    ----------
    mesh : HalfEdges
    vertices : (V, 3) array, float64

    Returns
    -------
    (m,) array, int64
        Ascending.
    """
    low, high = _boxes(mesh, vertices)
    axis = int(np.argmax(np.ptp(vertices[mesh.faces()].reshape(-1, 3), axis=0)))
    there = np.flatnonzero(mesh.origin[::3] >= 0)
    order = there[np.argsort(low[there, axis], kind="stable")]
    found = np.zeros(len(low), dtype=np.bool_)
    _mark_cutting(mesh, vertices, low, high, axis, order, found)
    return np.flatnonzero(found)


def _boxes(mesh: HalfEdges, vertices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and upper corners, (F, 3), of the boxes around triangles; those of removed ones are empty."""
    corners = mesh.origin.reshape(-1, 3)
    low, high = vertices[corners].min(axis=1), vertices[corners].max(axis=1)
    low[corners[:, 0] < 0] = np.inf
    return low, high


@kernel
def _mark_cutting(mesh, vertices, low, high, axis, order, found):
    """Mark in `found`, (F,), the triangles that cut others, in a sweep along an axis."""
    for i in range(len(order)):
        f = order[i]
        for j in range(i + 1, len(order)):
            g = order[j]
            if low[g, axis] > high[f, axis]:
                break
            if _overlap(low, high, f, g) and are_cut(mesh, vertices, f, g, -1, -1):
                found[f] = found[g] = True


@kernel
def _overlap(low, high, f, g):
    """Return whether two boxes overlap."""
    apart = False
    for k in range(3):
        apart = apart or low[f, k] > high[g, k] or low[g, k] > high[f, k]
    return not apart


@kernel
def are_cut(mesh, vertices, f, g, v, u):
    """Return whether two triangles cut each other, or would do so if a vertex went into another.

    Parameters
    ----------
    mesh : HalfEdges
    vertices : (V, 3) array
    f, g : int
    v, u : int
        The vertex that would go, and the one that would take its triangles; -1 and -1 for the mesh as it is.

    Returns
    -------
    bool
        False if they share an edge. If they share a corner, whether they meet anywhere else.
    """
    shared = at_f = at_g = 0
    for i in range(3):
        for j in range(3):
            if _end(mesh, 3 * f + i, v, u) == _end(mesh, 3 * g + j, v, u):
                shared, at_f, at_g = shared + 1, i, j
    if shared > 1:
        return False
    for this, other, corner in ((f, g, at_f), (g, f, at_g)):
        a = row(vertices, _end(mesh, 3 * other, v, u))
        b = row(vertices, _end(mesh, 3 * other + 1, v, u))
        c = row(vertices, _end(mesh, 3 * other + 2, v, u))
        for k in range(3):
            h = 3 * this + (corner + 1 + k) % 3  # with a shared corner, the edge opposite to it comes first
            p, q = row(vertices, _end(mesh, h, v, u)), row(vertices, _end(mesh, following(h), v, u))
            if _crosses(p, q, a, b, c):
                return True
            if shared:
                break
    return False


@kernel
def _end(mesh, h, v, u):
    """Return the vertex at which a half-edge begins after v has gone into u."""
    return u if mesh.origin[h] == v else mesh.origin[h]


@kernel
def _crosses(p, q, a, b, c):
    """Return whether a segment from p to q goes through a triangle."""
    normal, step, turned = area_vector(a, b, c), minus(q, p), cross(minus(q, p), minus(p, a))
    above, below = dot(minus(p, a), normal), dot(minus(q, a), normal)
    height = below - above
    if above * below > 0.0 or height * height <= PARALLEL * dot(normal, normal) * dot(step, step):
        return False
    v, w = dot(minus(c, a), turned) / height, -dot(minus(b, a), turned) / height
    return v >= 0.0 and w >= 0.0 and v + w <= 1.0


def mend(
    mesh: HalfEdges, vertices: NDArray[np.float64], normals: NDArray[np.float64], kept: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Flip edges and remove vertices of triangles that cut others, wherever then fewer do.

    Parameters
    ----------
    mesh : HalfEdges
        Changed in place. It stays a manifold of the same topology.
    vertices, normals : (V, 3) arrays, float64
    kept : (V,) array, bool
        Vertices that are never removed.

    Returns
    -------
    (V,) array, int64
        The vertex into which each went; itself if it stays.
    """
    into = np.arange(len(vertices))
    for _ in range(MEND_ROUNDS):
        faces = cutting(mesh, vertices)
        if not len(faces):
            break
        low, high = _boxes(mesh, vertices)
        if _mend_all(mesh, vertices, normals, kept, low, high, faces, into) == 0:
            break
    return ends(into)


@kernel
def _mend_all(mesh, vertices, normals, kept, low, high, faces, into):
    """Mend the triangles `faces`, (m,), one after another; return how many changes were made.

    The boxes `low` and `high`, (F, 3), and `into`, (V,), follow the changes.
    """
    near = np.empty(len(low), dtype=np.int64)
    halves, found = np.empty(MOST_AROUND, dtype=np.int64), np.empty(MOST_AROUND + 1, dtype=np.int64)
    others, beyond = np.empty(MOST_AROUND, dtype=np.int64), np.empty(MOST_AROUND + 1, dtype=np.int64)
    changes = 0
    for f in faces:
        if mesh.origin[3 * f] < 0:
            continue
        about = near[: _list_near(mesh, low, high, f, halves, near)]
        if _cuts(mesh, vertices, f, about, -1, -1) == 0:
            continue
        changed = False
        for h in range(3 * f, 3 * f + 3):
            if not changed and is_flippable(mesh, vertices, normals, h, halves):
                changed = _flip_if_better(mesh, vertices, h, about, low, high)
        for k in range(3):
            v = mesh.origin[3 * f + k]
            if not changed and not kept[v]:
                u = _best_to_take(mesh, vertices, normals, v, about, halves, found, others, beyond)
                if u >= 0:
                    edges, _ = around(mesh, v, halves)
                    move_triangles(mesh, v, u, others)
                    for slot in range(edges):
                        _set_box(mesh, vertices, halves[slot] // 3, low, high)
                    into[v] = u
                    changed = True
        changes += changed
    return changes


@kernel
def _list_near(mesh, low, high, f, halves, near):
    """Fill `near` with the triangles whose boxes meet that of the triangles around the corners of one; count them."""
    least, most = low[f].copy(), high[f].copy()
    for k in range(3):
        edges, _ = around(mesh, mesh.origin[3 * f + k], halves)
        for slot in range(edges):
            g = halves[slot] // 3
            for axis in range(3):
                least[axis] = min(least[axis], low[g, axis])
                most[axis] = max(most[axis], high[g, axis])
    count = 0
    for g in range(len(low)):
        meets = mesh.origin[3 * g] >= 0
        for axis in range(3):
            meets = meets and low[g, axis] <= most[axis] and high[g, axis] >= least[axis]
        if meets:
            near[count] = g
            count += 1
    return count


@kernel
def _cuts(mesh, vertices, f, near, v, u):
    """Return how many of the triangles `near` cut one, or would do so if v went into u."""
    count = 0
    for g in near:
        if g != f and mesh.origin[3 * g] >= 0:
            vanishes = False
            if v >= 0:
                has_v = has_u = False
                for k in range(3):
                    has_v = has_v or mesh.origin[3 * g + k] == v
                    has_u = has_u or mesh.origin[3 * g + k] == u
                vanishes = has_v and has_u
            if not vanishes and are_cut(mesh, vertices, f, g, v, u):
                count += 1
    return count


@kernel
def _flip_if_better(mesh, vertices, h, near, low, high):
    """Flip an edge if its triangles then cut fewer others; return whether they do."""
    f, g = h // 3, mesh.opposite[h] // 3
    before = _cuts(mesh, vertices, f, near, -1, -1) + _cuts(mesh, vertices, g, near, -1, -1)
    flip_edge(mesh, h)
    if _cuts(mesh, vertices, f, near, -1, -1) + _cuts(mesh, vertices, g, near, -1, -1) >= before:
        flip_edge(mesh, 3 * f + 1)
        better = False
    else:
        better = True
    _set_box(mesh, vertices, f, low, high)
    _set_box(mesh, vertices, g, low, high)
    return better


@kernel
def _best_to_take(mesh, vertices, normals, v, near, halves, found, others, beyond):
    """Return the neighbour into which v can go so that the fewest triangles cut, fewer than now; -1 if none."""
    count, edges, closed = neighbours(mesh, v, halves, found)
    least, best = 0, -1
    for slot in range(edges):
        least += _cuts(mesh, vertices, halves[slot] // 3, near, -1, -1)
    for slot in range(count):
        u = found[slot]
        if not is_allowed(mesh, v, slot, count, edges, closed, halves, found, others, beyond):
            continue
        if thinness_after(mesh, vertices, normals, TURN_IN_MENDING, v, u, edges, halves) == np.inf:
            continue
        cuts = 0
        for other in range(edges):
            h = halves[other]
            if mesh.origin[following(h)] != u and mesh.origin[preceding(h)] != u:
                cuts += _cuts(mesh, vertices, h // 3, near, v, u)
        if cuts < least:
            least, best = cuts, u
    return best


@kernel
def _set_box(mesh, vertices, f, low, high):
    """Set the box of a triangle, unless it has been removed."""
    for axis in range(3):
        if mesh.origin[3 * f] >= 0:
            a, b, c = (
                vertices[mesh.origin[3 * f], axis],
                vertices[mesh.origin[3 * f + 1], axis],
                vertices[mesh.origin[3 * f + 2], axis],
            )
            low[f, axis], high[f, axis] = min(a, b, c), max(a, b, c)
