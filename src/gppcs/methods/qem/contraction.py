"""Point pair contraction by the quadric error metric (Pauly, Gross and Kobbelt 2002; Garland and Heckbert 1997)."""

import heapq
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs.spatial.triangles import dot, minus, row
from gppcs.surface.error_quadrics import NUMBERS, add_moved, add_plane, value
from gppcs.surface.surface_variation import features_of_nearest

IN_PLANE = 1e-14  # a point counts as in a plane if the squared sine of its angle to the plane is below this


def contraction_order(points: Floats, neighbours: int = 8, on_progress: Callable[[int], None] | None = None) -> Ints:
    """Contract pairs of neighbours, the cheapest first, until one point of (N, 3) is left; return the last ones first.

    The quadric of a point is a sum over its neighbours of the squared distance to the plane that contains both and is
    closest to the tangent plane, times their squared distance. A contraction adds up two quadrics, and costs their
    value at the point that stays. Ties go to the shorter pair, then to the smallest indices.
    """
    tree = KdTree.build(points)
    n = len(points)
    members, nearest = np.arange(n), nearest_others(tree, min(neighbours, n - 1))[0]
    cloud = _Cloud(np.ascontiguousarray(tree.points.T), tree.order, np.zeros((n, NUMBERS)))
    normals = features_of_nearest(tree, nearest.shape[1] + 1).normals[tree.order]
    _add_planes(cloud.points, nearest, normals, cloud.quadrics)
    alive = np.ones(n, dtype=np.bool_)
    removed = np.empty(n, dtype=np.int64)
    count = 0
    while count < n - 1:
        graph = _connected(cloud, members, nearest)
        stuck = False
        while not stuck and count < n - 1:
            # Progress is reported after so many contractions: each call builds a heap of all points.
            end = min(count + max(16384, (n - count) // 8), n - 1)
            reached = _contract(cloud, graph, alive, removed, count, end)
            if on_progress:
                on_progress(reached - count)
            stuck, count = reached < end, reached
        # Each connected component of the graph has one point left; these points are connected next.
        members = np.flatnonzero(alive)
        rest = KdTree.build(cloud.points[members])
        nearest = np.empty((len(members), min(neighbours, len(members) - 1)), dtype=np.int64)
        nearest[rest.order] = members[rest.order[nearest_others(rest, nearest.shape[1])[0]]]
    removed[n - 1] = members[0]
    return tree.order[removed[::-1]]


class _Cloud(NamedTuple):
    """The points, (N, 3), in tree order, with their indices in the input, (N,), and their quadrics, (N, 10)."""

    points: Floats
    order: Ints
    quadrics: Floats


@kernel
def _add_planes(points, neighbours, normals, quadrics):
    """Add the planes to `quadrics`, (N, 10); `points` and `normals` are (N, 3), `neighbours` (N, k)."""
    for i in range(len(points)):
        for j in neighbours[i]:
            edge = points[j] - points[i]
            squared = (edge * edge).sum()
            across = normals[i] - edge * ((normals[i] * edge).sum() / squared)
            sine = (across * across).sum()
            if sine > IN_PLANE:  # otherwise, the edge is parallel to the normal, and no plane is closest
                add_plane(quadrics[i], (across[0], across[1], across[2]), 0.0, squared / sine)


class _Graph(NamedTuple):
    """The neighbours of each point, and its cheapest contraction."""

    slots: Ints  # the k neighbours of point i from k i on, -1 for none
    following: Ints  # the slots that hold point i form a ring, with the position k N + i, which is no slot
    previous: Ints
    cost: Floats
    squared: Floats
    partner: Ints


def _connected(cloud: _Cloud, members: Ints, nearest: Ints) -> _Graph:
    """Connect the points `members`, (m,), with their neighbours, the rows of `nearest`, (m, k)."""
    n, k = len(cloud.points), nearest.shape[1]
    slots = np.full((n, k), -1)
    slots[members] = nearest
    positions = np.arange(n * k + n)
    costs = (np.full(n, np.inf), np.full(n, np.inf), np.full(n, -1))
    graph = _Graph(slots.ravel(), positions, positions.copy(), *costs)
    _start(cloud, graph, members)
    return graph


@kernel(allocates=False)
def _start(cloud, graph, members):
    """Build the rings of slots and find the cheapest contractions of the points `members`, (m,)."""
    for slot in range(len(graph.slots)):
        if graph.slots[slot] >= 0:
            _link(graph, slot, graph.slots[slot])
    for i in members:
        _find_partner(cloud, graph, i)


@kernel(allocates=False)
def _link(graph, slot, point):
    """Put a point into a slot."""
    start = len(graph.slots) + point
    after = graph.following[start]
    graph.slots[slot] = point
    graph.previous[slot], graph.following[slot] = start, after
    graph.following[start] = graph.previous[after] = slot


@kernel(allocates=False)
def _unlink(graph, slot):
    """Empty a slot."""
    before, after = graph.previous[slot], graph.following[slot]
    graph.following[before], graph.previous[after] = after, before
    graph.slots[slot] = -1


@kernel(allocates=False)
def _cost(cloud, gone, kept):
    """Return the sum of the quadrics of two points, evaluated at the point `kept`."""
    q, step = cloud.quadrics, _step(cloud, gone, kept)
    cost = value(q[gone], step) + q[kept, 9]
    weight = q[gone, 0] + q[gone, 3] + q[gone, 5] + q[kept, 0] + q[kept, 3] + q[kept, 5]
    return cost if cost > IN_PLANE * weight * dot(step, step) else 0.0


@kernel(allocates=False)
def _step(cloud, begin, end):
    """Return the vector from one point to another."""
    return minus(row(cloud.points, end), row(cloud.points, begin))


@kernel(allocates=False)
def _consider(cloud, graph, i, j):
    """Make j the partner of i if that contraction is cheaper; return whether it is."""
    cost = min(_cost(cloud, i, j), _cost(cloud, j, i))
    step = _step(cloud, i, j)
    squared = dot(step, step)
    if (cost, squared, cloud.order[j]) > (graph.cost[i], graph.squared[i], cloud.order[graph.partner[i]]):
        return False
    graph.cost[i], graph.squared[i], graph.partner[i] = cost, squared, j
    return True


@kernel(allocates=False)
def _find_partner(cloud, graph, i):
    """Find the cheapest contraction of point i with a neighbour; its cost is infinite if there is none."""
    k = len(graph.slots) // len(graph.cost)
    graph.cost[i] = graph.squared[i] = np.inf
    for slot in range(k * i, k * (i + 1)):
        if graph.slots[slot] >= 0:
            _consider(cloud, graph, i, graph.slots[slot])


@kernel(allocates=False)
def _rank(cloud, graph, i):
    """Return the key of the contraction of a point in the heap, which pops the smallest first."""
    return graph.cost[i], graph.squared[i], cloud.order[i], i


@kernel
def _contract(cloud, graph, alive, removed, begin, end):
    """Fill `removed`, (N,), from `begin` to `end`; return where it stopped, because no pairs were left or at `end`."""
    k = len(graph.slots) // len(graph.cost)
    nearest, squared = np.empty(k, dtype=np.int64), np.empty(k, dtype=np.float64)
    heap = [_rank(cloud, graph, i) for i in range(len(alive)) if graph.cost[i] < np.inf]
    heapq.heapify(heap)
    count = begin
    while count < end and heap:
        cost, length, _, i = heapq.heappop(heap)
        if cost != graph.cost[i] or length != graph.squared[i]:
            continue  # its cheapest contraction is another by now
        j = graph.partner[i]
        there, here = _cost(cloud, i, j), _cost(cloud, j, i)
        stays = here < there or (here == there and cloud.order[i] < cloud.order[j])
        kept, gone = (i, j) if stays else (j, i)
        alive[gone], removed[count] = False, gone
        count += 1
        _merge_neighbours(cloud, graph, gone, kept, nearest, squared)
        add_moved(cloud.quadrics[gone], _step(cloud, gone, kept), cloud.quadrics[kept])
        graph.cost[gone] = np.inf
        _find_partner(cloud, graph, kept)
        if graph.cost[kept] < np.inf:
            heapq.heappush(heap, _rank(cloud, graph, kept))
        _update_neighbours(cloud, graph, gone, kept, heap)
    return count


@kernel
def _merge_neighbours(cloud, graph, gone, kept, nearest, squared):
    """Replace `gone` by `kept` in all slots, and give it the nearest neighbours of both, by two buffers, (k,)."""
    k = len(nearest)
    n_nearest = 0
    for point in (gone, kept):
        for slot in range(k * point, k * (point + 1)):
            other = graph.slots[slot]
            if other >= 0:
                _unlink(graph, slot)
                if other != gone and other != kept:
                    n_nearest = _insert(cloud, kept, other, nearest, squared, n_nearest)
    slot = graph.following[len(graph.slots) + gone]
    while slot < len(graph.slots):
        after = graph.following[slot]
        _unlink(graph, slot)
        if not (graph.slots[slot // k * k : slot // k * k + k] == kept).any():
            _link(graph, slot, kept)
        slot = after
    for rank in range(n_nearest):
        _link(graph, k * kept + rank, nearest[rank])


@kernel(allocates=False)
def _insert(cloud, point, other, nearest, squared, n_nearest):
    """Insert a point into the sorted list of the k nearest, ties by smallest index; return its length."""
    step = _step(cloud, point, other)
    distance = dot(step, step)
    rank = n_nearest
    while rank > 0 and (
        distance < squared[rank - 1]
        or (distance == squared[rank - 1] and cloud.order[other] < cloud.order[nearest[rank - 1]])
    ):
        rank -= 1
    if rank == len(nearest) or (rank > 0 and nearest[rank - 1] == other):
        return n_nearest
    n_nearest = min(n_nearest + 1, len(nearest))
    for later in range(n_nearest - 1, rank, -1):
        squared[later], nearest[later] = squared[later - 1], nearest[later - 1]
    squared[rank], nearest[rank] = distance, other
    return n_nearest


@kernel
def _update_neighbours(cloud, graph, gone, kept, heap):
    """Update the cheapest contraction of each point that has `kept` as a neighbour."""
    k = len(graph.slots) // len(graph.cost)
    slot = graph.following[len(graph.slots) + kept]
    while slot < len(graph.slots):
        owner = slot // k
        changed = graph.partner[owner] == kept or graph.partner[owner] == gone
        if changed:
            _find_partner(cloud, graph, owner)
        if changed or _consider(cloud, graph, owner, kept):
            heapq.heappush(heap, _rank(cloud, graph, owner))
        slot = graph.following[slot]
