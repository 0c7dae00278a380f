"""Point pair contraction by the quadric error metric (Pauly, Gross and Kobbelt 2002; Garland and Heckbert 1997)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.triangles import dot, minus, row
from gppcs.surface.error_quadrics import NUMBERS, add_moved, add_plane, value
from gppcs.surface.surface_variation import features_of_nearest

IN_PLANE = 1e-14  # a point counts as in a plane if the squared sine of its angle to the plane is below this
CONTRACTIONS_PER_CALL = 16384  # progress is reported after each call of the kernel, so after this many contractions


def contraction_order(
    points: NDArray[np.float64],
    neighbours: int = 8,
    tree: KdTree | None = None,
    advanced: Callable[[int], None] | None = None,
) -> NDArray[np.int64]:
    """Contract pairs of neighbours, the cheapest first, until one point is left.

    The quadric of a point is a sum over its neighbours. Each term is the squared distance to the plane that contains
    both points and is closest to the tangent plane, times the squared distance of the two points. A contraction
    replaces two neighbours by one of them, and adds up their quadrics. Its cost is the value of the sum at the point
    that stays, which is the cheaper choice of the two. The pair of least cost is contracted next. Ties go to the
    shorter pair, and then to the smallest indices. The neighbours of the point that stays are the nearest ones among
    the neighbours of both.

    Shapes: points (N, 3); returns (N,).
    """
    tree = tree or KdTree.build(points)
    n = len(points)
    members, nearest = np.arange(n), tree.neighbours(min(neighbours, n - 1))[0]
    cloud = _Cloud.build(tree, nearest)
    alive = np.ones(n, dtype=np.bool_)
    removed = np.empty(n, dtype=np.int64)
    count = 0
    while count < n - 1:
        graph = _Graph.build(cloud, members, nearest)
        stuck = False
        while not stuck and count < n - 1:
            end = min(count + CONTRACTIONS_PER_CALL, n - 1)
            reached = _contract(cloud, graph, alive, removed, count, end)
            if advanced:
                advanced(reached - count)
            stuck, count = reached < end, reached
        # Each connected component of the graph has one point left; these points are connected next.
        members = np.flatnonzero(alive)
        rest = KdTree.build(cloud.points[members])
        nearest = np.empty((len(members), min(neighbours, len(members) - 1)), dtype=np.int64)
        nearest[rest.order] = members[rest.order[rest.neighbours(nearest.shape[1])[0]]]
    removed[n - 1] = members[0]
    return tree.order[removed[::-1]]


class _Cloud(NamedTuple):
    """The points, (N, 3), in tree order, with their indices in the input, (N,), and their quadrics, (N, 10)."""

    points: NDArray[np.float64]
    order: NDArray[np.int64]
    quadrics: NDArray[np.float64]

    @classmethod
    def build(cls, tree: KdTree, nearest: NDArray[np.int64]) -> Self:
        """Compute the quadrics of the points from their neighbours, `nearest`, (N, k)."""
        points = np.ascontiguousarray(tree.points.T)
        quadrics = np.zeros((len(points), NUMBERS))
        normals = features_of_nearest(tree, nearest.shape[1] + 1).normals[tree.order]
        _add_planes(points, nearest, normals, quadrics)
        return cls(points, tree.order, quadrics)


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
    """The neighbours of each point, and its cheapest contraction with one of them.

    Point i has the k slots from k i on; each holds the position of a neighbour or -1. All slots that hold the same
    point form a linked list: `first`, (N,), starts it, and `following` and `previous`, (k N,), connect it. `cost`,
    `squared` (length) and `partner`, (N,), describe the cheapest contraction of each point. `winner`, (2 N,), is a
    tournament tree: point i is at N + i, and the point of the next contraction at 1.
    """

    slots: NDArray[np.int64]
    first: NDArray[np.int64]
    following: NDArray[np.int64]
    previous: NDArray[np.int64]
    cost: NDArray[np.float64]
    squared: NDArray[np.float64]
    partner: NDArray[np.int64]
    winner: NDArray[np.int64]

    @classmethod
    def build(cls, cloud: _Cloud, members: NDArray[np.int64], nearest: NDArray[np.int64]) -> Self:
        """Connect the points `members`, (m,), with their neighbours, the rows of `nearest`, (m, k)."""
        n, k = len(cloud.points), nearest.shape[1]
        slots = np.full((n, k), -1)
        slots[members] = nearest
        graph = cls(
            slots.ravel(), np.full(n, -1), np.empty(n * k, dtype=np.int64), np.empty(n * k, dtype=np.int64),
            np.full(n, np.inf), np.full(n, np.inf), np.full(n, -1), np.arange(2 * n) - n,
        )  # fmt: skip
        _start(cloud, graph, members)
        return graph


@kernel
def _start(cloud, graph, members):
    """Build the linked lists, the cheapest contractions and the tournament tree of the points `members`, (m,)."""
    for slot in range(len(graph.slots)):
        if graph.slots[slot] >= 0:
            _link(graph, slot, graph.slots[slot])
    for i in members:
        _find_partner(cloud, graph, i)
    for node in range(len(graph.cost) - 1, 0, -1):
        graph.winner[node] = _better(cloud, graph, graph.winner[2 * node], graph.winner[2 * node + 1])


@kernel
def _link(graph, slot, point):
    """Put a point into a slot."""
    after = graph.first[point]
    graph.slots[slot], graph.following[slot], graph.previous[slot] = point, after, -1
    if after >= 0:
        graph.previous[after] = slot
    graph.first[point] = slot


@kernel
def _unlink(graph, slot):
    """Empty a slot."""
    before, after = graph.previous[slot], graph.following[slot]
    if before >= 0:
        graph.following[before] = after
    else:
        graph.first[graph.slots[slot]] = after
    if after >= 0:
        graph.previous[after] = before
    graph.slots[slot] = -1


@kernel
def _cost(cloud, gone, kept):
    """Return the sum of the quadrics of two points, evaluated at the point `kept`."""
    q, step = cloud.quadrics, _step(cloud, gone, kept)
    cost = value(q[gone], step) + q[kept, 9]
    weight = q[gone, 0] + q[gone, 3] + q[gone, 5] + q[kept, 0] + q[kept, 3] + q[kept, 5]
    return cost if cost > IN_PLANE * weight * dot(step, step) else 0.0


@kernel
def _step(cloud, begin, end):
    """Return the vector from one point to another."""
    return minus(row(cloud.points, end), row(cloud.points, begin))


@kernel
def _consider(cloud, graph, i, j):
    """Make j the partner of i if that contraction is cheaper; return whether it is."""
    cost = min(_cost(cloud, i, j), _cost(cloud, j, i))
    step = _step(cloud, i, j)
    squared = dot(step, step)
    if cost > graph.cost[i] or (cost == graph.cost[i] and squared > graph.squared[i]):
        return False
    if cost == graph.cost[i] and squared == graph.squared[i] and cloud.order[j] > cloud.order[graph.partner[i]]:
        return False
    graph.cost[i], graph.squared[i], graph.partner[i] = cost, squared, j
    return True


@kernel
def _find_partner(cloud, graph, i):
    """Find the cheapest contraction of point i with a neighbour; its cost is infinite if there is none."""
    k = len(graph.slots) // len(graph.cost)
    graph.cost[i] = graph.squared[i] = np.inf
    for slot in range(k * i, k * (i + 1)):
        if graph.slots[slot] >= 0:
            _consider(cloud, graph, i, graph.slots[slot])


@kernel
def _better(cloud, graph, i, j):
    """Return the one of two points whose contraction comes first."""
    if graph.cost[i] != graph.cost[j]:
        return i if graph.cost[i] < graph.cost[j] else j
    if graph.squared[i] != graph.squared[j]:
        return i if graph.squared[i] < graph.squared[j] else j
    return i if cloud.order[i] < cloud.order[j] else j


@kernel
def _play(cloud, graph, i):
    """Update the tournament tree after the contraction of point i has changed."""
    winner = graph.winner
    node = (len(graph.cost) + i) // 2
    while node:
        best = _better(cloud, graph, winner[2 * node], winner[2 * node + 1])
        if best == winner[node] and best != i:
            break
        winner[node] = best
        node //= 2


@kernel
def _contract(cloud, graph, alive, removed, begin, end):
    """Fill `removed`, (N,), from `begin` to `end`; return where it stopped, because no pairs were left or at `end`."""
    k = len(graph.slots) // len(graph.cost)
    nearest, squared = np.empty(k, dtype=np.int64), np.empty(k, dtype=np.float64)
    for count in range(begin, end):
        i = graph.winner[1]
        if graph.cost[i] == np.inf:
            return count
        j = graph.partner[i]
        there, here = _cost(cloud, i, j), _cost(cloud, j, i)
        stays = here < there or (here == there and cloud.order[i] < cloud.order[j])
        kept, gone = (i, j) if stays else (j, i)
        alive[gone], removed[count] = False, gone
        _merge_neighbours(cloud, graph, gone, kept, nearest, squared)
        add_moved(cloud.quadrics[gone], _step(cloud, gone, kept), cloud.quadrics[kept])
        graph.cost[gone] = np.inf
        _play(cloud, graph, gone)
        _find_partner(cloud, graph, kept)
        _play(cloud, graph, kept)
        _tell_neighbours(cloud, graph, gone, kept)
    return end


@kernel
def _merge_neighbours(cloud, graph, gone, kept, nearest, squared):
    """Replace the point `gone` by `kept` in all slots, and give `kept` the nearest of the neighbours of both.

    `nearest` and `squared`, (k,), are buffers.
    """
    k = len(nearest)
    found = 0
    for point in (gone, kept):
        for slot in range(k * point, k * (point + 1)):
            other = graph.slots[slot]
            if other >= 0:
                _unlink(graph, slot)
                if other != gone and other != kept:
                    found = _insert(cloud, kept, other, nearest, squared, found)
    slot = graph.first[gone]
    while slot >= 0:
        after = graph.following[slot]
        _unlink(graph, slot)
        if not _knows(graph, slot // k, kept):
            _link(graph, slot, kept)
        slot = after
    for rank in range(found):
        _link(graph, k * kept + rank, nearest[rank])


@kernel
def _knows(graph, point, other):
    """Return whether a point has another as a neighbour."""
    k = len(graph.slots) // len(graph.cost)
    for slot in range(k * point, k * (point + 1)):  # noqa: SIM110 (Numba has no generators)
        if graph.slots[slot] == other:
            return True
    return False


@kernel
def _insert(cloud, point, other, nearest, squared, found):
    """Insert a point into the sorted list of the nearest, (k,), unless it is there; return the length of the list.

    Ties go to the smallest index. The list holds at most k points.
    """
    step = _step(cloud, point, other)
    distance = dot(step, step)
    rank = found
    while rank > 0 and (
        distance < squared[rank - 1]
        or (distance == squared[rank - 1] and cloud.order[other] < cloud.order[nearest[rank - 1]])
    ):
        rank -= 1
    if rank == len(nearest) or (rank > 0 and nearest[rank - 1] == other):
        return found
    found = min(found + 1, len(nearest))
    for later in range(found - 1, rank, -1):
        squared[later], nearest[later] = squared[later - 1], nearest[later - 1]
    squared[rank], nearest[rank] = distance, other
    return found


@kernel
def _tell_neighbours(cloud, graph, gone, kept):
    """Update the cheapest contraction of each point that has `kept` as a neighbour."""
    k = len(graph.slots) // len(graph.cost)
    slot = graph.first[kept]
    while slot >= 0:
        owner = slot // k
        changed = graph.partner[owner] == kept or graph.partner[owner] == gone
        if changed:
            _find_partner(cloud, graph, owner)
        if changed or _consider(cloud, graph, owner, kept):
            _play(cloud, graph, owner)
        slot = graph.following[slot]
