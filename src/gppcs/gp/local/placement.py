"""Placement: each chosen point gives its place to the point near it that stands best for its cell.

The cell of a chosen point holds the points that are nearer to it than to the other chosen points. Of these, the step
tries the three with the least quadric error, if it is below that of the chosen point: the summed squared distance from
the tangent planes of all points of the cell (Garland and Heckbert 1997). The one to whose triangles the cell lies
nearest takes the place, if the cell lies nearer than before. With attributes, up to 20 are tried, as long as their
error alone is not too large. On convex parts, the new place is mostly a little outside the surface through its
neighbours, so the error of the triangles falls; at ridges and corners it is on these. The order of choice stays, so
every prefix gains as well.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range, nearest_in_tree
from gppcs.spatial.nearest import TASKS, look_around, search_for
from gppcs.spatial.nearest import WIDER as WIDER_SEARCH
from gppcs.spatial.row_sample import drawn
from gppcs.spatial.triangles import dot, minus, nearest_in_triangle, row, squared_distance
from gppcs.surface.error_quadrics import NUMBERS, add_plane, value
from gppcs.surface.local_surface import LocalSurface
from gppcs.surface.noise import Noise
from gppcs.surface.surface_variation import features_in_radius

PASSES = 2  # After the first, each point belongs to the nearest of its chosen point and that one's neighbours.
MOST, PROJECTED = 36, 16  # Points of a cell on average, without noise and with it; of more, a sample is drawn.
IN_BALL = 12  # Points, on average, to which a tangent plane is fitted.
REACH = 0.7  # A point goes no farther at once, in mean distances to its three nearest chosen points.
PULL = 0.01  # Weight of the squared distance from the middle of the cell, beside that from the planes.
WIDER = 1.05  # By which the largest gap may grow.
AGREEING = 0.4  # Mean cosine between the planes of a cell and the fan of its point, at least.
# A wall is thin if more than this share of the cell has planes parallel to that of the point, by their cosine, and lies
# steep above it, by the squared sine of the slope.
THROUGH, PARALLEL, STEEP = 0.1, 0.9, 0.5
TRIED = 3  # Points of a cell that are tried, at most, if only the shape counts.
# The same with attributes. With 8, the surface error of the fresco is 36 % larger; with all, a run takes longer.
TRIED_BY_DETAIL = 20
JUDGED = 10  # Points of a cell, at most, whose distance from the triangles is measured.
ROUNDING = 1e-9  # Of the reach: a gain below this is only rounding.
POINTS_AT_ONCE = 1024  # Points that a thread hands over at once, at least.

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def placed(
    points: Floats, chosen: Ints, fixed: int, area: float, noise: Noise, detail: NDArray[np.float32] | None = None
) -> Ints:
    """Return the rows of the points in whose places the chosen ones go; the first `fixed` stay.

    Shapes: points (N, 3), chosen (m,), detail (N, k); returns (m,).
    """
    stays, old = np.arange(len(chosen)) < fixed, None if detail is None else detail.take(chosen, axis=0)
    if (share := (MOST if noise.quiet else PROJECTED) * len(chosen) / len(points)) < 1.0:
        rows = np.flatnonzero(drawn(np.arange(len(points)), share))
        detail = None if detail is None else detail.take(rows, axis=0)
        new = exchanged(points[chosen], stays, points[rows], area / len(rows), noise, old, detail)
        return np.where(new < 0, chosen, rows[new])
    new = exchanged(points[chosen], stays, points, area / len(points), noise, old, detail)
    return np.where(new < 0, chosen, new)


def exchanged(
    places: Floats,
    stays: NDArray[np.bool_],
    points: Floats,
    area: float,
    noise: Noise,
    old: NDArray[np.float32] | None = None,
    detail: NDArray[np.float32] | None = None,
    farthest: float = math.inf,
) -> Ints:
    """Return which point each chosen place is exchanged for, -1 where it stays.

    `area` is that for each point. `old` and `detail` are attributes of the places and of the points that count beside
    the shape. No place goes farther than `farthest` at once. Shapes: places (m, 3), stays (m,), points (n, 3), old (m,
    k), detail (n, k); returns (m,).
    """
    cells = KdTree.build(points)
    of_point, cells = cells.order, cells.in_own_order()
    if noise.quiet:
        feet, normals = cells.points, features_in_radius(cells, math.sqrt(IN_BALL * area / math.pi)).normals
    else:
        feet, fitted = noise.projected(cells)
        normals = np.ascontiguousarray(fitted.normals.T)
    surface = LocalSurface.of(places)
    tree, order = surface.tree.in_own_order(), surface.tree.order
    points, places, stays = cells.points, np.ascontiguousarray(tree.points.T), stays[order]
    before = np.zeros((len(order), 0), dtype=np.float32) if old is None else old[order]
    after = np.zeros((len(of_point), 0), dtype=np.float32) if detail is None else detail.take(of_point, axis=0)
    new = np.full(len(order), -1)
    k = min(4, len(order))
    gaps = np.sqrt(tree.nearest_of(places, k)[1]).sum(axis=1) / max(1, k - 1)
    first, squared = nearest_each(tree, cells)
    widest = WIDER**2 * float(squared[~stays[first]].max(initial=0.0))
    del squared  # to free its memory
    owners, members = first.copy(), np.empty_like(first)
    for later in range(PASSES):
        if later:
            on_ranges(_hand_over, len(owners), points, places, surface.corners, owners, least=POINTS_AT_ONCE)
        starts = np.concatenate([[0], np.cumsum(np.bincount(owners, minlength=len(order)))])
        _gather(owners, starts[:-1].copy(), members)
        on_ranges(
            _exchange, len(order), points, feet, normals, places, surface.corners, surface.normals, first, members,
            starts, np.minimum(REACH * gaps, farthest), stays, widest, before, after, gaps, new,
        )  # fmt: skip
        stay = new[:, np.newaxis] < 0
        places, before = np.where(stay, places, points.T[new]), np.where(stay, before, after[new])
    result = np.empty(len(order), dtype=np.int64)
    result[order] = np.where(new < 0, -1, of_point[new])
    return result


def nearest_each(tree: KdTree, queries: KdTree) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return the position of the point nearest to each query, and its squared distance, (Q,) both, in tree order."""
    n = len(queries.order)
    positions, squared, tasks = np.empty(n, dtype=np.int32), np.empty(n), min(queries.leaves, TASKS)
    on_ranges(
        _nearest_each, tasks, tasks, tree.points, tree.low, tree.high, queries.points, queries.low, queries.high,
        positions, squared,
    )  # fmt: skip
    return positions, squared


@kernel
def _nearest_each(first, last, tasks, points, low, high, queries, queries_low, queries_high, positions, squared):
    """Fill positions and squared, (Q,), for queries, (3, Q), in a range of tasks; boxes are (nodes, 3)."""
    leaves = first_leaf(queries_low)
    search = search_for(1, first_leaf(low))
    for task in range(first, last):
        radius = 0.0  # squared; in the first leaf, each query searches by itself
        for leaf in range(leaves + leaves * task // tasks, leaves + leaves * (task + 1) // tasks):
            begin, end = leaf_range(queries.shape[1], leaves, leaf)
            count = look_around(points, low, high, queries_low[leaf], queries_high[leaf], radius, search)
            total = 0.0
            for q in range(begin, end):
                x, y, z = queries[0, q], queries[1, q], queries[2, q]
                slot = _nearest_packed(search.room.packed, count, x, y, z, radius, search.squared)
                positions[q] = search.room.found[slot]
                squared[q] = search.squared[slot]
                if slot < 0:
                    nearest_in_tree(points, low, high, x, y, z, search.positions, search.gaps)
                    positions[q], squared[q] = search.positions[0], search.gaps[0]
                total += squared[q]
            radius = WIDER_SEARCH * total / (end - begin)


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def _nearest_packed(packed, count, x, y, z, radius, squared):
    """Return the slot of the packed point nearest to (x, y, z), -1 if none is within the radius."""
    along_x, along_y, along_z = packed[0][:count], packed[1][:count], packed[2][:count]
    squared, least = squared[:count], np.inf
    for j in range(len(along_x)):
        dx, dy, dz = along_x[j] - x, along_y[j] - y, along_z[j] - z
        squared[j] = dx * dx + dy * dy + dz * dz
        least = min(least, squared[j])
    if not least <= radius:
        return -1
    slot = 0
    while squared[slot] > least:
        slot += 1
    return slot


@kernel(allocates=False)
def _hand_over(begin, end, points, places, corners, owners):
    """Give a range of points, (3, n), to the nearest of their owner and of the corners of its fan."""
    for q in range(begin, end):
        here, owner = row(points.T, q), owners[q]
        step = minus(row(places, owner), here)
        least = dot(step, step)
        for j, _ in corners[owners[q]]:
            if j < 0:
                break
            step = minus(row(places, j), here)
            if dot(step, step) < least:
                least, owner = dot(step, step), j
        owners[q] = owner


@kernel(allocates=False)
def _gather(owners, ends, members):
    """Fill `members`, (n,), with the points of each owner, (n,), from its end so far, (m,), on."""
    for q in range(len(owners)):
        members[ends[owners[q]]] = q
        ends[owners[q]] += 1


@kernel
def _exchange(
    begin,
    end,
    points,
    feet,
    normals,
    places,
    corners,
    upright,
    first,
    members,
    starts,
    reach,
    stays,
    widest,
    before,
    after,
    change,
    new,
):
    """Fill `new`, (m,), for a range of places, whose cells are `members`, (n,), from `starts`, (m + 1,), on.

    A place is exchanged only for points of its cell in the first pass, so no two take the same.
    """
    by_shape = after.shape[1] == 0
    most = TRIED if by_shape else TRIED_BY_DETAIL
    quadric, middle = np.empty(NUMBERS, dtype=np.float64), np.empty(after.shape[1], dtype=np.float64)
    errors = np.empty(0, dtype=np.float64)
    for v in range(begin, end):
        cell, place, fan = members[starts[v] : starts[v + 1]], row(places, v), corners[v]
        if stays[v] or len(cell) < 2 or not _is_one_sheet(feet, normals, cell, place, row(upright, v)):
            continue
        if len(cell) > len(errors):
            errors = np.empty(2 * len(cell), dtype=np.float64)
        own = _errors(
            v, points, feet, normals, places, cell, first, reach[v], before, after, change[v], quadric, middle, errors
        )
        least = (0.0 if by_shape else own) - ROUNDING * reach[v]
        least += _off_fan(feet, places, fan, place, before, before[v], after, change[v], cell, np.inf)
        tried = 0
        while tried < most:  # in the order of the error, up to that of the place; with attributes, while it is small
            slot = np.argmin(errors[: len(cell)])
            x, error, errors[slot] = cell[slot], errors[slot], np.inf
            if error == np.inf or error >= (own if by_shape else least):
                break
            if not _covers(points, row(points.T, x), cell, widest):
                continue
            total, to = 0.0 if by_shape else error, row(points.T, x)
            total += _off_fan(feet, places, fan, to, before, after[x], after, change[v], cell, least - total)
            if total < least:
                least, new[v] = total, x
            tried += 1


@kernel(allocates=False)
def _is_one_sheet(feet, normals, cell, place, upright):
    """Return whether the planes of a cell are those of one sheet, given a place and the normal of its fan.

    They are not where the points lie on dense curves, whose planes say nothing of the surface, and where a wall is so
    thin that the cell reaches through it.
    """
    agreement, nearest, own, through = 0.0, np.inf, cell[0], 0
    for q in cell:
        step = minus(row(feet.T, q), place)
        agreement += abs(dot(row(normals, q), upright))
        if dot(step, step) < nearest:
            nearest, own = dot(step, step), q
    if agreement < AGREEING * len(cell):
        return False
    for q in cell:
        step, normal = minus(row(feet.T, q), row(feet.T, own)), row(normals, own)
        if abs(dot(row(normals, q), normal)) > PARALLEL and dot(step, normal) ** 2 > STEEP * dot(step, step):
            through += 1
    return through <= THROUGH * len(cell)


@kernel(allocates=False)
def _errors(v, points, feet, normals, places, cell, first, reach, before, after, change, quadric, middle, errors):
    """Fill `errors`, (n,), with those of the points of a cell, infinite beyond reach; return that of the place itself.

    The error of a point is the root mean square of its distance from the planes of the cell, beside which its
    attributes count by their difference from the mean of the cell; it is summed as `_off_fan` sums distances.
    """
    place, n, judged = row(places, v), len(cell), -(-len(cell) // _stride(cell))
    quadric[:], middle[:] = 0.0, 0.0
    x = y = z = 0.0
    for q in cell:
        step, normal = minus(row(feet.T, q), place), row(normals, q)
        add_plane(quadric, normal, -dot(normal, step), 1.0)
        x, y, z = x + step[0] / n, y + step[1] / n, z + step[2] / n
        for c in range(len(middle)):
            middle[c] += after[q, c] / n
    for slot, q in enumerate(cell):
        step, errors[slot] = minus(row(points.T, q), place), np.inf
        if first[q] == v and dot(step, step) <= reach * reach:
            squared = value(quadric, step) / n + PULL * _squared(minus(step, (x, y, z)))
            errors[slot] = judged * np.sqrt(max(0.0, squared) + change**2 * _apart(after[q], middle))
    squared = value(quadric, (0.0, 0.0, 0.0)) / n + PULL * _squared((x, y, z))
    return judged * np.sqrt(max(0.0, squared) + change**2 * _apart(before[v], middle))


@kernel(allocates=False)
def _stride(cell):
    """Return which of the points of a cell are judged: each first of so many."""
    return -(-len(cell) // JUDGED)


@kernel(allocates=False)
def _squared(vector):
    """Return the squared length of a vector."""
    return dot(vector, vector)


@kernel(allocates=False)
def _apart(attributes, others):
    """Return the squared difference of some attributes, (k,), from others."""
    squared = 0.0
    for c in range(len(others)):
        squared += (attributes[c] - others[c]) ** 2
    return squared


@kernel(allocates=False)
def _covers(points, place, cell, widest):
    """Return whether no point of a cell is farther from a place than so much, squared."""
    for q in cell:
        step = minus(row(points.T, q), place)
        if dot(step, step) > widest:
            return False
    return True


@kernel(allocates=False)
def _off_fan(feet, places, corners, apex, before, own, after, change, cell, most):
    """Return the summed distance of a cell from the fan of triangles around an apex, or what is more than `most`.

    The difference of the attributes from those that are interpolated in the nearest triangle is distance, too, given
    those of the corners, (m, k), of the apex, (k,), and of the cell, (n, k). Without triangles, it is 0.
    """
    total = 0.0
    for slot in range(0, len(cell), _stride(cell)):
        q = cell[slot]
        here, least = row(feet.T, q), np.inf
        a, second, third, s, t = minus(apex, here), 0, 0, 0.0, 0.0
        for j, m in corners:
            if j < 0:
                break
            b, c = minus(row(places, j), here), minus(row(places, m), here)
            along, across = nearest_in_triangle(a, b, c)
            squared = squared_distance(a, b, c, along, across)
            if squared < least:
                least, second, third, s, t = squared, j, m, along, across
        if least == np.inf:
            return 0.0
        apart = 0.0
        for k in range(len(own)):
            interpolated = own[k] + s * (before[second, k] - own[k]) + t * (before[third, k] - own[k])
            apart += (interpolated - after[q, k]) ** 2
        total += np.sqrt(least) + change * np.sqrt(apart)
        if total > most:
            break
    return total
