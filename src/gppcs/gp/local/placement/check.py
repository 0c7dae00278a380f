"""The check of all exchanges together: by the surface of all placed points."""

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.placement.cells import Cells
from gppcs.gp.local.placement.shape import pack_feet, sum_of_roots
from gppcs.gp.local.settings import CHECKED_ON
from gppcs.spatial.triangles import approach, dot, minus, row
from gppcs.surface.local_surface import LocalSurface


def farther(
    chosen: LocalSurface, placed: LocalSurface, near: Ints, cells: Cells, moved: Flags, feet: Floats, allowed: Floats
) -> NDArray[np.intp]:
    """Return the moved points, (k,), whose cells are farther from the surface of all placed points than before.

    Those are left out whose mean distance grows by no more than is allowed. The trees of both surfaces have the same
    order. The surface near a cell is that of the fans of its point and of the others near this.
    Shapes: near (m, NEAR), moved (m,), feet (3, n), allowed (m,).
    """
    is_farther = np.zeros(len(moved), dtype=np.bool_)
    fans = [(np.ascontiguousarray(surface.tree.points.T), surface.corners) for surface in (chosen, placed)]
    judged = feet, *cells, moved, allowed
    on_ranges(_mark_farther, len(moved), near, chosen.normals, *fans, *judged, is_farther, minimum=64)
    return np.flatnonzero(is_farther)


@kernel
def _mark_farther(begin, end, others, normals, chosen, placed, feet, members, starts, moved, allowed, is_farther):
    """Mark the moved points of a range whose cells are farther from the fans near them once all are placed.

    The feet of a cell are `members` from `starts`, (m + 1,), on. `chosen` and `placed` are vertices and corners.
    """
    vertices, corners = chosen
    near = np.empty(1 + others.shape[1], dtype=np.int64)
    triangles = np.empty((3, len(near) * corners.shape[1]), dtype=np.int64)
    local, squared = np.empty((3, CHECKED_ON), dtype=np.float64), np.empty(CHECKED_ON, dtype=np.float64)
    for i in range(begin, end):
        cell, apex = members[starts[i] : starts[i + 1]], row(vertices, i)
        if len(cell) == 0 or not moved[i]:
            continue
        near[0], near[1:] = i, others[i]
        if _is_beside_a_sheet(vertices, normals, near):
            continue  # fans may reach from one sheet to the other, so the distances say little
        judged, full = pack_feet(feet, cell, apex, local)
        before = _off_fans(local, squared[:full], judged, chosen, near, i, apex, triangles, 0.0)
        threshold = before + judged * allowed[i]
        after = _off_fans(local, squared[:full], judged, placed, near, i, apex, triangles, threshold)
        is_farther[i] = after > threshold


@kernel(allocates=False)
def _off_fans(local, squared, judged, fans, near, i, origin, triangles, threshold):
    """Return the summed distance of the first feet, of (3, n), from a point and some fans; both may share triangles.

    Fans that can only lower a distance that is at most a threshold are left out. Feet are relative to an origin;
    `squared`, (n,), and `triangles`, (3, t), are scratch memory.
    """
    (vertices, corners), step = fans, minus(row(fans[0], i), origin)
    for q in range(len(squared)):
        squared[q] = (local[0, q] - step[0]) ** 2 + (local[1, q] - step[1]) ** 2 + (local[2, q] - step[2]) ** 2
    radius, limit, count = np.sqrt(_greatest(squared)) + np.sqrt(dot(step, step)), np.inf, 0  # of feet about the origin
    total = 0.0
    for centre in near:  # the first is the point itself
        a = minus(row(vertices, centre), origin)
        for j, k in corners[centre]:
            if j < 0:
                break
            b, c = minus(row(vertices, j), origin), minus(row(vertices, k), origin)
            triangle = min(centre, j, k), max(centre, j, k), centre + j + k
            if _is_beyond(a, b, c, limit) or _is_among(triangle, triangles, count):
                continue
            triangles[0, count], triangles[1, count], triangles[2, count] = triangle
            count += 1
            approach(local, squared, a, b, c)
        limit, total = radius + np.sqrt(_greatest(squared)), sum_of_roots(squared[:judged])
        if total <= threshold:
            break
    return total


@kernel(inline="always")
def _greatest(values):
    """Return the greatest of values, (n,), that are not negative; the method of arrays takes long to compile."""
    greatest = 0.0
    for number in values:
        greatest = max(greatest, number)
    return greatest


@kernel(allocates=False)
def _is_beside_a_sheet(vertices, normals, near):
    """Return whether a parallel sheet is near a point, (k,) with the point first; where points scatter, none is."""
    along = False
    for j in near[1:]:
        step, normal = minus(row(vertices, j), row(vertices, near[0])), row(normals, near[0])
        if abs(dot(row(normals, j), normal)) < 0.9:
            return False
        along = along or dot(step, normal) ** 2 > 0.5 * dot(step, step)
    return along


@kernel(inline="always")
def _is_beyond(a, b, c, limit):
    """Return whether a plane keeps a triangle farther than so much from the origin."""
    middle = a[0] + b[0] + c[0], a[1] + b[1] + c[1], a[2] + b[2] + c[2]
    along = min(dot(a, middle), dot(b, middle), dot(c, middle))
    return along > 0.0 and along * along > limit * limit * dot(middle, middle)


@kernel(inline="always")
def _is_among(triangle, triangles, count):
    """Return whether three numbers are among the first others, of (3, t), without branches."""
    first, second, third = triangle
    repeats = 0
    for t in range(count):
        repeats += (triangles[0, t] == first) & (triangles[1, t] == second) & (triangles[2, t] == third)
    return repeats > 0
