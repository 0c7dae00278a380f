"""Oriented triangles as half-edges, and the way around a vertex.

Half-edge 3 f + k leads from corner k of triangle f to its next corner. The triangle lies to the left.
"""

from typing import NamedTuple, Self

import numpy as np

from gppcs.clouds.topology import connected
from gppcs.engine.arrays import Flags, Ints
from gppcs.engine.kernels import kernel

MAX_VALENCE = 64  # triangles around a vertex: buffers have this size, and no operation exceeds it


class HalfEdges(NamedTuple):
    """Triangles of an oriented manifold, perhaps with boundaries. Kernels change them in place."""

    origin: Ints  # (3 F,): vertex at which each half-edge begins; -1 for triangles that were removed
    opposite: Ints  # (3 F,): the half-edge of the neighbouring triangle that leads the other way; -1 on a boundary
    # (V,): for each vertex, a half-edge that begins there; on a boundary, the one from which all others follow
    # counter-clockwise; -1 for a vertex without triangles
    leaving: Ints

    @classmethod
    def from_faces(cls, faces: Ints, n: int) -> Self:
        """Connect triangles between n vertices."""
        origin = np.ascontiguousarray(faces, dtype=np.int64).ravel().copy()
        mesh = cls(origin, np.full(len(origin), -1), np.full(n, -1))
        _connect(mesh, EdgeTable.empty(n, len(origin)))
        return mesh

    def changed(self, kept: Flags | None = None, new: Ints | None = None) -> "HalfEdges":
        """Return a mesh of triangles that are kept, (F,), by default all that are left, and of new ones, (T, 3).

        Triangles that were removed cannot be kept.
        """
        kept_faces = self.faces() if kept is None else self.corners()[kept]
        faces = kept_faces if new is None else np.concatenate([kept_faces, new])
        return HalfEdges.from_faces(faces, len(self.leaving))

    def corners(self) -> Ints:
        """Return the corners of all triangles, (F, 3), -1 for those that were removed."""
        return self.origin.reshape(-1, 3)

    def targets(self) -> Ints:
        """Return the vertex at which each half-edge ends, (3 F,)."""
        return np.roll(self.corners(), -1, axis=1).ravel()

    def faces(self) -> Ints:
        """Return the triangles that are left."""
        return self.corners()[self.origin[::3] >= 0]

    def edges(self) -> Ints:
        """Return a half-edge of each edge."""
        first = (self.opposite < 0) | (self.opposite > np.arange(len(self.origin)))
        return np.flatnonzero((self.origin >= 0) & first)

    def inner_edges(self) -> Ints:
        """Return a half-edge of each edge that two triangles have."""
        edges = self.edges()
        return edges[self.opposite[edges] >= 0]

    def boundary_edges(self) -> Ints:
        """Return the half-edges without an opposite one."""
        return np.flatnonzero((self.opposite < 0) & (self.origin >= 0))


class EdgeTable(NamedTuple):
    """Directed edges, listed by the vertex at which they begin. Kernels add to them."""

    first: Ints  # (V,): for each vertex the edge that was added last; -1 if there is none
    after: Ints  # (edges,): for each edge the one that was added before it at the same vertex; -1 if there is none
    target: Ints  # (edges,): vertex at which each edge ends

    @classmethod
    def empty(cls, n: int, count: int) -> Self:
        """Make a table without edges, with room for so many."""
        return cls(np.full(n, -1), np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64))


@kernel(allocates=False)
def add_edge(table, p, q, number):
    """Add a directed edge to a table."""
    table.target[number], table.after[number] = q, table.first[p]
    table.first[p] = number


@kernel(allocates=False)
def find_edge(table, p, q):
    """Return the number of a directed edge, -1 if it is not there."""
    number = table.first[p]
    while number >= 0 and table.target[number] != q:
        number = table.after[number]
    return number


@kernel
def following(h):
    """Return the next half-edge around the triangle."""
    return h - 2 if h % 3 == 2 else h + 1


@kernel
def preceding(h):
    """Return the previous half-edge around the triangle."""
    return h + 2 if h % 3 == 0 else h - 1


@kernel(allocates=False)
def _connect(mesh, table):
    """Fill `opposite` and `leaving` of a mesh; half-edges are added to an empty table."""
    for h in range(len(mesh.origin)):
        add_edge(table, mesh.origin[h], mesh.origin[following(h)], h)
    for h in range(len(mesh.origin)):
        mesh.opposite[h] = find_edge(table, mesh.origin[following(h)], mesh.origin[h])
    for h in range(len(mesh.origin)):
        v = mesh.origin[h]
        if mesh.leaving[v] < 0 or mesh.opposite[h] < 0:
            mesh.leaving[v] = h


@kernel
def room_for_ring():
    """Return buffers for the half-edges that leave a vertex, and for its neighbours."""
    return np.empty(MAX_VALENCE, dtype=np.int64), np.empty(MAX_VALENCE + 1, dtype=np.int64)


@kernel(allocates=False)
def around(mesh, v, halves):
    """List the half-edges that leave a vertex, counter-clockwise; return their number, and whether they close."""
    first = mesh.leaving[v]
    if first < 0:
        return 0, False
    h, count = first, 0
    while True:
        halves[count] = h
        count += 1
        h = mesh.opposite[preceding(h)]
        if h < 0:
            return count, False
        if h == first:
            return count, True


@kernel(allocates=False)
def neighbours(mesh, v, halves, ring):
    """List the vertices around a vertex, counter-clockwise; return their number, and what `around` does."""
    edges, closed = around(mesh, v, halves)
    for slot in range(edges):
        ring[slot] = mesh.origin[following(halves[slot])]
    if closed or edges == 0:
        return edges, edges, closed
    ring[edges] = mesh.origin[preceding(halves[edges - 1])]
    return edges + 1, edges, False


@kernel(allocates=False)
def half_edge(mesh, v, w):
    """Return the half-edge from a vertex to another, -1 if there is none."""
    h = first = mesh.leaving[v]
    while h >= 0 and mesh.origin[following(h)] != w:
        h = mesh.opposite[preceding(h)]
        if h == first:
            return -1
    return h


@kernel(allocates=False)
def leave_by(mesh, v, h):
    """Let a vertex be left by a half-edge, or on a boundary by the first one."""
    mesh.leaving[v] = first = h
    while mesh.opposite[h] >= 0:
        h = following(mesh.opposite[h])
        if h == first:
            return
    mesh.leaving[v] = h


@kernel
def replace_triangles(mesh, patch, new):
    """Put new triangles, (T, 3), in the place of a patch of at least as many, (P,), with the same boundary."""
    edges, count = np.empty(3 * (len(patch) + len(new)), dtype=np.int64), 3 * len(new)
    for f in patch:
        for h in range(3 * f, 3 * f + 3):
            if mesh.origin[h] >= 0:
                mesh.leaving[mesh.origin[h]] = -1
                mesh.origin[h] = -1
                if mesh.opposite[h] >= 0:
                    edges[count] = mesh.opposite[h]
                    mesh.opposite[mesh.opposite[h]] = mesh.opposite[h] = -1
                    count += 1
    n_edges = 3 * len(new)
    for outer in edges[n_edges:count]:
        if mesh.origin[outer] >= 0:
            edges[n_edges] = outer
            n_edges += 1
    for k in range(3):
        for t in range(len(new)):
            edges[k * len(new) + t] = 3 * patch[t] + k
            mesh.origin[3 * patch[t] + k] = new[t, k]
    for i in range(n_edges):
        h = edges[i]
        for o in edges[:i]:
            if mesh.origin[o] == mesh.origin[following(h)] and mesh.origin[following(o)] == mesh.origin[h]:
                mesh.opposite[h], mesh.opposite[o] = o, h
    for edge in edges[:n_edges]:
        if mesh.leaving[mesh.origin[edge]] < 0:
            leave_by(mesh, mesh.origin[edge], edge)
    for edge in edges[:n_edges]:
        h = following(edge)
        if mesh.leaving[mesh.origin[h]] < 0:
            leave_by(mesh, mesh.origin[h], h)


@kernel(allocates=False)
def position_of(values, size, value):
    """Return the position of a value among the first ones of a list, -1 if it is not there."""
    for slot in range(size):
        if values[slot] == value:
            return slot
    return -1


@kernel(allocates=False)
def add_to_patch(patch, size, f):
    """Add a triangle to a patch of some size, unless it is there or the patch is full; return the new size."""
    if size == len(patch) or position_of(patch, size, f) >= 0:
        return size
    patch[size] = f
    return size + 1


def without_bow_ties(mesh: HalfEdges) -> HalfEdges:
    """Drop triangles so that those at each vertex are one fan: the largest stays, of equal ones the first."""
    while True:
        fan = np.full(len(mesh.origin), -1)
        _number_fans(mesh, fan)
        sizes = np.bincount(fan)
        if len(sizes) == np.count_nonzero(mesh.leaving >= 0):
            return mesh
        vertex = np.empty(len(sizes), dtype=np.int64)
        vertex[fan] = mesh.origin
        several = np.flatnonzero(np.bincount(vertex)[vertex] > 1)
        order = several[np.lexsort((-sizes[several], vertex[several]))]
        smaller = np.zeros(len(sizes), dtype=np.bool_)
        smaller[order[1:]] = vertex[order[1:]] == vertex[order[:-1]]
        mesh = mesh.changed(~smaller[fan].reshape(-1, 3).any(axis=1))


@kernel(allocates=False)
def _number_fans(mesh, fan):
    """Fill `fan`, (3 F,): half-edges that leave a vertex side by side have one number, by the first of them."""
    count = 0
    for first in range(len(fan)):
        if fan[first] >= 0:
            continue
        h = first
        while h >= 0 and fan[h] < 0:
            fan[h], h = count, mesh.opposite[preceding(h)]
        h = mesh.opposite[first]
        while h >= 0 and fan[following(h)] < 0:
            fan[following(h)], h = count, mesh.opposite[following(h)]
        count += 1


def pieces_of(faces: Ints, n: int) -> Ints:
    """Return the connected piece of each triangle."""
    return connected(faces[:, :2].ravel(), faces[:, 1:].ravel(), n)[1][faces[:, 0]]
