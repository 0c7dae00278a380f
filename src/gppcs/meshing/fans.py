"""The fans of all points, and how many of them have each triangle."""

from __future__ import annotations

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.meshing.halfedges import Floats, Ints
from gppcs.spatial.triangles import circumradius, row
from gppcs.surface.fans import ON_CIRCLE, lay_out, wrap

MOST_TRIANGLES = 24  # of a fan; the mean is six
AGREEING = 0.1  # least cosine between the normals of neighbours; below it, they lie on two sheets
STEEPEST = 0.7  # largest sine of the angle between a step to a neighbour and the tangent plane
FANS_AT_ONCE = 128  # fans that a thread takes at once, at least


def fans_of(points: Floats, normals: Floats, near: Ints, on_circle: float = ON_CIRCLE[0]) -> tuple[Ints, Ints, Floats]:
    """Lay the neighbours of each point out in its tangent plane, and return the Delaunay triangles at the point.

    A neighbour keeps its direction and its true distance. The fans of neighbouring points need not agree; the votes
    of a triangle tell how many of the fans of its three corners have it.
    """
    n = len(points)
    corners = np.full((n, MOST_TRIANGLES, 2), -1)
    on_ranges(_build_fans, n, points, normals, near, on_circle, corners, least=FANS_AT_ONCE)
    votes = np.zeros((n, MOST_TRIANGLES), dtype=np.int8)
    radii = np.zeros((n, MOST_TRIANGLES))
    on_ranges(_count_votes, n, points, corners, votes, radii, least=FANS_AT_ONCE)
    there = votes > 0
    triangles = np.column_stack([np.nonzero(there)[0], corners[there]])
    return triangles, votes[there].astype(np.int64), radii[there]


@kernel
def _build_fans(begin, end, points, normals, near, on_circle, corners):
    """Fill the corners of the fans, (n, MOST_TRIANGLES, 2); other arrays as in `fans_of`."""
    inverse = np.empty((near.shape[1], 2), dtype=np.float64)
    index = np.empty(near.shape[1], dtype=np.int64)
    for i in range(begin, end):
        count = lay_out(points, normals, i, near[i], AGREEING, STEEPEST, inverse, index)
        wrap(inverse, index, count, i, on_circle, corners[i])


@kernel(allocates=False)
def _count_votes(begin, end, points, corners, votes, radii):
    """Fill votes and radii, (n, MOST_TRIANGLES), at the fan of lowest index of those that have a triangle."""
    for i in range(begin, end):
        for slot in range(MOST_TRIANGLES):
            a, b = corners[i, slot]
            if a < 0:
                break
            by_a, by_b = _has(corners[a], b, i), _has(corners[b], i, a)
            if (by_a and a < i) or (by_b and b < i):
                continue
            votes[i, slot] = 1 + by_a + by_b
            radii[i, slot] = circumradius(row(points, i), row(points, a), row(points, b))


@kernel(allocates=False)
def _has(corners, a, b):
    """Return whether a fan, (MOST_TRIANGLES, 2), has the triangle with these corners."""
    for slot in range(MOST_TRIANGLES):  # noqa: SIM110 (Numba has no generators)
        if corners[slot, 0] == a and corners[slot, 1] == b:
            return True
    return False
