"""Placement: each chosen point is exchanged for the point near it that stands best for its cell.

Of the points of its cell, those with the least quadric error are tried (Eq. (10); Garland and Heckbert 1997). The one
to whose triangles the cell lies nearest replaces it; with attributes, that with the least F of Eq. (20). Where the
cell turns out to be farther from the surface of all new points than from that of the chosen ones, by more than its
attributes gained, the point goes back. The order of choice stays, so every prefix gains as well.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.candidates import radius_of_plane
from gppcs.gp.local.settings import (
    CELL_POINTS,
    CHECKED_ON,
    DETAIL_INTERPOLATED,
    DETAIL_NEAREST,
    DETAIL_TRIALS,
    DETAIL_TRIED_ON,
    GAP_GROWTH,
    MAX_STEP,
    NOISY_CELL_POINTS,
    PULL,
    TRIALS,
    TRIED_ON,
)
from gppcs.spatial.kdtree import KdTree, nearest_in_tree
from gppcs.spatial.nearest import nearest_of_each
from gppcs.spatial.samples import point_hashes
from gppcs.spatial.triangles import approach, dot, minus, nearest_in_triangle, row, squared_distance
from gppcs.surface.error_quadrics import NUMBERS, add_plane, value
from gppcs.surface.local_surface import LocalSurface
from gppcs.surface.noise import Noise, projected
from gppcs.surface.quadrics import Quadrics
from gppcs.surface.surface_variation import features_in_radius

ROUNDING = 1e-9  # Distances that change by less, in mean distances of kept points, are only rounded.
LANES = 8  # Numbers of feet that are judged are multiples of this.
NEAR_FANS = 9  # Fans in which the surface near a cell is searched: of its point, of its ring on average, and two more.


def place(
    points: Floats,
    chosen: Ints,
    fixed: int,
    area: float,
    noise: Noise,
    detail: NDArray[np.float32] | None = None,
    tree: KdTree | None = None,
    fitted: Quadrics | None = None,
    normals: Floats | None = None,
) -> Ints:
    """Return the points for which the chosen ones are exchanged; the first `fixed` stay.

    If they are not given, this builds the tree over all points, and computes quadrics around them (if noise matters) or
    normals, in tree order. Shapes: points and normals (N, 3), chosen (m,), detail (N, k); returns (m,).
    """
    stays, old = np.arange(len(chosen)) < fixed, None if detail is None else detail.take(chosen, axis=0)
    fraction = (CELL_POINTS if noise.is_negligible else NOISY_CELL_POINTS) * len(chosen) / len(points)
    if fraction < 1.0:
        drawn = np.flatnonzero(point_hashes(points, seed=1, bits=32) < np.uint64(fraction * 2**32))
        detail = None if detail is None else detail.take(drawn, axis=0)
        cells = KdTree.build(points[drawn])
        new = replacements(points[chosen], stays, cells, area / len(drawn), noise, old, detail)
        return np.where(new < 0, chosen, drawn[new])
    cells = KdTree.build(points) if tree is None else tree
    new = replacements(
        points[chosen], stays, cells, area / len(points), noise, old, detail, fitted=fitted, normals=normals
    )
    return np.where(new < 0, chosen, new)


def replacements(
    vertices: Floats,
    stays: Flags,
    cells: KdTree,
    area: float,
    noise: Noise,
    old: NDArray[np.float32] | None = None,
    detail: NDArray[np.float32] | None = None,
    farthest: float = math.inf,
    passes: int = 2,
    fitted: Quadrics | None = None,
    normals: Floats | None = None,
) -> Ints:
    """Return for which point each vertex, a chosen point, is exchanged, -1 where it stays.

    The tree is over the points, and `area` is that for each. `old` and `detail` are attributes of the vertices and of
    the points. No vertex goes farther than `farthest` at once. Shapes: vertices (m, 3), stays (m,), old (m, k), detail
    (n, k); returns (m,).
    """
    of_point, cells = cells.order, cells.in_own_order()
    surface = LocalSurface.from_points(vertices)
    order, surface = surface.tree.order, replace(surface, tree=surface.tree.in_own_order())
    chosen = _Vertices.from_surface(surface, stays[order], farthest, None if old is None else old[order])
    of_points = np.zeros((len(of_point), 0), dtype=np.float32) if detail is None else detail.take(of_point, axis=0)
    observed = _Observed(cells.points, *_planes(cells, area, noise, fitted, normals), of_points)
    first, widest = _owners(surface.tree, cells, chosen.stays)
    nearest, feet = cells_of(first, len(order)), observed.feet
    new, positions, gains = _exchanged(observed, chosen, first, nearest, widest, passes)
    del observed, of_points  # as large as the surface of the new points
    if not noise.thick:
        placed = LocalSurface.over(KdTree.over(positions.T))
        new[farther(surface, placed, nearest, new >= 0, feet, ROUNDING * chosen.gaps + gains)] = -1
    result = np.empty(len(order), dtype=np.int64)
    result[order] = np.where(new < 0, -1, of_point[new])
    return result


def _owners(tree: KdTree, cells: KdTree, stays: Flags) -> tuple[NDArray[np.int32], float]:
    """Return the vertex nearest to each point, (n,), and how far, squared, a point may be from that of its cell."""
    owners, squared = nearest_of_each(tree, cells)
    exchanged = squared[~stays[owners]] if stays.any() else squared
    return owners, GAP_GROWTH**2 * float(exchanged.max(initial=0.0))


def _exchanged(
    observed: _Observed, chosen: _Vertices, first: NDArray[np.int32], nearest: Cells, widest: float, passes: int
) -> tuple[Ints, Floats, Floats]:
    """Return for which point each vertex is exchanged, -1 where it stays, all positions then, and the attributes' gain.

    It adds by how much their part of the mean of Eq. (20) fell in each pass. Shapes: (m,), (m, 3) and (m,).
    """
    new, owners, cells = np.full(len(chosen.positions), -1), first, nearest
    gains = np.zeros(len(new))
    for later in range(passes):
        if later:
            owners = owners.copy()
            on_ranges(_hand_over, len(owners), observed, chosen, owners, minimum=1024)
            cells = cells_of(owners, len(new))
        on_ranges(_exchange, len(new), observed, chosen, first, *cells, widest, new, gains, minimum=64)
        moved, positions, attributes = np.flatnonzero(new >= 0), chosen.positions.copy(), chosen.attributes.copy()
        positions[moved], attributes[moved] = observed.points.T[new[moved]], observed.attributes[new[moved]]
        chosen = chosen._replace(positions=positions, attributes=attributes)
    return new, chosen.positions, gains


class _Observed(NamedTuple):
    """The points of the cells, and the surface that they observe."""

    points: Floats  # (3, n)
    feet: Floats  # (3, n), on their planes
    normals: Floats  # (n, 3), of these
    attributes: NDArray[np.float32]  # (n, k), none without detail


class Cells(NamedTuple):
    """The points of each of m owners."""

    members: NDArray[np.int32]  # (n,), owner by owner
    starts: Ints  # (m + 1,), where those of each start


class _Vertices(NamedTuple):
    """The chosen points with the fans of triangles around them, in tree order."""

    positions: Floats  # (m, 3)
    attributes: NDArray[np.float32]  # (m, k)
    corners: NDArray[np.int32]  # (m, triangles, 2), of the fans; -1 after the last
    normals: Floats  # (m, 3), of the fans
    gaps: Floats  # (m,), mean distance from the nearest others
    steps: Floats  # (m,), how far each may go
    stays: Flags  # (m,)

    @classmethod
    def from_surface(
        cls, surface: LocalSurface, stays: Flags, farthest: float, attributes: NDArray[np.float32] | None
    ) -> _Vertices:
        """Return the points of a surface."""
        positions = np.ascontiguousarray(surface.tree.points.T)
        n, k = len(positions), min(4, len(positions))
        gaps = np.sqrt(surface.tree.nearest_of(positions, k)[1]).sum(axis=1) / max(1, k - 1)
        if attributes is None:
            attributes = np.zeros((n, 0), dtype=np.float32)
        steps = np.minimum(MAX_STEP * gaps, farthest)
        return cls(positions, attributes, surface.corners, surface.normals, gaps, steps, stays)


def _planes(
    cells: KdTree, area: float, noise: Noise, fitted: Quadrics | None, normals: Floats | None
) -> tuple[Floats, Floats]:
    """Return the feet of the points of a tree on the surface below their noise, (3, n), and its normals, (n, 3)."""
    if noise.is_negligible:
        return cells.points, features_in_radius(cells, radius_of_plane(area)).normals if normals is None else normals
    fitted = noise.fitted(cells) if fitted is None else fitted
    return projected(cells.points, fitted), fitted.normals.T.astype(np.float64, order="C")


@kernel(allocates=False)
def _hand_over(begin, end, observed, chosen, owners):
    """Give a range of points to the nearest of their owner, (n,), and of the corners of its fan."""
    for q in range(begin, end):
        here, owner = row(observed.points.T, q), owners[q]
        step = minus(row(chosen.positions, owner), here)
        smallest = dot(step, step)
        for j, _ in chosen.corners[owners[q]]:
            if j < 0:
                break
            step = minus(row(chosen.positions, j), here)
            if dot(step, step) < smallest:
                smallest, owner = dot(step, step), j
        owners[q] = owner


def cells_of(owners: NDArray[np.int32], m: int) -> Cells:
    """Return the cells of m owners, by the owner of each point, (n,)."""
    members, starts = np.empty_like(owners), np.zeros(m + 1, dtype=np.int64)
    _gather(owners, members, starts)
    return Cells(members, starts)


@kernel(allocates=False)
def _gather(owners, members, starts):
    """Fill `members`, (n,), owner by owner, and `starts`, (m + 1,), which are 0."""
    for owner in owners:
        starts[owner] += 1
    total = len(owners)
    for owner in range(len(starts) - 1, -1, -1):  # from counts to ends, which become starts as members are filled in
        total -= starts[owner]
        starts[owner] += total
    for q in range(len(owners) - 1, -1, -1):
        starts[owners[q]] -= 1
        members[starts[owners[q]]] = q


@kernel
def _exchange(begin, end, observed, chosen, first, members, starts, widest, new, gains):
    """Fill `new` and add to `gains`, (m,), for a range of vertices.

    Their cells are `members`, (n,), from `starts`, (m + 1,), on.
    """
    errors = np.empty(0, dtype=np.float64)
    quadric, middle = np.empty(NUMBERS, dtype=np.float64), np.empty(observed.attributes.shape[1], dtype=np.float64)
    local, squared = np.empty((3, TRIED_ON), dtype=np.float64), np.empty(TRIED_ON, dtype=np.float64)
    for v in range(begin, end):
        cell, vertex = members[starts[v] : starts[v + 1]], row(chosen.positions, v)
        if chosen.stays[v] or len(cell) < 2:
            continue
        if not _is_one_sheet(observed.feet, observed.normals, cell, vertex, row(chosen.normals, v)):
            continue
        if len(cell) > len(errors):
            errors = np.empty(2 * len(cell), dtype=np.float64)
        current = _errors(observed, chosen, v, cell, first, quadric, middle, errors)
        if observed.attributes.shape[1] == 0:
            best = _best_by_shape(observed, chosen, v, cell, widest, current, errors, local, squared)
        else:
            best, gain = _best_with_attributes(observed, chosen, v, cell, widest, current, errors)
            gains[v] += gain
        if best >= 0:
            new[v] = best


@kernel(allocates=False)
def _best_by_shape(observed, chosen, v, cell, widest, current, errors, local, squared):
    """Return the point of a cell to whose triangles this lies nearest, of those of least error; -1 for the vertex."""
    vertex, fan, best = row(chosen.positions, v), chosen.corners[v], -1
    judged, full = _pack_feet(observed.feet, cell, vertex, local)
    smallest = _off_triangles(local, squared[:full], judged, chosen.positions, fan, vertex, vertex)
    smallest -= ROUNDING * chosen.steps[v]
    for _ in range(TRIALS):
        x, _ = _next_point(observed.points, cell, errors, current, widest)
        if x < 0:
            break
        to = row(observed.points.T, x)
        total = _off_triangles(local, squared[:full], judged, chosen.positions, fan, vertex, to)
        if total < smallest:
            smallest, best = total, x
    return best


@kernel(allocates=False)
def _best_with_attributes(observed, chosen, v, cell, widest, current, errors):
    """Return the point of a cell with the least F of Eq. (20), or -1 for the vertex, and what its attributes gain."""
    vertex, best = row(chosen.positions, v), -1
    distance, before = _off_fan(observed, chosen, v, vertex, chosen.attributes[v], cell, np.inf)
    smallest = current + distance + before - ROUNDING * chosen.gaps[v]
    after = before
    for _ in range(DETAIL_TRIALS):
        x, error = _next_point(observed.points, cell, errors, smallest, widest)
        if x < 0:
            break
        to, at_apex = row(observed.points.T, x), observed.attributes[x]
        distance, attribute_error = _off_fan(observed, chosen, v, to, at_apex, cell, smallest - error)
        total = error + distance + attribute_error
        if total < smallest:
            smallest, best, after = total, x, attribute_error
    return best, max(0.0, before - after)


@kernel(inline="always")
def _next_point(points, cell, errors, limit, widest):
    """Return the point of least error, below a limit, that is near all of its cell, and this error; -1 if none is."""
    while True:
        slot = np.argmin(errors[: len(cell)])
        x, error, errors[slot] = cell[slot], errors[slot], np.inf
        if error == np.inf or error >= limit:
            return -1, error
        if _covers(points, row(points.T, x), cell, widest):
            return x, error


@kernel(allocates=False)
def _is_one_sheet(feet, normals, cell, vertex, fan_normal):
    """Return whether the planes of a cell are those of one sheet, by a vertex and the normal of its fan."""
    agreement, nearest, middle, through = 0.0, np.inf, cell[0], 0
    for q in cell:
        step = minus(row(feet.T, q), vertex)
        agreement += abs(dot(row(normals, q), fan_normal))
        if dot(step, step) < nearest:
            nearest, middle = dot(step, step), q
    if agreement < 0.4 * len(cell):
        return False
    for q in cell:
        step, normal = minus(row(feet.T, q), row(feet.T, middle)), row(normals, middle)
        if abs(dot(row(normals, q), normal)) > 0.9 and dot(step, normal) ** 2 > 0.5 * dot(step, step):
            through += 1
    return through <= 0.1 * len(cell)


@kernel(allocates=False)
def _errors(observed, chosen, v, cell, first, quadric, middle, errors):
    """Fill `errors`, (n,), with the roots of Eq. (20) at its points, infinite beyond a step; return the vertex's."""
    points, feet, normals, point_attributes = observed
    steps, scale = chosen.steps[v], chosen.gaps[v]
    vertex, n = row(chosen.positions, v), len(cell)
    quadric[:], middle[:] = 0.0, 0.0
    x = y = z = 0.0
    for q in cell:
        step, normal = minus(row(feet.T, q), vertex), row(normals, q)
        add_plane(quadric, normal, -dot(normal, step), 1.0)
        x, y, z = x + step[0] / n, y + step[1] / n, z + step[2] / n
        for c in range(len(middle)):
            middle[c] += point_attributes[q, c] / n
    for slot, q in enumerate(cell):
        step, errors[slot] = minus(row(points.T, q), vertex), np.inf
        if first[q] == v and dot(step, step) <= steps * steps:
            to_middle = minus(step, (x, y, z))
            squared = value(quadric, step) / n + PULL * dot(to_middle, to_middle)  # Eq. (10)
            squared = max(0.0, squared) + scale**2 * _squared_difference(point_attributes[q], middle)
            errors[slot] = np.sqrt(squared)  # Eq. (20), the root
    squared = value(quadric, (0.0, 0.0, 0.0)) / n + PULL * dot((x, y, z), (x, y, z))
    return np.sqrt(max(0.0, squared) + scale**2 * _squared_difference(chosen.attributes[v], middle))


@kernel(allocates=False)
def _squared_difference(attributes, other):
    """Return the squared difference of attributes, (k,), from others, (k,)."""
    squared = 0.0
    for c in range(len(other)):
        squared += (attributes[c] - other[c]) ** 2
    return squared


@kernel(inline="always")
def _covers(points, vertex, cell, widest):
    """Return whether no point of a cell is farther from a point than so much, squared."""
    for q in cell:
        step = minus(row(points.T, q), vertex)
        if dot(step, step) > widest:
            return False
    return True


@kernel(allocates=False)
def _pack_feet(feet, cell, origin, local):
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
    return _sum_of_roots(squared[:judged])


@kernel(allocates=False)
def _off_fan(observed, chosen, v, apex, at_apex, cell, limit):
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
            at_foot += s * (chosen.attributes[second, k] - at_apex[k])
            at_foot += t * (chosen.attributes[third, k] - at_apex[k])
            interpolated += (at_foot - observed.attributes[q, k]) ** 2
        of_owner = _squared_difference(at_apex if owner < 0 else chosen.attributes[owner], observed.attributes[q])
        distance += np.sqrt(smallest) / judged
        attribute_error += scale * (DETAIL_INTERPOLATED * np.sqrt(interpolated) + DETAIL_NEAREST * np.sqrt(of_owner))
        if distance + attribute_error > limit:
            return np.inf, np.inf
    return distance, attribute_error


def farther(
    chosen: LocalSurface, placed: LocalSurface, cells: Cells, moved: Flags, feet: Floats, allowed: Floats
) -> NDArray[np.intp]:
    """Return the moved points, (k,), whose cells are farther from the surface of all placed points than before.

    Those are left out whose mean distance grows by no more than is allowed. The trees of both surfaces have the same
    order. Shapes: moved (m,), feet (3, n), allowed (m,).
    """
    is_farther = np.zeros(len(moved), dtype=np.bool_)
    fans = [(np.ascontiguousarray(surface.tree.points.T), surface.corners) for surface in (chosen, placed)]
    judged = feet, *cells, moved, allowed
    on_ranges(_mark_farther, len(moved), *chosen.tree.arrays, chosen.normals, *fans, *judged, is_farther, minimum=64)
    return np.flatnonzero(is_farther)


@kernel
def _mark_farther(
    begin, end, points, lower, upper, normals, chosen, placed, feet, members, starts, moved, allowed, is_farther
):
    """Mark the moved points of a range whose cells are farther from the fans near them once all are placed.

    The feet of a cell are `members` from `starts`, (m + 1,), on. `chosen` and `placed` are vertices and corners.
    """
    vertices, corners = chosen
    near = np.empty(min(NEAR_FANS, len(vertices)), dtype=np.int64)
    gaps, triangles = np.empty(len(near), dtype=np.float64), np.empty((3, len(near) * corners.shape[1]), dtype=np.int64)
    local, squared = np.empty((3, CHECKED_ON), dtype=np.float64), np.empty(CHECKED_ON, dtype=np.float64)
    for i in range(begin, end):
        cell, apex = members[starts[i] : starts[i + 1]], row(vertices, i)
        if len(cell) == 0 or not moved[i]:
            continue
        nearest_in_tree(points, lower, upper, apex[0], apex[1], apex[2], near, gaps)
        if _is_beside_a_sheet(vertices, normals, near):
            continue  # fans may reach from one sheet to the other, so the distances say little
        judged, full = _pack_feet(feet, cell, apex, local)
        before = _off_fans(local, squared[:full], judged, chosen, near, i, apex, triangles)
        after = _off_fans(local, squared[:full], judged, placed, near, i, apex, triangles)
        is_farther[i] = after > before + judged * allowed[i]


@kernel
def _off_fans(local, squared, judged, fans, near, i, origin, triangles):
    """Return the summed distance of the first feet, of (3, n), from a point and some fans; both may share triangles.

    Feet are relative to an origin; `squared`, (n,), and `triangles`, (3, t), are scratch memory.
    """
    (vertices, corners), step = fans, minus(row(fans[0], i), origin)
    _measure_from(local, squared, step)
    radius, limit, count = np.sqrt(_greatest(squared)) + np.sqrt(dot(step, step)), np.inf, 0  # of feet about the origin
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
        limit = radius + np.sqrt(_greatest(squared))
    return _sum_of_roots(squared[:judged])


@kernel(allocates=False)
def _greatest(values):
    """Return the greatest of values, (n,), that are not negative; the method of arrays takes long to compile."""
    greatest = 0.0
    for number in values:
        greatest = max(greatest, number)
    return greatest


@kernel(allocates=False)
def _measure_from(local, squared, origin):
    """Fill `squared`, (n,), with the squared distances of feet, (3, n), from a point."""
    for q in range(len(squared)):
        squared[q] = (local[0, q] - origin[0]) ** 2 + (local[1, q] - origin[1]) ** 2 + (local[2, q] - origin[2]) ** 2


@kernel(allocates=False)
def _sum_of_roots(squared):
    """Return the summed distance, by the squares."""
    total = 0.0
    for q in range(len(squared)):
        total += np.sqrt(squared[q])
    return total


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


@kernel(allocates=False)
def _is_among(triangle, triangles, count):
    """Return whether three numbers are among the first others, of (3, t), without branches."""
    first, second, third = triangle
    repeats = 0
    for t in range(count):
        repeats += (triangles[0, t] == first) & (triangles[1, t] == second) & (triangles[2, t] == third)
    return repeats > 0
