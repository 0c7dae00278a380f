"""Choice in a cell by attributes that count beside its shape (Eq. (20))."""

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.gp.local.placement.shape import DISTANCE_ROUNDING, next_point, squared_difference
from gppcs.gp.local.settings import DETAIL_INTERPOLATED, DETAIL_NEAREST, DETAIL_TRIALS, DETAIL_TRIED_ON
from gppcs.spatial.triangles import dot, minus, nearest_in_triangle, row, squared_distance


@kernel(allocates=False)
def best_with_attributes(observed, attributes, chosen, v, cell, widest, current, errors):
    """Return the point of a cell with the least F of Eq. (20), or -1 for the vertex, and what its attributes gain."""
    vertex, best = row(chosen.positions, v), -1
    distance, before = _off_fan(observed, attributes, chosen, v, vertex, attributes.of_vertices[v], cell, np.inf)
    smallest = current + distance + before - DISTANCE_ROUNDING * chosen.gaps[v]
    after = before
    for _ in range(DETAIL_TRIALS):
        x, error = next_point(observed.points, cell, errors, smallest, widest)
        if x < 0:
            break
        to, at_apex = row(observed.points.T, x), attributes.of_points[x]
        distance, attribute_error = _off_fan(observed, attributes, chosen, v, to, at_apex, cell, smallest - error)
        total = error + distance + attribute_error
        if total < smallest:
            smallest, best, after = total, x, attribute_error
    return best, max(0.0, before - after)


@kernel(allocates=False)
def _off_fan(observed, attributes, chosen, v, apex, at_apex, cell, limit):
    """Return both parts of the mean of Eq. (20), distances and attributes, by the fan around an apex.

    They are infinite if their sum is beyond a limit, and 0 if the fan is empty.
    """
    if chosen.corners[v, 0, 0] < 0:
        return 0.0, 0.0
    stride = -(-len(cell) // DETAIL_TRIED_ON)
    judged = -(-len(cell) // stride)
    distance, attribute_error, scale = 0.0, 0.0, chosen.gaps[v] / judged
    for slot in range(0, len(cell), stride):
        q = cell[slot]
        here, smallest = row(observed.feet.T, q), np.inf
        a, second, third, s, t = minus(apex, here), 0, 0, 0.0, 0.0
        closest, owner = dot(a, a), -1
        for j, m in chosen.corners[v]:
            if j < 0:
                break
            b, c = minus(row(chosen.positions, j), here), minus(row(chosen.positions, m), here)
            if dot(b, b) < closest:
                closest, owner = dot(b, b), j
            along, across = nearest_in_triangle(a, b, c)
            squared = squared_distance(a, b, c, along, across)
            if squared < smallest:
                smallest, second, third, s, t = squared, j, m, along, across
        interpolated = 0.0
        for k in range(len(at_apex)):
            at_foot = at_apex[k]
            at_foot += s * (attributes.of_vertices[second, k] - at_apex[k])
            at_foot += t * (attributes.of_vertices[third, k] - at_apex[k])
            interpolated += (at_foot - attributes.of_points[q, k]) ** 2
        at_owner = at_apex if owner < 0 else attributes.of_vertices[owner]
        of_owner = squared_difference(at_owner, attributes.of_points[q])
        distance += np.sqrt(smallest) / judged
        attribute_error += scale * (DETAIL_INTERPOLATED * np.sqrt(interpolated) + DETAIL_NEAREST * np.sqrt(of_owner))
        if distance + attribute_error > limit:
            return np.inf, np.inf
    return distance, attribute_error
