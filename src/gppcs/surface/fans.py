"""The fan of a point: its triangles in the Delaunay triangulation of its neighbours, laid out in its tangent plane."""

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.triangles import dot, minus, row
from gppcs.surface.moments import tangents

MAX_FAN = 24  # triangles of a fan; the mean is six
# Largest squared sine of a turn at which points count as lying on one circle: those of flat grids, and of curved ones.
ON_CIRCLE = 1e-8, 1e-6
ANY_NORMAL = -2.0  # neighbours are on the same sheet whatever their normals, whose signs mean nothing
POINTS_AT_ONCE = 128  # at least, in a range of a thread


def corners_of_fans(
    points: Floats, normals: Floats, near: Ints, agreeing: float, steepest: float, on_circle: float
) -> Ints:
    """Return the other corners of the triangles around each point, (n, MAX_FAN, 2); -1 after the last.

    A neighbour is on the same sheet if the cosine between the normals, or between one and the other mirrored in the
    plane halfway, as across a sharp edge, is at least `agreeing`, and the sine of the step's angle to the tangent plane
    at most `steepest`. Shapes: points and normals (n, 3), near (n, k).
    """
    corners = np.full((len(points), MAX_FAN, 2), -1)
    on_ranges(
        _build_fans, len(points), points, normals, near, agreeing, steepest, on_circle, corners, minimum=POINTS_AT_ONCE
    )
    return corners


@kernel
def _build_fans(begin, end, points, normals, near, agreeing, steepest, on_circle, corners):
    """Fill the corners of the fans, (n, MAX_FAN, 2); other arrays as in `corners_of_fans`."""
    inverse = np.empty((near.shape[1], 2), dtype=np.float64)
    index = np.empty(near.shape[1], dtype=np.int64)
    for i in range(begin, end):
        count = lay_out(points, normals, i, near[i], agreeing, steepest, inverse, index)
        wrap(inverse, index, count, i, on_circle, corners[i])


@kernel(allocates=False)
def lay_out(points, normals, i, near, agreeing, steepest, inverse, index):
    """Lay out the neighbours of point i on its sheet, over their squared distance; return their number.

    Shapes: inverse (k, 2), index (k,).
    """
    normal = row(normals, i)
    u, v = tangents(normal[0], normal[1], normal[2])
    count = 0
    for j in near:
        step = minus(row(points, j), row(points, i))
        squared = dot(step, step)
        a, b = dot(step, u), dot(step, v)
        in_plane = a * a + b * b
        if squared == 0.0 or in_plane < (1.0 - steepest * steepest) * squared:
            continue
        other = row(normals, j)
        cosine = dot(normal, other)
        if cosine < agreeing and cosine - 2.0 * dot(step, normal) * dot(step, other) / squared < agreeing:
            continue
        scale = 1.0 / np.sqrt(in_plane * squared)
        inverse[count, 0], inverse[count, 1], index[count] = a * scale, b * scale, j
        count += 1
    return count


@kernel(allocates=False)
def wrap(inverse, index, count, i, on_circle, corners):
    """Fill the fan `corners`, (t, 2), of point i with `count` inverted neighbours, (k, 2); return whether it is closed.

    The Voronoi cell of the origin is dual to the convex hull of the inverted neighbours, so each edge of the hull that
    turns left around the origin is a triangle. The hull is wrapped from the nearest neighbour on (Jarvis 1973).
    """
    first = 0
    for slot in range(1, count):
        if _length(inverse, slot) > _length(inverse, first):
            first = slot
    current, triangles, closed = first, 0, count > 2
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
            return False
        if in_line and _turns_left(inverse, current, best, on_circle):
            best = _first_in_line(inverse, index, count, i, current, best, on_circle)
        if not _turns_left(inverse, current, best, on_circle):
            closed = False
        elif triangles < len(corners):
            corners[triangles, 0], corners[triangles, 1] = index[current], index[best]
            triangles += 1
        current = best
        if current == first:
            return closed
    return False


@kernel(inline="always")
def _length(inverse, slot):
    """Return the squared length of an inverted neighbour."""
    return inverse[slot, 0] ** 2 + inverse[slot, 1] ** 2


@kernel(inline="always")
def _turn(inverse, current, best, slot, on_circle):
    """Return how far a neighbour is to the left of the line to the best one; 0 if it is hardly off the line."""
    ax, ay = inverse[best, 0] - inverse[current, 0], inverse[best, 1] - inverse[current, 1]
    bx, by = inverse[slot, 0] - inverse[current, 0], inverse[slot, 1] - inverse[current, 1]
    turn = ax * by - ay * bx
    in_line = on_circle > 0.0 and turn * turn <= on_circle * (ax * ax + ay * ay) * (bx * bx + by * by)
    return 0.0 if in_line else turn


@kernel(inline="always")
def _squared(inverse, current, slot):
    """Return the squared distance between two inverted neighbours."""
    return (inverse[slot, 0] - inverse[current, 0]) ** 2 + (inverse[slot, 1] - inverse[current, 1]) ** 2


@kernel(inline="always")
def _turns_left(inverse, current, best, on_circle):
    """Return whether the path from a neighbour to another turns left around the origin, by more than a little."""
    turn = inverse[current, 0] * inverse[best, 1] - inverse[current, 1] * inverse[best, 0]
    return turn > 0.0 and turn * turn > on_circle * _length(inverse, current) * _length(inverse, best)


@kernel(inline="always")
def _is_farther(inverse, current, best, slot, on_circle):
    """Return whether a neighbour on the line from the current to the best one is farther on; not if it is behind."""
    if _is_ahead(inverse, current, best, slot):
        return _squared(inverse, current, slot) > _squared(inverse, current, best)
    return _turns_left(inverse, current, slot, on_circle)


@kernel(inline="always")
def _first_in_line(inverse, index, count, i, current, last, on_circle):
    """Return the next neighbour on an edge of the hull with several, so that fans of points on a circle agree."""
    nearest = smallest = last
    for slot in range(count):
        ahead = slot != current and _turn(inverse, current, last, slot, on_circle) == 0.0
        if ahead and _is_ahead(inverse, current, last, slot):
            if index[slot] < index[smallest]:
                smallest = slot
            if _squared(inverse, current, slot) < _squared(inverse, current, nearest):
                nearest = slot
    if i < min(index[current], index[smallest]):
        return nearest
    return smallest if index[smallest] < index[current] else last


@kernel(inline="always")
def _is_ahead(inverse, current, last, slot):
    """Return whether an inverted neighbour on the line from the current to the last one lies ahead, not behind."""
    ax, ay = inverse[last, 0] - inverse[current, 0], inverse[last, 1] - inverse[current, 1]
    bx, by = inverse[slot, 0] - inverse[current, 0], inverse[slot, 1] - inverse[current, 1]
    return ax * bx + ay * by > 0.0
