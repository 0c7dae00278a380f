"""A balanced k-d tree over points, the kernels that search it, and the area of the surface that it tells."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges

LEAF_SIZE = 32  # most points in a leaf: few enough to prune well, enough to fill vector registers
QUERIES_AT_ONCE = 128  # queries that a thread takes at once, at least
SHARED_LEVELS = 5  # all threads split these levels together; below them, each thread splits its own subtrees
FEW_KEYS = 256  # for fewer keys than this, the median of three keys is a good enough pivot
SAMPLED = 64  # for more keys, the pivot comes from a random sample of this many
LCG_MULTIPLIER = np.uint64(6364136223846793005)  # of the linear congruential generator of that sample (Knuth)
WIDENED, LEAST_LIMIT = 1.0 + 1e-9, 1e-300  # so that rounding and underflow put no point outside a limit
NEIGHBOURS = 8  # by which the area of a point is told
AREA_QUANTILE = 0.99  # quantile to which larger areas are cut
PAST_MIDDLE = 2  # the pivot lies this many sample ranks past the wanted one, so that the part to keep is small


@dataclass(frozen=True, eq=False)
class KdTree:
    """A perfect binary tree of bounding boxes over N points (Bentley 1975).

    The points are sorted so that each node holds a contiguous range: tree order. Node 1 is the root, and node n has the
    children 2n and 2n + 1. Of the L nodes of a level, the j-th (from 0) holds the points from N j // L to N (j + 1) //
    L.
    """

    order: NDArray[np.int64]  # (N,), index in the input of each point in tree order
    points: NDArray[np.float64]  # (3, N), coordinates in tree order; each row is an axis
    # (nodes, 3) each, corners of the bounding box of each node; row 0 is unused.
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    leaves: int  # Number of leaves, which is also the node number of the first leaf

    @classmethod
    def build(cls, points: NDArray[np.float64]) -> KdTree:
        """Build the tree in O(N log N). Shapes: points (N, 3)."""
        n, depth = len(points), 0
        while n > LEAF_SIZE << depth:
            depth += 1
        records = np.empty((n, 4), dtype=np.float64)
        numbers = records.view(np.int64)
        records[:, :3], numbers[:, 3] = points, np.arange(n)
        low, high = np.empty((2 << depth, 3)), np.empty((2 << depth, 3))
        tree = cls(np.empty(n, dtype=np.int64), np.empty((3, n)), low, high, 1 << depth)
        top = SHARED_LEVELS if depth > 2 * SHARED_LEVELS else 0  # a smaller tree grows on one thread
        for level in range(top):
            on_ranges(_split_nodes, 1 << level, level, records, low, high)
        on_ranges(_grow, 1 << top, top, depth, records, numbers, tree.order, tree.points, low, high)
        return tree

    @classmethod
    def over(cls, points: NDArray[np.float64], order: NDArray[np.int64] | None = None) -> KdTree:
        """Build a tree over points, (3, N), that are already sorted: only the boxes are computed, in O(N)."""
        n, leaves = points.shape[1], 1
        while n > LEAF_SIZE * leaves:
            leaves *= 2
        low, high = np.empty((2 * leaves, 3)), np.empty((2 * leaves, 3))
        measure_boxes(points, low, high)
        return cls(np.arange(n) if order is None else order, points, low, high, leaves)

    def in_own_order(self) -> KdTree:
        """Return the tree over the points in tree order: what is computed for its input is then in tree order."""
        return replace(self, order=np.arange(len(self.order)))

    def thinned(self, step: int) -> KdTree:
        """Return a tree over every `step`-th point in tree order, in this order; itself if that is all."""
        return self if step == 1 else KdTree.over(np.ascontiguousarray(self.points[:, ::step]))

    def positions(self) -> NDArray[np.int64]:
        """Return the position in tree order of each point of the input. Shapes: returns (N,)."""
        positions = np.empty(len(self.order), dtype=np.int64)
        positions[self.order] = np.arange(len(self.order))
        return positions

    def nearest_of(self, queries: NDArray[np.float64], k: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Find the k points nearest to each query. Shapes: queries (Q, 3); returns indices (Q, k), squared (Q, k)."""
        # Zeros: of a query without a finite distance, nothing is found.
        positions, squared = np.zeros((len(queries), k), dtype=np.int64), np.empty((len(queries), k))
        on_ranges(
            _nearest_of_all, len(queries), self.points, self.low, self.high, queries, positions, squared,
            least=QUERIES_AT_ONCE,
        )  # fmt: skip
        return self.order[positions], squared

    def neighbours(self, k: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Find the k other points nearest to each: positions and squared distances, (N, k), in tree order."""
        positions, squared = self.in_own_order().nearest_of(self.points.T, k + 1)
        return positions[:, 1:], squared[:, 1:]  # the first is the point itself


def nearest_distances(tree: KdTree, k: int, most: int = 4096) -> NDArray[np.float64]:
    """Return distances, (n,), to k-th neighbours, of points at equal steps in tree order, as files can be periodic."""
    n = tree.points.shape[1]
    chosen = np.ascontiguousarray(tree.points.T[:: max(1, -(-n // most))])
    _, squared = tree.nearest_of(chosen, min(k + 1, n))
    return np.sqrt(squared[:, -1])


def surface_area(tree: KdTree) -> float:
    """Estimate the area of the surface by discs to the k-th neighbours; the largest 1 % are cut, for outliers."""
    n = tree.points.shape[1]
    k = min(NEIGHBOURS, n - 1)
    if k == 0:
        return 0.0
    squared = nearest_distances(tree, k, most=16_384) ** 2
    return float(np.pi / k * n * np.minimum(squared, np.quantile(squared, AREA_QUANTILE)).mean())


@kernel(inline="always")
def first_leaf(low):
    """Return the node number of the first leaf, which is also the number of leaves. Shapes: low (nodes, ...)."""
    return low.shape[0] // 2


@kernel(fastmath=False, allocates=False)
def leaf_range(n, leaves, leaf):
    """Return the start and the end of a leaf's points in tree order."""
    j = leaf - leaves
    return n * j // leaves, n * (j + 1) // leaves


@kernel
def _split_nodes(begin, end, level, records, low, high):
    """Split the nodes `begin` to `end` of a level; arrays as in `_split`."""
    for node in range((1 << level) + begin, (1 << level) + end):
        _split(records, node, level, low, high)


@kernel
def _grow(begin, end, top, depth, records, numbers, order, points, low, high):
    """Sort the records, (N, 4), below nodes of the level `top`, and fill the arrays of the tree."""
    for node in range((1 << top) + begin, (1 << top) + end):  # the records of one such node fit into the CPU cache
        for level in range(depth - top):
            for below in range(node << level, (node + 1) << level):
                _split(records, below, top + level, low, high)
        for leaf in range(node << (depth - top), (node + 1) << (depth - top)):
            _fill_leaf(records, numbers, leaf, depth, order, points, low, high)


@kernel(allocates=False)
def _fill_leaf(records, numbers, leaf, depth, order, points, low, high):
    """Copy a leaf's records, (N, 4), to `order` (N,) and `points` (3, N), and fill its box in `low` and `high`."""
    begin, end = leaf_range(len(records), 1 << depth, leaf)
    _bound(records, begin, end, low[leaf], high[leaf])
    for i in range(begin, end):
        order[i] = numbers[i, 3]
        for axis in range(3):
            points[axis, i] = records[i, axis]


@kernel
def _split(records, node, level, low, high):
    """Fill a node's box in `low` and `high`, (nodes, 3); split its records, (N, 4), at the longest side's median."""
    begin, end = leaf_range(len(records), 1 << level, node)
    _bound(records, begin, end, low[node], high[node])
    axis, longest = 0, -1.0
    for a in range(3):
        if high[node, a] - low[node, a] > longest:
            axis, longest = a, high[node, a] - low[node, a]
    _part(records, axis, begin, leaf_range(len(records), 2 << level, 2 * node)[1], end)


@kernel(fastmath={"nnan", "nsz"}, allocates=False)
def _bound(records, begin, end, low, high):
    """Fill `low` and `high`, (3,), with the bounds of the records begin..end of (N, 4)."""
    a = b = c = np.inf
    d = e = f = -np.inf
    for i in range(begin, end):
        x, y, z = records[i, 0], records[i, 1], records[i, 2]
        a, b, c = min(a, x), min(b, y), min(c, z)
        d, e, f = max(d, x), max(e, y), max(f, z)
    low[0], low[1], low[2] = a, b, c
    high[0], high[1], high[2] = d, e, f


@kernel
def measure_boxes(points, low, high):
    """Fill the boxes of all nodes, `low` and `high`, (nodes, 3), from the points, (3, N), in tree order."""
    leaves = first_leaf(low)
    for node in range(2 * leaves - 1, 0, -1):
        for axis in range(3):
            if node < leaves:
                low[node, axis] = min(low[2 * node, axis], low[2 * node + 1, axis])
                high[node, axis] = max(high[2 * node, axis], high[2 * node + 1, axis])
                continue
            begin, end = leaf_range(points.shape[1], leaves, node)
            low[node, axis] = high[node, axis] = points[axis, begin]
            for i in range(begin + 1, end):
                low[node, axis] = min(low[node, axis], points[axis, i])
                high[node, axis] = max(high[node, axis], points[axis, i])


@kernel
def _part(records, axis, begin, middle, end):
    """Permute the records begin..end of (N, 4): keys before `middle` are at most its key, later ones at least."""
    sample = np.empty(SAMPLED, dtype=np.float64)
    while begin < middle < end:
        pivot = _pivot(records, axis, begin, middle, end, sample)
        parted = _move_forward(records, axis, begin, end, pivot, False)
        if parted > begin:
            begin, end = (begin, parted) if middle < parted else (parted, end)
        else:  # the pivot is the lowest key
            parted = _move_forward(records, axis, begin, end, pivot, True)
            if parted == begin:  # the pivot is NaN
                return
            begin = parted


@kernel(allocates=False)
def _pivot(records, axis, begin, middle, end, sample):
    """Return a key of the records, (N, 4), that probably leaves `middle` in a small part (Floyd and Rivest 1975)."""
    count = end - begin
    if count < FEW_KEYS:
        a, b, c = records[begin, axis], records[(begin + end) // 2, axis], records[end - 1, axis]
        return max(min(a, b), min(max(a, b), c))
    state = np.uint64(begin + 1) * LCG_MULTIPLIER ^ np.uint64(count)
    for s in range(SAMPLED):
        state = state * LCG_MULTIPLIER + np.uint64(1)  # random, since equal steps could match the rows of a scan
        key = records[begin + np.int64((state >> np.uint64(33)) % np.uint64(count)), axis]
        slot = s
        while slot > 0 and sample[slot - 1] > key:
            sample[slot] = sample[slot - 1]
            slot -= 1
        sample[slot] = key
    below = SAMPLED * (middle - begin) // count
    return sample[min(below + PAST_MIDDLE, SAMPLED - 1)] if 2 * below < SAMPLED else sample[max(below - PAST_MIDDLE, 0)]


@kernel(allocates=False)
def _move_forward(records, axis, begin, end, pivot, equal):
    """Move records, (N, 4), with keys below the pivot, or also equal, to the front; return where the others start.

    Every record is swapped, needed or not (Lomuto's scheme): a branch would be mispredicted half of the time.
    """
    free = begin
    for i in range(begin, end):
        x, y, z, number = records[i, 0], records[i, 1], records[i, 2], records[i, 3]
        key = records[i, axis]
        for field in range(4):
            records[i, field] = records[free, field]
        records[free, 0], records[free, 1], records[free, 2], records[free, 3] = x, y, z, number
        free += 1 if key < pivot or (equal and key == pivot) else 0
    return free


@kernel(fastmath=False, allocates=False)
def squared_distance_to_box(low, high, x, y, z):
    """Return the squared distance of (x, y, z) to a box, rounded to at most that to any point in it."""
    dx = max(low[0] - x, x - high[0], 0.0)
    dy = max(low[1] - y, y - high[1], 0.0)
    dz = max(low[2] - z, z - high[2], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel
def nearest_in_tree(points, low, high, x, y, z, found, squared, limit=np.inf):
    """Find the k points, (k,), nearest to (x, y, z); all must lie within a limit to their squared distance."""
    leaves = first_leaf(low)
    n = points.shape[1]
    squared[:] = limit
    stack = np.empty(64, dtype=np.int64)
    stack[0] = 1
    height = 1
    while height:
        height -= 1
        node = stack[height]
        if squared_distance_to_box(low[node], high[node], x, y, z) >= squared[-1]:
            continue
        if node < leaves:
            near, far = 2 * node, 2 * node + 1
            if squared_distance_to_box(low[far], high[far], x, y, z) < squared_distance_to_box(
                low[near], high[near], x, y, z
            ):
                near, far = far, near
            stack[height], stack[height + 1] = far, near
            height += 2
        else:
            for j in range(*leaf_range(n, leaves, node)):
                d = (points[0, j] - x) ** 2 + (points[1, j] - y) ** 2 + (points[2, j] - z) ** 2
                if d < squared[-1]:
                    slot = len(squared) - 1
                    while slot > 0 and squared[slot - 1] > d:
                        squared[slot], found[slot] = squared[slot - 1], found[slot - 1]
                        slot -= 1
                    squared[slot], found[slot] = d, j


@kernel(fastmath=False, allocates=False)
def limit_beside(squared, x, y, z):
    """Return a limit for `nearest_in_tree` at a place near another one."""
    limit = (np.sqrt(squared) + np.sqrt(x * x + y * y + z * z)) ** 2 * WIDENED + LEAST_LIMIT
    return limit if limit < np.inf else np.inf  # not NaN


@kernel
def _nearest_of_all(begin, end, points, low, high, queries, found, squared):
    """Fill `found` and `squared`, (Q, k), with `nearest_in_tree` of each of the queries, (Q, 3)."""
    limit, k = np.inf, squared.shape[1]
    for q in range(begin, end):
        x, y, z = queries[q]
        if q > begin and k > 0:
            limit = limit_beside(
                squared[q - 1, k - 1], x - queries[q - 1, 0], y - queries[q - 1, 1], z - queries[q - 1, 2]
            )
        nearest_in_tree(points, low, high, x, y, z, found[q], squared[q], limit)


@kernel(fastmath=False)
def leaves_near(low, high, box_low, box_high, squared_radius, found):
    """Find the leaves within a radius of a box. Shapes: low, high (nodes, 3), box_low, box_high (3,), found (m,)."""
    leaves = first_leaf(low)
    count = 0
    stack = np.empty(64, dtype=np.int64)
    stack[0] = 1
    height = 1
    while height and count < len(found):
        height -= 1
        node = stack[height]
        if squared_distance_of_boxes(low[node], high[node], box_low, box_high) > squared_radius:
            continue
        if node >= leaves:
            found[count] = node
            count += 1
        else:
            stack[height], stack[height + 1] = 2 * node + 1, 2 * node
            height += 2
    return count


@kernel(fastmath=False, allocates=False)
def squared_distance_of_boxes(low, high, other_low, other_high):
    """Return the squared distance between two boxes, rounded to at most that between any two points in them."""
    dx = max(low[0] - other_high[0], other_low[0] - high[0], 0.0)
    dy = max(low[1] - other_high[1], other_low[1] - high[1], 0.0)
    dz = max(low[2] - other_high[2], other_low[2] - high[2], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel(fastmath=False, allocates=False)
def squared_reach_of_boxes(low, high, other_low, other_high):
    """Return the largest squared distance between a point of one box and a point of another; corners are (3,)."""
    dx = max(high[0] - other_low[0], other_high[0] - low[0])
    dy = max(high[1] - other_low[1], other_high[1] - low[1])
    dz = max(high[2] - other_low[2], other_high[2] - low[2])
    return dx * dx + dy * dy + dz * dz


@kernel(fastmath=False, allocates=False)
def points_near(points, low, high, leaves, box_low, box_high, squared_radius, found):
    """Find the points of some leaves within a radius of a box. Shapes: leaves (m,), box_low, box_high (3,)."""
    n, first = points.shape[1], first_leaf(low)
    count = 0
    for leaf in leaves:
        if squared_distance_of_boxes(low[leaf], high[leaf], box_low, box_high) > squared_radius:
            continue
        for j in range(*leaf_range(n, first, leaf)):
            found[count] = j  # always written and then counted or not: a branch would be mispredicted often
            near = squared_distance_to_box(box_low, box_high, points[0, j], points[1, j], points[2, j])
            count += 1 if near <= squared_radius else 0
    return count


@kernel
def greatest_of_all(order, values, greatest, holder):
    """Fill each node with the greatest value, (N,), among its points, and with the index of that point, `holder`."""
    leaves = first_leaf(greatest)
    for node in range(2 * leaves - 1, 0, -1):
        if node >= leaves:
            greatest_in_leaf(node, order, values, greatest, holder)
        else:
            greater_child(node, greatest, holder)


@kernel(fastmath={"nnan", "nsz"})
def greatest_in_leaf(node, order, values, greatest, holder):
    """Update the greatest value of one leaf, and the index of its point."""
    n = len(values)
    leaves = first_leaf(greatest)
    begin, end = leaf_range(n, leaves, node)
    of_leaf, indices = values[begin:end], order[begin:end]  # loops over slices are vectorised
    best = -np.inf
    for j in range(len(of_leaf)):
        best = max(best, of_leaf[j])
    index = n
    for j in range(len(of_leaf)):
        if of_leaf[j] == best:
            index = min(index, indices[j])
    greatest[node], holder[node] = best, index


@kernel(allocates=False)
def greater_child(node, greatest, holder):
    """Update the greatest value of one inner node from its two children."""
    a, b = 2 * node, 2 * node + 1
    if greatest[b] > greatest[a] or (greatest[b] == greatest[a] and holder[b] < holder[a]):
        a = b
    greatest[node], holder[node] = greatest[a], holder[a]
