"""Choice in a cell by its shape: by the quadric error (Eq. (10)), then by the distance from the triangles."""

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.gp.local.settings import PULL, TRIALS
from gppcs.spatial.triangles import approach, dot, minus, row
from gppcs.surface.error_quadrics import add_plane, value

DISTANCE_ROUNDING = 1e-9  # Distances that change by less, in mean distances of kept points, are only rounded.
LANES = 4  # Numbers of feet that are judged are multiples of this.


@kernel(allocates=False)
def fill_errors(observed, attributes, chosen, v, cell, first, quadric, middle, errors):
    """Fill `errors`, (n,), with the roots of Eq. (20) at its points, infinite beyond a step; return the vertex's."""
    points, feet, normals = observed
    steps, scale = chosen.steps[v], chosen.gaps[v]
    vertex, n = row(chosen.positions, v), len(cell)
    quadric[:], middle[:] = 0.0, 0.0
    x = y = z = 0.0
    for q in cell:
        step, normal = minus(row(feet.T, q), vertex), row(normals, q)
        add_plane(quadric, normal, -dot(normal, step), 1.0)
        x, y, z = x + step[0] / n, y + step[1] / n, z + step[2] / n
        if attributes is not None:
            for c in range(len(middle)):
                middle[c] += attributes.of_points[q, c] / n
    for slot, q in enumerate(cell):
        step, errors[slot] = minus(row(points.T, q), vertex), np.inf
        if first[q] == v and dot(step, step) <= steps * steps:
            to_middle = minus(step, (x, y, z))
            squared = max(0.0, value(quadric, step) / n + PULL * dot(to_middle, to_middle))  # Eq. (10)
            if attributes is not None:
                squared += scale**2 * squared_difference(attributes.of_points[q], middle)
            errors[slot] = np.sqrt(squared)  # Eq. (20), the root
    squared = max(0.0, value(quadric, (0.0, 0.0, 0.0)) / n + PULL * dot((x, y, z), (x, y, z)))
    if attributes is not None:
        squared += scale**2 * squared_difference(attributes.of_vertices[v], middle)
    return np.sqrt(squared)


@kernel(allocates=False)
def squared_difference(attributes, other):
    """Return the squared difference of attributes, (k,), from others, (k,)."""
    squared = 0.0
    for c in range(len(other)):
        squared += (attributes[c] - other[c]) ** 2
    return squared


@kernel(inline="always")
def next_point(points, cell, errors, limit, widest):
    """Return the point of least error, below a limit, that is near all of its cell, and this error; -1 if none is."""
    while True:
        slot = np.argmin(errors[: len(cell)])
        x, error, errors[slot] = cell[slot], errors[slot], np.inf
        if error == np.inf or error >= limit:
            return -1, error
        if _covers(points, row(points.T, x), cell, widest):
            return x, error


@kernel(inline="always")
def _covers(points, vertex, cell, widest):
    """Return whether no point of a cell is farther from a point than so much, squared."""
    for q in cell:
        step = minus(row(points.T, q), vertex)
        if dot(step, step) > widest:
            return False
    return True


@kernel(allocates=False)
def best_by_shape(observed, chosen, v, cell, widest, current, errors, local, squared):
    """Return the point of a cell to whose triangles this lies nearest, of those of least error; -1 for the vertex."""
    vertex, fan, best = row(chosen.positions, v), chosen.corners[v], -1
    judged, full = pack_feet(observed.feet, cell, vertex, local)
    smallest = _off_triangles(local, squared[:full], judged, chosen.positions, fan, vertex, vertex)
    smallest -= DISTANCE_ROUNDING * chosen.steps[v]
    for _ in range(TRIALS):
        x, _ = next_point(observed.points, cell, errors, current, widest)
        if x < 0:
            break
        to = row(observed.points.T, x)
        total = _off_triangles(local, squared[:full], judged, chosen.positions, fan, vertex, to)
        if total < smallest:
            smallest, best = total, x
    return best


@kernel(allocates=False)
def pack_feet(feet, cell, origin, local):
    """Fill `local`, (3, n), with feet of a cell, relative to an origin; return their number, and with padding."""
    stride = -(-len(cell) // local.shape[1])
    judged = -(-len(cell) // stride)
    full = -(-judged // LANES) * LANES  # the last is repeated, so that loops are vectorised
    for slot in range(full):
        step = minus(row(feet.T, cell[stride * min(slot, judged - 1)]), origin)
        local[0, slot], local[1, slot], local[2, slot] = step
    return judged, full


@kernel(allocates=False)
def _off_triangles(local, squared, judged, vertices, corners, origin, apex):
    """Return the summed distance of the first feet, of (3, n), from the fan around an apex; 0 if it is empty."""
    squared[:] = np.inf
    a = minus(apex, origin)
    for j, k in corners:
        if j < 0:
            break
        approach(local, squared, a, minus(row(vertices, j), origin), minus(row(vertices, k), origin))
    if corners[0, 0] < 0:
        return 0.0
    return sum_of_roots(squared[:judged])


@kernel(inline="always")
def sum_of_roots(squared):
    """Return the summed distance, by the squares."""
    total = 0.0
    for q in range(len(squared)):
        total += np.sqrt(squared[q])
    return total
