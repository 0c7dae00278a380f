"""Weighted sample elimination (Yuksel 2015): a Poisson disc set of exactly the size asked for."""

from bisect import bisect_left
from collections.abc import Callable

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.box_distances import squared_distance_of_boxes, squared_distance_to_box, squared_span_of_boxes
from gppcs.spatial.greatest import greater_child, greatest_in_leaf, greatest_of_all
from gppcs.spatial.kdtree import KdTree, after, first_leaf, leaf_range
from gppcs.spatial.nearest import nearest_others
from gppcs.spatial.spacing import surface_area

BETA, GAMMA = 0.65, 1.5  # Yuksel's constants of weight limiting
WHOLE = 2.0**28  # the largest term of a weight; terms are whole numbers, so that sums do not depend on their order
REMOVED = -(2.0**60)  # the weight of a removed point: far below all others, even after subtractions
LAST_RATIO = 40  # the last stage removes at most this factor of points; a disc then holds about 145 points
EARLIER_RATIO = 10  # earlier stages remove at most this factor


def eliminate(points: Floats, n_points: int, on_progress: Callable[[int], None] | None = None) -> Ints:
    """Remove points, (N, 3), as `thin` does until M are left, and put these into a progressive order (Yuksel 2015)."""
    kept, area = thin(points, n_points, on_progress)
    later: list[Ints] = []
    while len(kept) > 1:
        removed, area = _stage(points[kept], len(kept) // 2, area)
        later.append(kept[removed[::-1]])
        kept = np.delete(kept, removed)
    return np.concatenate([kept, *later[::-1]])


def first_at_spacing(points: Floats, spacing: float) -> int:
    """Return how many points from the first on are at least a length from each other. Shapes: points (M, 3)."""

    def are_nearer(count: int) -> bool:
        return float(nearest_others(KdTree.build(points[:count]), 1)[1].min()) < spacing * spacing

    return 1 + bisect_left(range(2, len(points) + 1), True, key=are_nearer)


def thin(points: Floats, n_points: int, on_progress: Callable[[int], None] | None = None) -> tuple[Ints, float]:
    """Remove the most crowded point, again and again, until M are left (Yuksel 2015); return these and the area.

    The weight of a point is the sum of (1 - max(d, 2 r_min) / (2 r_max))^8 over all other points at distances d below 2
    r_max, the radius of the densest packing of M discs. The limit r_min keeps two points that happen to be very close
    from outweighing a dense region. Where N / M is large, stages each have their own N and M, so that discs hold few
    points.
    """
    kept = np.arange(len(points))
    area = surface_area(KdTree.build(points))
    while len(kept) > n_points:
        last = len(kept) <= LAST_RATIO * n_points
        target = n_points if last else max(LAST_RATIO * n_points, len(kept) // EARLIER_RATIO)
        removed, area = _stage(points[kept], target, area, on_progress)
        kept = np.delete(kept, removed)
    return kept, area


def _stage(
    points: Floats, n_points: int, area: float, on_progress: Callable[[int], None] | None = None
) -> tuple[Ints, float]:
    """Return the points that a stage removes, in order, and the area, larger if no weight was left too soon."""
    radius = 2.0 * float(np.sqrt(area / (2.0 * np.sqrt(3.0) * n_points)))
    limit = radius * BETA * (1.0 - (n_points / len(points)) ** GAMMA)
    tree = KdTree.build(points)
    weights = np.empty(len(points), dtype=np.float64)
    on_ranges(_weigh, tree.leaves, *tree.arrays, radius, limit, weights, minimum=4)
    heaviest = np.empty(len(tree.lower), dtype=np.float64)
    candidate = np.empty(len(tree.lower), dtype=np.int64)
    greatest_of_all(weights, heaviest, candidate)
    pending = np.zeros(len(tree.lower), dtype=np.float64)
    removed = np.empty(len(points) - n_points, dtype=np.int64)
    batch = 16384  # removals, after which progress is reported
    for begin in range(0, len(removed), batch):
        of_batch = removed[begin : begin + batch]
        count = _remove(*tree.arrays, radius, limit, weights, heaviest, candidate, pending, of_batch)
        if on_progress:
            on_progress(count)
        if count < len(of_batch):
            removed = tree.order[removed[: begin + count]]
            return removed, max(4.0 * area, surface_area(KdTree.build(np.delete(points, removed, axis=0))))
    return tree.order[removed], area


@kernel(fastmath=False)
def _term(dx, dy, dz, radius, limit):
    """Return the term that two points add to each other's weight, given their difference (dx, dy, dz)."""
    distance = max(np.sqrt(dx * dx + dy * dy + dz * dz), limit)
    term = max(1.0 - distance / radius, 0.0)
    term *= term
    term *= term
    term *= term
    return np.floor(WHOLE * term)


@kernel(fastmath={"reassoc"})
def _weigh(first, last, points, lower, upper, radius, limit, weights):
    """Fill `weights`, (N,), in tree order, for a range of leaves; points are (3, N), bounds (nodes, 3)."""
    leaves = first_leaf(lower)
    n = points.shape[1]
    of_near = _term(0.0, 0.0, 0.0, radius, limit)
    for leaf in range(first, last):
        around, near = _within_radius(lower, upper, n, leaves + leaf, radius, limit)
        for i in range(*leaf_range(n, leaves, leaves + leaf)):
            x, y, z = points[0, i], points[1, i], points[2, i]
            total = (near - 1) * of_near  # the point itself does not count
            for node in around:
                if squared_distance_to_box(lower[node], upper[node], x, y, z) > radius * radius:
                    continue
                begin, end = leaf_range(n, leaves, node)
                xs, ys, zs = points[0, begin:end], points[1, begin:end], points[2, begin:end]
                for j in range(end - begin):
                    total += _term(xs[j] - x, ys[j] - y, zs[j] - z, radius, limit)
            weights[i] = total


@kernel
def _within_radius(lower, upper, n, leaf, radius, limit):
    """Return the leaves within the radius of a leaf, and the number of points in other nodes, within its limit."""
    leaves, around = first_leaf(lower), []
    near, node = 0, 1
    while node:
        if squared_span_of_boxes(lower[node], upper[node], lower[leaf], upper[leaf]) < limit * limit:
            first = last = node
            while first < leaves:
                first, last = 2 * first, 2 * last + 1
            near += leaf_range(n, leaves, last)[1] - leaf_range(n, leaves, first)[0]
        elif squared_distance_of_boxes(lower[node], upper[node], lower[leaf], upper[leaf]) <= radius * radius:
            if node < leaves:
                node *= 2
                continue
            around.append(node)
        node = after(node, 1)
    return around, near


@kernel
def _remove(points, lower, upper, radius, limit, weights, heaviest, candidate, pending, removed):
    """Fill `removed`, (n,), with positions of the heaviest points, as long as any has weight; return their number.

    All points of a node within the limit lose the same weight, which waits in `pending`, (nodes,). `heaviest`,
    (nodes,), includes what is pending at its node and below, but not above.
    """
    leaves = first_leaf(lower)
    of_near = _term(0.0, 0.0, 0.0, radius, limit)
    visited = np.empty(leaves, dtype=np.int64)
    for m in range(len(removed)):
        if not heaviest[1] > 0.0:
            return m
        heavy = removed[m] = candidate[1]
        point = points[:, heavy].copy()
        weights[heavy] = REMOVED
        node, inner = 1, 0
        while node:
            span = squared_span_of_boxes(lower[node], upper[node], point, point)
            if span < limit * limit and candidate[node] != heavy:
                pending[node] += of_near
                heaviest[node] -= of_near
            elif squared_distance_of_boxes(lower[node], upper[node], point, point) <= radius * radius:
                if node < leaves:
                    visited[inner] = node
                    inner += 1
                    node *= 2
                    continue
                _lighten(node, points, leaves, weights, point, radius, limit)
                greatest_in_leaf(node, weights, heaviest, candidate)
                heaviest[node] -= pending[node]
            node = after(node, 1)
        for v in range(inner - 1, -1, -1):  # children before their parents
            greater_child(visited[v], heaviest, candidate)
            heaviest[visited[v]] -= pending[visited[v]]
    return len(removed)


@kernel
def _lighten(node, points, leaves, weights, point, radius, limit):
    """Subtract from the weights, (N,), of a leaf's points the terms of `point`, (3,)."""
    n = points.shape[1]
    begin, end = leaf_range(n, leaves, node)
    xs, ys, zs = points[0, begin:end], points[1, begin:end], points[2, begin:end]
    x, y, z = point
    of_leaf = weights[begin:end]
    for j in range(end - begin):
        of_leaf[j] -= _term(xs[j] - x, ys[j] - y, zs[j] - z, radius, limit)
