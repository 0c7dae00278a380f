"""A balanced k-d tree over the points: boxes to prune with, whatever the density of the cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

LEAF_SIZE = 32  # points in a leaf at most: few enough to prune well, enough to fill vector registers
TOP = 5  # levels that are split one after another, each by all threads; below, each thread has subtrees of its own
FEW_KEYS = 256  # keys below which the median of three is a good enough pivot
SAMPLE = 64  # keys that tell the pivot of more
MULTIPLIER = np.uint64(6364136223846793005)  # of the linear congruence that tells which (Knuth)
BEYOND = 2  # places in that sample by which the pivot lies beyond the middle, so that this is in the smaller part


@dataclass(frozen=True)
class KdTree:
    """Points in tree order, with the boxes of a perfect binary tree above them.

    Node 1 is the root and node n has the children 2n and 2n + 1. The nodes of a level share the points evenly:
    the j-th of the L nodes of a level holds the points from N j // L up to N (j + 1) // L, so no node stores
    its range.

    Attributes
    ----------
    order : (N,) array, int64
        The index that each point in tree order had in the input.
    points : (3, N) array, float64
        Coordinates in tree order, an axis a row.
    low, high : (nodes, 3) arrays, float64
        Corners of each node's box.
    """

    order: NDArray[np.int64]
    points: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def build(cls, points: NDArray[np.float64]) -> KdTree:
        """Build the tree over `points`, (N, 3), N at least 1, in O(N log N)."""
        n, depth = len(points), 0
        while n > LEAF_SIZE << depth:
            depth += 1
        records = np.empty((n, 4), dtype=np.float64)
        numbers = records.view(np.int64)
        _record(np.ascontiguousarray(points), records, numbers)
        tree = cls(np.empty(n, dtype=np.int64), np.empty((3, n)), np.empty((2 << depth, 3)), np.empty((2 << depth, 3)))
        _grow(records, numbers, depth, tree.order, tree.points, tree.low, tree.high)
        return tree

    @classmethod
    def over(cls, points: NDArray[np.float64], order: NDArray[np.int64] | None = None) -> KdTree:
        """Return the tree over points that are sorted already: only the boxes are measured, in O(N).

        Parameters
        ----------
        points : (3, N) array
            N at least 1. Neighbours must stand near each other, as they do in the order of another tree; otherwise
            searches are slow, though still right.
        order : (N,) array, int64, optional
            The tree's `order`; 0 to N - 1 by default.
        """
        n, leaves = points.shape[1], 1
        while n > LEAF_SIZE * leaves:
            leaves *= 2
        tree = cls(
            np.arange(n) if order is None else order, points, np.empty((2 * leaves, 3)), np.empty((2 * leaves, 3))
        )
        _bound_all(points, tree.low, tree.high)
        return tree

    def scaled(self, factor: float) -> KdTree:
        """Return the tree over the points times a positive factor."""
        return KdTree(self.order, self.points * factor, self.low * factor, self.high * factor)

    def positions(self) -> NDArray[np.int64]:
        """Return the position in tree order of each point of the input, (N,)."""
        positions = np.empty(len(self.order), dtype=np.int64)
        positions[self.order] = np.arange(len(self.order))
        return positions

    def nearest_of(self, queries: NDArray[np.float64], k: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the input indices and squared distances of the k points nearest each query, nearest first.

        Both are (len(queries), k), k at most N; kernels that need no such table call `nearest_in_tree`.
        """
        indices = np.empty((len(queries), k), dtype=np.int64)
        squared = np.empty((len(queries), k), dtype=np.float64)
        _nearest_of_all(self.points, self.low, self.high, queries, indices, squared)
        return self.order[indices], squared

    def neighbours(self, k: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the k other points nearest each point, (N, k), nearest first, and their squared distances.

        All in tree order, where neighbours stand near each other; points must be without repeats, and k below N.
        """
        positions = np.empty((len(self.order), k + 1), dtype=np.int64)
        squared = np.empty((len(self.order), k + 1), dtype=np.float64)
        _nearest_of_all(self.points, self.low, self.high, self.points.T, positions, squared)
        return positions[:, 1:], squared[:, 1:]  # the first is the point itself


@nb.njit(cache=True, inline="always")
def first_leaf(low):
    """Return the number of the first leaf, which is also the number of leaves."""
    return low.shape[0] // 2


@nb.njit(cache=True, fastmath=False)
def leaf_range(n, leaves, leaf):
    """Return where in tree order the points of a leaf begin and end, of n points in so many leaves."""
    j = leaf - leaves
    return n * j // leaves, n * (j + 1) // leaves


@nb.njit(cache=True, parallel=True, nogil=True)
def _record(points, records, numbers):
    """Fill the records, a row a point: its coordinates, and its index, as the bits of a whole number."""
    for i in nb.prange(len(points)):
        records[i, 0], records[i, 1], records[i, 2] = points[i, 0], points[i, 1], points[i, 2]
        numbers[i, 3] = i


@nb.njit(cache=True, parallel=True, nogil=True)
def _grow(records, numbers, depth, order, points, low, high):
    """Sort the records into the tree, and fill what is kept of it."""
    top = min(TOP, depth)
    for level in range(top):
        for node in nb.prange(1 << level, 2 << level):
            _split(records, node, level, low, high)
    for node in nb.prange(1 << top, 2 << top):  # below, a node at a time fits into the cache
        for level in range(depth - top):
            for below in range(node << level, (node + 1) << level):
                _split(records, below, top + level, low, high)
        for leaf in range(node << (depth - top), (node + 1) << (depth - top)):
            _fill_leaf(records, numbers, leaf, depth, order, points, low, high)


@nb.njit(cache=True)
def _fill_leaf(records, numbers, leaf, depth, order, points, low, high):
    begin, end = _range(len(records), leaf, depth)
    _bound(records, begin, end, low[leaf], high[leaf])
    for i in range(begin, end):
        order[i] = numbers[i, 3]
        for axis in range(3):
            points[axis, i] = records[i, axis]


@nb.njit(cache=True)
def _range(n, node, level):
    j = node - (1 << level)
    return n * j >> level, n * (j + 1) >> level


@nb.njit(cache=True)
def _split(records, node, level, low, high):
    """Measure a node's box, and part its points at the median of the longest side."""
    begin, end = _range(len(records), node, level)
    _bound(records, begin, end, low[node], high[node])
    axis, longest = 0, -1.0
    for a in range(3):
        if high[node, a] - low[node, a] > longest:
            axis, longest = a, high[node, a] - low[node, a]
    _part(records, axis, begin, _range(len(records), 2 * node, level + 1)[1], end)


@nb.njit(cache=True, fastmath={"nnan", "nsz"})
def _bound(records, begin, end, low, high):
    a = b = c = np.inf
    d = e = f = -np.inf
    for i in range(begin, end):
        x, y, z = records[i, 0], records[i, 1], records[i, 2]
        a, b, c = min(a, x), min(b, y), min(c, z)
        d, e, f = max(d, x), max(e, y), max(f, z)
    low[0], low[1], low[2] = a, b, c
    high[0], high[1], high[2] = d, e, f


@nb.njit(cache=True, nogil=True)
def _bound_all(points, low, high):
    """Measure the boxes of all nodes over points, (3, N), in tree order."""
    leaves = first_leaf(low)
    for node in range(2 * leaves - 1, 0, -1):
        begin, end = leaf_range(points.shape[1], leaves, node)
        for axis in range(3):
            if node >= leaves:
                low[node, axis], high[node, axis] = points[axis, begin:end].min(), points[axis, begin:end].max()
            else:
                low[node, axis] = min(low[2 * node, axis], low[2 * node + 1, axis])
                high[node, axis] = max(high[2 * node, axis], high[2 * node + 1, axis])


@nb.njit(cache=True)
def _part(records, axis, begin, middle, end):
    """Permute begin..end so that keys before `middle` are at most, and those from it on at least, its key."""
    sample = np.empty(SAMPLE, dtype=np.float64)
    while begin < middle < end:
        pivot = _pivot(records, axis, begin, middle, end, sample)
        parted = _move_forward(records, axis, begin, end, pivot, False)
        if parted > begin:
            begin, end = (begin, parted) if middle < parted else (parted, end)
        else:  # the pivot is the least key
            parted = _move_forward(records, axis, begin, end, pivot, True)
            if parted == begin:  # or no number
                return
            begin = parted


@nb.njit(cache=True)
def _pivot(records, axis, begin, middle, end, sample):
    """Return a key that is likely to leave the middle in a small part (Floyd and Rivest 1975)."""
    count = end - begin
    if count < FEW_KEYS:
        a, b, c = records[begin, axis], records[(begin + end) // 2, axis], records[end - 1, axis]
        return max(min(a, b), min(max(a, b), c))
    state = np.uint64(begin + 1) * MULTIPLIER ^ np.uint64(count)
    for s in range(SAMPLE):
        state = state * MULTIPLIER + np.uint64(1)  # at random: places at equal steps fall in with the rows of a scan
        key = records[begin + np.int64((state >> np.uint64(33)) % np.uint64(count)), axis]
        slot = s
        while slot > 0 and sample[slot - 1] > key:
            sample[slot] = sample[slot - 1]
            slot -= 1
        sample[slot] = key
    below = SAMPLE * (middle - begin) // count
    return sample[min(below + BEYOND, SAMPLE - 1)] if 2 * below < SAMPLE else sample[max(below - BEYOND, 0)]


@nb.njit(cache=True)
def _move_forward(records, axis, begin, end, pivot, equal):
    """Move the records of keys below the pivot, or equal to it too, before the others; return where these begin.

    Every record is swapped, needed or not: a branch would be guessed wrong half of the time (Lomuto's scheme).
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


@nb.njit(cache=True, fastmath=False)
def squared_distance_to_box(low, high, x, y, z):
    """Return the squared distance of (x, y, z) to a box; never more than that computed to a point in it."""
    dx = max(low[0] - x, x - high[0], 0.0)
    dy = max(low[1] - y, y - high[1], 0.0)
    dz = max(low[2] - z, z - high[2], 0.0)
    return dx * dx + dy * dy + dz * dz


@nb.njit(cache=True)
def nearest_in_tree(points, low, high, x, y, z, found, squared):
    """Fill `found` (positions in tree order) and `squared` with the nearest points of (x, y, z), nearest first."""
    leaves = first_leaf(low)
    n = points.shape[1]
    squared[:] = np.inf
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


@nb.njit(cache=True, parallel=True, nogil=True)
def _nearest_of_all(points, low, high, queries, found, squared):
    for q in nb.prange(len(queries)):
        x, y, z = queries[q]
        nearest_in_tree(points, low, high, x, y, z, found[q], squared[q])


@nb.njit(cache=True, fastmath=False)
def leaves_near(low, high, box_low, box_high, squared_radius, found):
    """Fill `found` with the nodes of leaves that come within the radius of a box, as many as it has room for.

    Return their number.
    """
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


@nb.njit(cache=True, fastmath=False)
def squared_distance_of_boxes(low, high, other_low, other_high):
    """Return the squared distance between two boxes; never more than that computed between points in them."""
    dx = max(low[0] - other_high[0], other_low[0] - high[0], 0.0)
    dy = max(low[1] - other_high[1], other_low[1] - high[1], 0.0)
    dz = max(low[2] - other_high[2], other_low[2] - high[2], 0.0)
    return dx * dx + dy * dy + dz * dz


@nb.njit(cache=True, fastmath=False)
def points_near(points, low, high, leaves, box_low, box_high, squared_radius, found):
    """Fill `found` with the positions of the points in some leaves that come within the radius of a box.

    There must be room for LEAF_SIZE to a leaf. Return their number.
    """
    n, first = points.shape[1], first_leaf(low)
    count = 0
    for leaf in leaves:
        if squared_distance_of_boxes(low[leaf], high[leaf], box_low, box_high) > squared_radius:
            continue
        for j in range(*leaf_range(n, first, leaf)):
            found[count] = j  # kept or not: a branch would be guessed wrong too often
            near = squared_distance_to_box(box_low, box_high, points[0, j], points[1, j], points[2, j])
            count += 1 if near <= squared_radius else 0
    return count


@nb.njit(cache=True)
def greatest_of_all(order, values, greatest, holder):
    """Fill every node with the greatest of its points' values, in tree order, and the index of the point with it."""
    leaves = first_leaf(greatest)
    for node in range(2 * leaves - 1, 0, -1):
        if node >= leaves:
            greatest_in_leaf(node, order, values, greatest, holder)
        else:
            greater_child(node, greatest, holder)


@nb.njit(cache=True, fastmath={"nnan", "nsz"})
def greatest_in_leaf(node, order, values, greatest, holder):
    """Fill a leaf with the greatest of its points' values and the index of the point with it, of several the least."""
    n = len(values)
    leaves = first_leaf(greatest)
    begin, end = leaf_range(n, leaves, node)
    of_leaf, indices = values[begin:end], order[begin:end]  # slices: loops over them go by vectors
    best = -np.inf
    for j in range(len(of_leaf)):
        best = max(best, of_leaf[j])
    index = n
    for j in range(len(of_leaf)):
        if of_leaf[j] == best:
            index = min(index, indices[j])
    greatest[node], holder[node] = best, index


@nb.njit(cache=True)
def greater_child(node, greatest, holder):
    """Fill a node with what the child of the greater value holds, of equal ones that of the smaller index."""
    a, b = 2 * node, 2 * node + 1
    if greatest[b] > greatest[a] or (greatest[b] == greatest[a] and holder[b] < holder[a]):
        a = b
    greatest[node], holder[node] = greatest[a], holder[a]
