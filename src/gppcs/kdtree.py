"""A balanced k-d tree over the points: boxes to prune with, whatever the density of the cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

LEAF_SIZE = 32  # points in a leaf at most: few enough to prune well, enough to fill vector registers


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
        order = np.arange(len(points), dtype=np.int64)
        columns = np.ascontiguousarray(points.T)
        depth = 0
        while len(points) > LEAF_SIZE << depth:
            depth += 1
        low = np.empty((2 << depth, 3), dtype=np.float64)
        high = np.empty((2 << depth, 3), dtype=np.float64)
        for level in range(depth + 1):
            _split_level(columns, order, low, high, level, level == depth)
        return cls(order, columns, low, high)

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


@nb.njit(cache=True, parallel=True, nogil=True)
def _split_level(points, order, low, high, level, last):
    """Measure the boxes of a level and, unless it is the last, part each node at the median of its longest side."""
    nodes = 1 << level
    n = points.shape[1]
    for j in nb.prange(nodes):
        begin, end = n * j // nodes, n * (j + 1) // nodes
        node = nodes + j
        axis, longest = 0, -1.0
        for a in range(3):
            low[node, a] = points[a, begin:end].min()
            high[node, a] = points[a, begin:end].max()
            if high[node, a] - low[node, a] > longest:
                axis, longest = a, high[node, a] - low[node, a]
        if not last:
            _part(points, order, points[axis], begin, n * (2 * j + 1) // (2 * nodes), end)


@nb.njit(cache=True)
def _part(points, order, key, begin, middle, end):
    """Permute begin..end so that keys before `middle` are at most, and those from it on at least, its key."""
    left, right = begin, end - 1
    while left < right:
        a, b, c = key[left], key[(left + right) // 2], key[right]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = left, right
        while i <= j:
            while key[i] < pivot:
                i += 1
            while key[j] > pivot:
                j -= 1
            if i <= j:
                for row in points:
                    row[i], row[j] = row[j], row[i]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


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
            leaf = node - leaves
            for j in range(n * leaf // leaves, n * (leaf + 1) // leaves):
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
def leaves_near(low, high, box_low, box_high, squared_radius):
    """Return the nodes of the leaves that come within the radius of a box."""
    leaves = first_leaf(low)
    found = np.empty(leaves, dtype=np.int64)
    count = 0
    stack = np.empty(64, dtype=np.int64)
    stack[0] = 1
    height = 1
    while height:
        height -= 1
        node = stack[height]
        squared = 0.0
        for axis in range(3):
            squared += max(low[node, axis] - box_high[axis], box_low[axis] - high[node, axis], 0.0) ** 2
        if squared > squared_radius:
            continue
        if node >= leaves:
            found[count] = node
            count += 1
        else:
            stack[height], stack[height + 1] = 2 * node + 1, 2 * node
            height += 2
    return found[:count]


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
    begin, end = n * (node - leaves) // leaves, n * (node - leaves + 1) // leaves
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
