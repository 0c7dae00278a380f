"""Whether points of the dense cloud lie under the whole of a triangle: where they do not, the surface is open."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.halfedges import Flags, Floats, Ints
from gppcs.spatial.kdtree import nearest_in_tree
from gppcs.spatial.triangles import dot, minus, row

RANK = 6  # a point covers the surface as far as its neighbour of this rank, times
SPAN = 1.5  # this; less opens pinholes in random samples
COVERING_POINTS = 4  # dense points that may cover a place: the nearest ones
MOST_STEPS = 8  # steps of the lattice of places along an edge, at most
RISE = 0.2  # a covering point may lie this far off the triangle, in its longest edges: curved parts are covered too
TRIANGLES_AT_ONCE = 64  # triangles that a thread takes at once, at least


class Cover(NamedTuple):
    """The dense points in the order of a `KdTree`."""

    points: Floats  # (3, N)
    low: Floats  # (nodes, 3): the boxes of the tree
    high: Floats  # (nodes, 3): the boxes of the tree
    normals: Floats  # (N, 3): unit normals; their signs do not matter
    reaches: Floats  # (N,): how far each point covers the surface


def are_covered(cover: Cover, triangles: Ints, points: Floats, reaches: Floats) -> Flags:
    """Tell which triangles the dense points cover.

    A place on a triangle is covered if one of the nearest dense points reaches it along its tangent plane. The places
    are those of a lattice, about as dense as the points.
    """
    covered = np.empty(len(triangles), dtype=np.bool_)
    on_ranges(_cover_all, len(triangles), cover, triangles, points, reaches, covered, least=TRIANGLES_AT_ONCE)
    return covered


@kernel
def _cover_all(begin, end, cover, triangles, points, reaches, covered):
    """Fill `covered`, (t,); other arrays as in `are_covered`."""
    found, squared = np.empty(COVERING_POINTS, dtype=np.int64), np.empty(COVERING_POINTS)
    for t in range(begin, end):
        a, b, c = triangles[t]
        covered[t] = _is_covered(cover, points, reaches, a, b, c, found, squared)


@kernel
def _is_covered(cover, points, reaches, a, b, c, found, squared):
    """Return whether the dense points cover the triangle of three corners."""
    pa, pb, pc = row(points, a), row(points, b), row(points, c)
    ab, bc, ca = minus(pb, pa), minus(pc, pb), minus(pa, pc)
    edge = np.sqrt(max(dot(ab, ab), dot(bc, bc), dot(ca, ca)))
    reach = SPAN * min(reaches[a], reaches[b], reaches[c])
    if edge <= reach:  # every place is that near a corner
        return True
    steps = min(MOST_STEPS, max(2, int(np.ceil(edge / reach))))
    corners = pa, pb, pc
    if not _is_place_covered(cover, corners, reach, 1 / 3, 1 / 3, edge, found, squared):
        return False
    for i in range(steps + 1):
        for j in range(steps + 1 - i):
            v, w = i / steps, j / steps
            corner = i == steps or j == steps or i + j == 0
            if not corner and not _is_place_covered(cover, corners, reach, v, w, edge, found, squared):
                return False
    return True


@kernel(allocates=False)
def _is_place_covered(cover, corners, reach, v, w, edge, found, squared):
    """Return whether a dense point covers the place a + v (b - a) + w (c - a), as a corner does that is in reach."""
    a, b, c = corners
    ab, ac = minus(b, a), minus(c, a)
    x, y, z = a[0] + v * ab[0] + w * ac[0], a[1] + v * ab[1] + w * ac[1], a[2] + v * ab[2] + w * ac[2]
    for k in range(3):
        step = minus(corners[k], (x, y, z))
        if dot(step, step) <= reach * reach:
            return True
    nearest_in_tree(cover.points, cover.low, cover.high, x, y, z, found, squared)
    for slot in range(len(found)):
        if squared[slot] == np.inf:
            return False
        j = found[slot]
        step = x - cover.points[0, j], y - cover.points[1, j], z - cover.points[2, j]
        rise = dot(step, row(cover.normals, j))
        reach = SPAN * cover.reaches[j]
        if squared[slot] - rise * rise <= reach * reach and abs(rise) <= max(RISE * edge, reach):
            return True
    return False
