"""Whether points of the dense cloud lie under the whole of a triangle: where they do not, the surface is open."""

from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import nearest_in_tree
from gppcs.spatial.triangles import dot, minus, point_in, row

RANK = 6  # a point covers the surface as far as its neighbour of this rank, times
SPAN = 1.5  # this; less opens pinholes in random samples
MAX_STEPS = 8  # steps of the lattice of points along an edge


class Cover(NamedTuple):
    """The dense points in the order of a `KdTree`."""

    points: Floats  # (3, N)
    lower: Floats  # (nodes, 3): the boxes of the tree
    upper: Floats  # (nodes, 3): the boxes of the tree
    normals: Floats  # (N, 3): unit normals; their signs do not matter
    radii: Floats  # (N,): how far each point covers the surface


def are_covered(cover: Cover, triangles: Ints, points: Floats, radii: Floats) -> Flags:
    """Return which triangles have a dense point near each point of a lattice, along its tangent plane."""
    covered = np.empty(len(triangles), dtype=np.bool_)
    on_ranges(_cover_all, len(triangles), cover, triangles, points, radii, covered, minimum=64)
    return covered


@kernel
def _cover_all(begin, end, cover, triangles, points, radii, covered):
    """Fill `covered`, (t,); other arrays as in `are_covered`."""
    nearest, squared = np.empty(4, dtype=np.int64), np.empty(4)  # of the dense points that may cover a point
    for t in range(begin, end):
        a, b, c = triangles[t]
        covered[t] = _is_covered(cover, points, radii, a, b, c, nearest, squared)


@kernel
def _is_covered(cover, points, radii, a, b, c, nearest, squared):
    """Return whether the dense points cover the triangle of three corners."""
    pa, pb, pc = row(points, a), row(points, b), row(points, c)
    ab, bc, ca = minus(pb, pa), minus(pc, pb), minus(pa, pc)
    edge = np.sqrt(max(dot(ab, ab), dot(bc, bc), dot(ca, ca)))
    radius = SPAN * min(radii[a], radii[b], radii[c])
    if edge <= radius:  # every point is that near a corner
        return True
    steps = min(MAX_STEPS, max(2, int(np.ceil(edge / radius))))
    corners = pa, pb, pc
    if not _is_point_covered(cover, corners, radius, 1 / 3, 1 / 3, edge, nearest, squared):
        return False
    for i in range(steps + 1):
        for j in range(steps + 1 - i):
            v, w = i / steps, j / steps
            corner = i == steps or j == steps or i + j == 0
            if not corner and not _is_point_covered(cover, corners, radius, v, w, edge, nearest, squared):
                return False
    return True


@kernel(allocates=False)
def _is_point_covered(cover, corners, radius, v, w, edge, nearest, squared):
    """Return whether a dense point covers the point a + v (b - a) + w (c - a), as a corner does within its radius."""
    a, b, c = corners
    x, y, z = point_in(a, b, c, v, w)
    for k in range(3):
        step = minus(corners[k], (x, y, z))
        if dot(step, step) <= radius * radius:
            return True
    nearest_in_tree(cover.points, cover.lower, cover.upper, x, y, z, nearest, squared)
    for slot in range(len(nearest)):
        if squared[slot] == np.inf:
            return False
        j = nearest[slot]
        step = x - cover.points[0, j], y - cover.points[1, j], z - cover.points[2, j]
        rise = dot(step, row(cover.normals, j))
        radius = SPAN * cover.radii[j]
        # It may lie off the triangle by a fifth of the longest edge: curved parts are covered, too.
        if squared[slot] - rise * rise <= radius * radius and abs(rise) <= max(0.2 * edge, radius):
            return True
    return False
