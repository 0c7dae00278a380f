"""A balanced k-d tree over points, and the kernels that search it.

There are two descents without a stack: through the nodes in tree order, on to `2 * node` or `after` the node; and to
the nearest node first, on to `nearer_child` or `unvisited_sibling`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.box_distances import squared_distance_of_boxes, squared_distance_to_box

LEAF_SIZE = 32  # most points in a leaf: few enough to prune well, enough to fill vector registers
QUERIES_AT_ONCE = 128  # queries that a thread takes at once, at least
SAMPLED = 64  # the pivot of a split comes from a random sample of this many keys
LCG_MULTIPLIER = np.uint64(6364136223846793005)  # of the linear congruential generator of that sample (Knuth)


@dataclass(frozen=True, eq=False)
class KdTree:
    """A perfect binary tree of bounding boxes over N points (Bentley 1975).

    The points are sorted so that each node holds a contiguous range: tree order. Node 1 is the root, and node n has the
    children 2n and 2n + 1. Of the L nodes of a depth, the j-th (from 0) holds the points from N j // L to N (j + 1) //
    L. The tree and the order depend on where the points lie, not on the order in which they come; so does a sum in
    tree order, to the last digit.
    """

    order: Ints  # (N,), index in the input of each point in tree order
    points: Floats  # (3, N), coordinates in tree order; each row is an axis
    lower: Floats  # (nodes, 3), lower corner of the bounding box of each node; row 0 is unused
    upper: Floats  # (nodes, 3)
    leaves: int  # Number of leaves, which is also the node number of the first leaf

    @classmethod
    def build(cls, points: Floats) -> KdTree:
        """Build the tree in O(N log N). Shapes: points (N, 3)."""
        n, depth = len(points), 0
        while n > LEAF_SIZE << depth:
            depth += 1
        records = np.empty((n, 4), dtype=np.float64)
        numbers = records.view(np.int64)
        on_ranges(_record, n, np.ascontiguousarray(points, np.float64), records, numbers, minimum=1 << 14)
        lower, upper = np.empty((2 << depth, 3)), np.empty((2 << depth, 3))
        tree = cls(np.empty(n, dtype=np.int64), np.empty((3, n)), lower, upper, 1 << depth)
        top = 5 if depth > 10 else 0  # all threads split so many depths together; then each splits its own subtrees
        for d in range(top):
            on_ranges(_split_nodes, 1 << d, d, records, lower, upper)
        on_ranges(_grow, 1 << top, top, depth, records, numbers, tree.order, tree.points, lower, upper)
        return tree

    @classmethod
    def over(cls, points: Floats, order: Ints | None = None, leaf_size: int = LEAF_SIZE) -> KdTree:
        """Build a tree over points, (3, N), that are already sorted: only the boxes are computed, in O(N)."""
        points, leaves = np.ascontiguousarray(points), 1  # so that kernels are compiled for one layout only
        n = points.shape[1]
        while n > leaf_size * leaves:
            leaves *= 2
        lower, upper = np.empty((2 * leaves, 3)), np.empty((2 * leaves, 3))
        measure_boxes(points, lower, upper)
        return cls(np.arange(n) if order is None else order, points, lower, upper, leaves)

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats]:
        """Coordinates, and lower and upper corners of the boxes, in the order in which kernels take them."""
        return self.points, self.lower, self.upper

    def in_own_order(self) -> KdTree:
        """Return the tree over the points in tree order: what is computed for its input is then in tree order."""
        return replace(self, order=np.arange(len(self.order)))

    def thinned(self, step: int) -> KdTree:
        """Return a tree over one of each `step` points in tree order, in this order; itself if that is all."""
        if step == 1:
            return self
        return KdTree.over(self.points[:, self.one_of_each(step)])

    def one_of_each(self, step: int) -> Ints:
        """Return the positions of one of each `step` points in tree order."""
        starts = np.arange(0, self.points.shape[1], step)
        # At equal steps they would lie in rows, as the points of a leaf are sorted.
        return np.minimum(starts + starts // step * 7919 % 104_729 % step, self.points.shape[1] - 1)

    def positions(self) -> Ints:
        """Return the position in tree order of each point of the input. Shapes: returns (N,)."""
        positions = np.empty(len(self.order), dtype=np.int64)
        positions[self.order] = np.arange(len(self.order))
        return positions

    def nearest_of(self, queries: Floats, k: int) -> tuple[Ints, Floats]:
        """Find the k points nearest to each query. Shapes: queries (Q, 3); returns indices (Q, k), squared (Q, k)."""
        # Zeros: for a query without a finite distance.
        positions, squared = np.zeros((len(queries), k), dtype=np.int64), np.empty((len(queries), k))
        queries = np.ascontiguousarray(queries)  # so that the kernel is compiled for one layout only
        on_ranges(_nearest_of_all, len(queries), *self.arrays, queries, positions, squared, minimum=QUERIES_AT_ONCE)
        return self.order[positions], squared


@kernel(allocates=False, fastmath=False)
def first_leaf(lower):
    """Return the node number of the first leaf, which is also the number of leaves. Shapes: lower (nodes, ...)."""
    return lower.shape[0] // 2


@kernel(fastmath=False, allocates=False)
def leaf_range(n, leaves, leaf):
    """Return the start and the end of a leaf's points in tree order."""
    j = leaf - leaves
    return n * j // leaves, n * (j + 1) // leaves


@kernel(allocates=False)
def after(node, root):
    """Return the node behind a subtree on a descent from a root, in tree order; 0 behind the last."""
    while node > root and node & 1:
        node >>= 1
    return node + 1 if node > root else 0


@kernel(allocates=False)
def _record(begin, end, points, records, numbers):
    """Fill a range of records, (N, 4), with points, (N, 3), and their indices, as which `numbers` sees the records."""
    for i in range(begin, end):
        records[i, 0], records[i, 1], records[i, 2] = points[i, 0], points[i, 1], points[i, 2]
        numbers[i, 3] = i


@kernel
def _split_nodes(begin, end, depth, records, lower, upper):
    """Split the nodes `begin` to `end` of a depth; arrays as in `_split`."""
    for node in range((1 << depth) + begin, (1 << depth) + end):
        _split(records, node, depth, lower, upper)


@kernel
def _grow(begin, end, top, depth, records, numbers, order, points, lower, upper):
    """Sort the records, (N, 4), below nodes of the depth `top`, and fill the arrays of the tree."""
    keys = np.empty((3, LEAF_SIZE), dtype=np.float64)
    for node in range((1 << top) + begin, (1 << top) + end):  # the records of one such node fit into the CPU cache
        for d in range(depth - top):
            for below in range(node << d, (node + 1) << d):
                _split(records, below, top + d, lower, upper)
        for leaf in range(node << (depth - top), (node + 1) << (depth - top)):
            _fill_leaf(records, numbers, leaf, depth, keys, order, points, lower, upper)


@kernel(allocates=False)
def _fill_leaf(records, numbers, leaf, depth, keys, order, points, lower, upper):
    """Sort a leaf's records, (N, 4), into `order` (N,) and `points` (3, N), and fill its box in `lower` and `upper`.

    The longest side decides, then the others. `keys`, (3, LEAF_SIZE), is scratch memory.
    """
    begin, end = leaf_range(len(records), 1 << depth, leaf)
    _bound(records, begin, end, lower[leaf], upper[leaf])
    axis, count = _longest_side(lower[leaf], upper[leaf]), end - begin
    for rank in range(3):
        for i in range(count):
            keys[rank, i] = records[begin + i, (axis + rank) % 3]
    first, second, third = keys[0, :count], keys[1, :count], keys[2, :count]
    for i in range(count):
        key, earlier, ties = first[i], 0, 0
        for j in range(len(first)):
            earlier += 1 if first[j] < key else 0
            ties += 1 if first[j] == key else 0
        slot = begin + earlier + (_earlier_ties(first, second, third, i) if ties > 1 else 0)
        order[slot] = numbers[begin + i, 3]
        for a in range(3):
            points[a, slot] = records[begin + i, a]


@kernel(inline="always")
def _earlier_ties(first, second, third, i):
    """Count the points, (n,) each axis, that have the first coordinate of the i-th but come before it."""
    a, b, c, count = first[i], second[i], third[i], 0
    for j in range(len(first)):
        third_decides = (third[j] < c) | ((third[j] == c) & (j < i))
        count += (first[j] == a) & ((second[j] < b) | ((second[j] == b) & third_decides))
    return count


@kernel(inline="always")
def _longest_side(lower, upper):
    """Return the axis of the longest side of a box, of several the first. Shapes: lower, upper (3,)."""
    axis = 0
    for a in range(1, 3):
        axis = a if upper[a] - lower[a] > upper[axis] - lower[axis] else axis
    return axis


@kernel(inline="always")
def _split(records, node, depth, lower, upper):
    """Fill a node's box in `lower` and `upper`, (nodes, 3); split its records, (N, 4), at the longest side's median."""
    begin, end = leaf_range(len(records), 1 << depth, node)
    _bound(records, begin, end, lower[node], upper[node])
    axis = _longest_side(lower[node], upper[node])
    _part(records, axis, begin, leaf_range(len(records), 2 << depth, 2 * node)[1], end)


@kernel(fastmath={"nnan", "nsz"}, allocates=False)
def _bound(records, begin, end, lower, upper):
    """Fill `lower` and `upper`, (3,), with the bounds of the records begin..end of (N, 4)."""
    a = b = c = np.inf
    d = e = f = -np.inf
    for i in range(begin, end):
        x, y, z = records[i, 0], records[i, 1], records[i, 2]
        a, b, c = min(a, x), min(b, y), min(c, z)
        d, e, f = max(d, x), max(e, y), max(f, z)
    lower[0], lower[1], lower[2] = a, b, c
    upper[0], upper[1], upper[2] = d, e, f


@kernel
def measure_boxes(points, lower, upper):
    """Fill the boxes of all nodes, `lower` and `upper`, (nodes, 3), from the points, (3, N), in tree order."""
    leaves = first_leaf(lower)
    for leaf in range(leaves, 2 * leaves):
        for axis in range(3):
            lower[leaf, axis], upper[leaf, axis] = np.inf, -np.inf
            for i in range(*leaf_range(points.shape[1], leaves, leaf)):
                lower[leaf, axis] = min(lower[leaf, axis], points[axis, i])
                upper[leaf, axis] = max(upper[leaf, axis], points[axis, i])
    join_boxes(lower, upper)


@kernel(allocates=False)
def join_boxes(lower, upper):
    """Fill the boxes of the nodes above the leaves, `lower` and `upper`, (nodes, 3), from those of the leaves."""
    for node in range(first_leaf(lower) - 1, 0, -1):
        for axis in range(3):
            lower[node, axis] = min(lower[2 * node, axis], lower[2 * node + 1, axis])
            upper[node, axis] = max(upper[2 * node, axis], upper[2 * node + 1, axis])


@kernel(inline="always")
def _part(records, axis, begin, middle, end):
    """Permute the records begin..end of (N, 4): keys before `middle` are at most its key, later ones at least.

    Of equal keys, the next axes decide, so which records come first depends on where these lie only.
    """
    sample, last = np.empty(SAMPLED, dtype=np.float64), axis + 2
    while begin < middle < end:
        pivot = _pivot(records, axis % 3, begin, middle, end, sample)
        parted = _move_forward(records, axis % 3, begin, end, pivot, False)
        if parted > begin:
            begin, end = (begin, parted) if middle < parted else (parted, end)
        else:  # the pivot is the lowest key
            parted = _move_forward(records, axis % 3, begin, end, pivot, True)
            if parted == begin:  # the pivot is NaN
                return
            if parted <= middle:
                begin = parted
            elif axis < last:
                axis, end = axis + 1, parted
            else:  # exact repeats
                return


@kernel(allocates=False)
def _pivot(records, axis, begin, middle, end, sample):
    """Return a key of the records, (N, 4), that probably leaves `middle` in a small part (Floyd and Rivest 1975)."""
    count = end - begin
    if count < 256:  # for so few keys, the median of three is a good enough pivot
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
    # Two ranks past that of the middle, so that the part to keep is small.
    return sample[min(below + 2, SAMPLED - 1)] if 2 * below < SAMPLED else sample[max(below - 2, 0)]


@kernel(allocates=False)
def _move_forward(records, axis, begin, end, pivot, equal):
    """Move records, (N, 4), with keys below the pivot, or also equal, to the front; return where the others start."""
    free = begin
    for i in range(begin, end):  # each record is swapped (Lomuto): a branch would be mispredicted half of the time
        x, y, z, number = records[i, 0], records[i, 1], records[i, 2], records[i, 3]
        key = records[i, axis]
        for field in range(4):
            records[i, field] = records[free, field]
        records[free, 0], records[free, 1], records[free, 2], records[free, 3] = x, y, z, number
        free += 1 if key < pivot or (equal and key == pivot) else 0
    return free


@kernel(allocates=False)
def nearer_child(node, lower, upper, x, y, z):
    """Return the child of a node whose box is nearer to (x, y, z), the first one if they are equally near."""
    first = squared_distance_to_box(lower[2 * node], upper[2 * node], x, y, z)
    second = squared_distance_to_box(lower[2 * node + 1], upper[2 * node + 1], x, y, z)
    return 2 * node + 1 if second < first else 2 * node


@kernel(allocates=False)
def unvisited_sibling(node, visited):
    """Return the next node behind a subtree, and its `visited`; 0 behind the last.

    A bit of `visited` for each depth, from the deepest on, is set if the sibling of the node, or of its ancestor of
    that depth, comes before it: children of a node with `visited` have `2 * visited`.
    """
    while visited & 1:
        node, visited = node >> 1, visited >> 1
    return (node ^ 1, visited | 1) if node > 1 else (0, 0)


@kernel(allocates=False)
def nearest_in_tree(points, lower, upper, x, y, z, positions, squared, limit=np.inf):
    """Find the k points, (k,), nearest to (x, y, z); all must lie within a limit to their squared distance."""
    leaves = first_leaf(lower)
    n = points.shape[1]
    squared[:] = limit
    node, visited, last = 1, 0, -1
    while node:
        if squared_distance_to_box(lower[node], upper[node], x, y, z) < squared[-1]:
            if node < leaves:
                node, visited = nearer_child(node, lower, upper, x, y, z), 2 * visited
                continue
            for j in range(*leaf_range(n, leaves, node)):
                d = (points[0, j] - x) ** 2 + (points[1, j] - y) ** 2 + (points[2, j] - z) ** 2
                if d < squared[-1]:
                    slot = last = min(last + 1, len(squared) - 1)
                    while slot > 0 and squared[slot - 1] > d:
                        squared[slot], positions[slot] = squared[slot - 1], positions[slot - 1]
                        slot -= 1
                    squared[slot], positions[slot] = d, j
        node, visited = unvisited_sibling(node, visited)


@kernel(fastmath=False, allocates=False)
def limit_beside(squared, x, y, z):
    """Return a limit for `nearest_in_tree` near another query; rounding and underflow put no point outside."""
    limit = (np.sqrt(squared) + np.sqrt(x * x + y * y + z * z)) ** 2 * (1.0 + 1e-9) + 1e-300
    return limit if limit < np.inf else np.inf  # not NaN


@kernel
def _nearest_of_all(begin, end, points, lower, upper, queries, positions, squared):
    """Fill `positions` and `squared`, (Q, k), with `nearest_in_tree` of each of the queries, (Q, 3)."""
    limit, k = np.inf, squared.shape[1]
    for q in range(begin, end):
        x, y, z = queries[q]
        if q > begin and k > 0:
            limit = limit_beside(
                squared[q - 1, k - 1], x - queries[q - 1, 0], y - queries[q - 1, 1], z - queries[q - 1, 2]
            )
        nearest_in_tree(points, lower, upper, x, y, z, positions[q], squared[q], limit)


@kernel(fastmath=False)
def leaves_near(lower, upper, box_lower, box_upper, squared_radius, near):
    """Fill `near`, (m,), with the leaves within a radius of a box, (3,) and (3,); return their number, at most m."""
    leaves = first_leaf(lower)
    node, count = 1, 0
    while node and count < len(near):
        if squared_distance_of_boxes(lower[node], upper[node], box_lower, box_upper) <= squared_radius:
            if node < leaves:
                node *= 2
                continue
            near[count] = node
            count += 1
        node = after(node, 1)
    return count


@kernel(fastmath=False)
def points_near(points, lower, upper, leaves, box_lower, box_upper, squared_radius, positions):
    """Fill `positions` with the points of some leaves, (m,), within a radius of a box; return their number."""
    n, first = points.shape[1], first_leaf(lower)
    lowest, highest = (box_lower[0], box_lower[1], box_lower[2]), (box_upper[0], box_upper[1], box_upper[2])
    count, squared = 0, np.empty(LEAF_SIZE, dtype=np.float64)
    for leaf in leaves:
        if squared_distance_of_boxes(lower[leaf], upper[leaf], box_lower, box_upper) > squared_radius:
            continue
        begin, end = leaf_range(n, first, leaf)
        along_x, along_y, along_z = points[0, begin:end], points[1, begin:end], points[2, begin:end]
        for j in range(len(along_x)):  # this loop is vectorised only by itself
            x, y, z = along_x[j], along_y[j], along_z[j]
            squared[j] = squared_distance_to_box(lowest, highest, x, y, z)
        for j in range(len(along_x)):
            positions[count] = begin + j  # always written and then counted or not: a branch would be mispredicted often
            count += 1 if squared[j] <= squared_radius else 0
    return count
