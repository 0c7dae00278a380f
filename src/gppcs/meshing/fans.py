"""Around each point, the triangles of a local Delaunay triangulation: its fan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.triangles import area_vector, dot, minus, row
from gppcs.surface.moments import tangents

MOST_TRIANGLES = 24  # of a fan; the mean is six
AGREEING = 0.1  # least cosine between the normals of neighbours; below it, they lie on two sheets
STEEPEST = 0.7  # largest sine of the angle between a step to a neighbour and the tangent plane
# Largest squared sine of a turn at which points count as lying on one circle: those of flat grids, and of curved ones.
ON_CIRCLE = 1e-8, 1e-6
FANS_AT_ONCE = 128  # fans that a thread takes at once, at least


def fans_of(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    near: NDArray[np.int64],
    on_circle: float = ON_CIRCLE[0],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Lay the neighbours of each point out in its tangent plane, and return the Delaunay triangles at the point.

    A neighbour keeps its direction and its true distance. The fans of neighbouring points need not agree; the votes
    of a triangle tell how many of the fans of its three corners have it.

    Shapes: points (n, 3), normals (n, 3), near (n, k); returns triangles (t, 3), votes (t,), radii (t,).
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
        count = _lay_out(points, normals, i, near[i], inverse, index)
        _wrap(inverse, index, count, i, on_circle, corners[i])


@kernel(allocates=False)
def _lay_out(points, normals, i, near, inverse, index):
    """Fill `inverse`, (k, 2), and `index`, (k,), with the neighbours of point i on its sheet; return their number.

    Each is laid out in the tangent plane and divided by its squared distance.
    """
    normal = row(normals, i)
    u, v = tangents(normal[0], normal[1], normal[2])
    count = 0
    for j in near:
        step = minus(row(points, j), row(points, i))
        squared = dot(step, step)
        a, b = dot(step, u), dot(step, v)
        in_plane = a * a + b * b
        if (
            squared == 0.0
            or dot(normal, row(normals, j)) < AGREEING
            or in_plane < (1.0 - STEEPEST * STEEPEST) * squared
        ):
            continue
        scale = 1.0 / np.sqrt(in_plane * squared)
        inverse[count, 0], inverse[count, 1], index[count] = a * scale, b * scale, j
        count += 1
    return count


@kernel(allocates=False)
def _wrap(inverse, index, count, i, on_circle, corners):
    """Fill `corners`, (MOST_TRIANGLES, 2), with the triangles at point i, of `count` inverted neighbours, (k, 2).

    The bisector between the origin and a neighbour is dual to the inverted neighbour. So the Voronoi cell of the
    origin is dual to the convex hull of the inverted neighbours, and each edge of the hull that turns left around the
    origin is a triangle. The hull is wrapped from the nearest neighbour on (Jarvis 1973).
    """
    first = 0
    for slot in range(1, count):
        if _length(inverse, slot) > _length(inverse, first):
            first = slot
    current, triangles = first, 0
    for _ in range(count):
        best, in_line = -1, False
        for slot in range(count):
            if slot == current:
                continue
            if best < 0:
                best = slot
                continue
            turn = _turn(inverse, current, best, slot, on_circle)
            in_line = in_line or turn == 0.0
            if turn < 0.0 or (turn == 0.0 and _is_farther(inverse, current, best, slot, on_circle)):
                best = slot
        if best < 0:
            return
        if in_line and _turns_left(inverse, current, best, on_circle):
            best = _first_in_line(inverse, index, count, i, current, best, on_circle)
        if _turns_left(inverse, current, best, on_circle) and triangles < MOST_TRIANGLES:
            corners[triangles, 0], corners[triangles, 1] = index[current], index[best]
            triangles += 1
        current = best
        if current == first:
            return


@kernel(allocates=False)
def _length(inverse, slot):
    """Return the squared length of an inverted neighbour."""
    return inverse[slot, 0] ** 2 + inverse[slot, 1] ** 2


@kernel(allocates=False)
def _turn(inverse, current, best, slot, on_circle):
    """Return how far a neighbour is to the left of the line to the best one; 0 if it is hardly off the line."""
    ax, ay = inverse[best, 0] - inverse[current, 0], inverse[best, 1] - inverse[current, 1]
    bx, by = inverse[slot, 0] - inverse[current, 0], inverse[slot, 1] - inverse[current, 1]
    turn = ax * by - ay * bx
    return 0.0 if turn * turn <= on_circle * (ax * ax + ay * ay) * (bx * bx + by * by) else turn


@kernel(allocates=False)
def _squared(inverse, current, slot):
    """Return the squared distance between two inverted neighbours."""
    return (inverse[slot, 0] - inverse[current, 0]) ** 2 + (inverse[slot, 1] - inverse[current, 1]) ** 2


@kernel(allocates=False)
def _turns_left(inverse, current, best, on_circle):
    """Return whether the way from a neighbour to another turns left around the origin, by more than a little."""
    turn = inverse[current, 0] * inverse[best, 1] - inverse[current, 1] * inverse[best, 0]
    return turn > 0.0 and turn * turn > on_circle * _length(inverse, current) * _length(inverse, best)


@kernel(allocates=False)
def _is_farther(inverse, current, best, slot, on_circle):
    """Return whether a neighbour on the line from the current to the best one is farther on; not if it is behind."""
    if _is_ahead(inverse, current, best, slot):
        return _squared(inverse, current, slot) > _squared(inverse, current, best)
    return _turns_left(inverse, current, slot, on_circle)


@kernel(allocates=False)
def _first_in_line(inverse, index, count, i, current, last, on_circle):
    """Return the next neighbour on an edge of the hull that several neighbours lie on, from `current` to `last`.

    These lie on a circle with point i. Each of them triangulates it from the one of lowest index, so their fans agree.
    """
    nearest = lowest = last
    for slot in range(count):
        ahead = slot != current and _turn(inverse, current, last, slot, on_circle) == 0.0
        if ahead and _is_ahead(inverse, current, last, slot):
            if index[slot] < index[lowest]:
                lowest = slot
            if _squared(inverse, current, slot) < _squared(inverse, current, nearest):
                nearest = slot
    if i < min(index[current], index[lowest]):
        return nearest
    return lowest if index[lowest] < index[current] else last


@kernel(allocates=False)
def _is_ahead(inverse, current, last, slot):
    """Return whether an inverted neighbour on the line from the current to the last one lies ahead, not behind."""
    ax, ay = inverse[last, 0] - inverse[current, 0], inverse[last, 1] - inverse[current, 1]
    bx, by = inverse[slot, 0] - inverse[current, 0], inverse[slot, 1] - inverse[current, 1]
    return ax * bx + ay * by > 0.0


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


@kernel
def circumradius(a, b, c):
    """Return the radius of the circle through three points."""
    ab, bc, ca = minus(b, a), minus(c, b), minus(a, c)
    normal = area_vector(a, b, c)
    area = np.sqrt(dot(normal, normal))
    product = np.sqrt(dot(ab, ab) * dot(bc, bc) * dot(ca, ca))
    return product / (2.0 * area) if area > 0.0 else np.inf
