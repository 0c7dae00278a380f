"""The walk over the leaves of a tree of queries: one vectorised search of the points near a leaf serves all of them.

Leaves that follow each other form runs. In a run, each search takes the radius that the queries of the leaf before
needed; a query for which that is too small searches the tree by itself.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import LEAF_SIZE, KdTree, first_leaf, leaf_range, leaves_near, nearest_in_tree, points_near

STRIDE = 16  # arrays are padded to multiples of this length: two of the widest vector registers
FAR_COORDINATE = 1e150  # padding that lies outside every radius; its square does not overflow
MANY_LEAVES = 32  # if a shared search finds this many leaves plus k, each query searches the tree by itself
WIDER = 2.5  # squared search radius of a leaf: this times the mean squared distance to the k-th point in the last leaf
RUN_LEAVES = 8  # leaves of a run at least, as the radius of the first one takes a search of its own
MAX_RUNS = 256


class SearchBuffer(NamedTuple):
    """Buffers for the points that a search finds."""

    positions: Ints  # (m,), in tree order
    packed: Floats  # (3, m + STRIDE), coordinates; each row is an axis


def minimum_of_nodes(values: Floats, leaves: int) -> Floats:
    """Return the minimum of values, (N,) in tree order, below each node of a tree, (nodes,)."""
    minimum = np.empty(2 * leaves)
    minimum[leaves:] = np.minimum.reduceat(values, len(values) * np.arange(leaves) // leaves)
    while leaves > 1:
        leaves //= 2
        minimum[leaves : 2 * leaves] = np.minimum(*minimum[2 * leaves : 4 * leaves].reshape(-1, 2).T)
    return minimum


@kernel
def search_buffer(leaves):
    """Allocate buffers for the points of some leaves."""
    return SearchBuffer(
        np.empty(leaves * LEAF_SIZE, dtype=np.int64), np.empty((3, leaves * LEAF_SIZE + STRIDE), dtype=np.float64)
    )


@kernel(allocates=False)
def pack(points, buffer, count):
    """Copy coordinates, of (3, N), at the first positions in the buffer to `packed`; pad them with far points."""
    full = -(-count // STRIDE) * STRIDE
    for axis in range(3):
        row, packed = points[axis], buffer.packed[axis]
        for slot in range(count):
            packed[slot] = row[buffer.positions[slot]]
        packed[count:full] = FAR_COORDINATE
    return full


class Search(NamedTuple):
    """Buffers for searches of the k nearest points."""

    near: Ints  # (leaves,), node numbers of the leaves near the box of the shared search
    buffer: SearchBuffer  # The points found in these leaves
    squared: Floats  # (m + STRIDE,), squared distances of these points from a position
    positions: Ints  # (k,), of the nearest points, if a position searches the tree by itself or they are sorted
    gaps: Floats  # (k,), their squared distances
    local: Floats  # (3, k rounded up to STRIDE), vectors from a position to its k nearest points, then padding


@kernel
def search_for(k, tree):
    """Allocate buffers for searches of k points of a tree, as `KdTree.arrays`."""
    n_leaves = min(MANY_LEAVES + k, first_leaf(tree[1]) + 1)
    buffer = search_buffer(n_leaves)
    return Search(
        np.empty(n_leaves, dtype=np.int64), buffer, np.empty(buffer.packed.shape[1], dtype=np.float64),
        np.empty(k, dtype=np.int64), np.empty(k, dtype=np.float64),
        np.full((3, -(-k // STRIDE) * STRIDE), FAR_COORDINATE),
    )  # fmt: skip


@kernel
def look_around(points, lower, upper, box_lower, box_upper, squared_radius, search):
    """Find and pack all points within a radius of a box. Shapes: box_low, box_high (3,)."""
    count = leaves_near(lower, upper, box_lower, box_upper, squared_radius, search.near)
    if count == len(search.near):
        return 0
    near = search.near[:count]
    count = points_near(points, lower, upper, near, box_lower, box_upper, squared_radius, search.buffer.positions)
    return pack(points, search.buffer, count)


@kernel(inline="always")
def steps_to_nearest(points, lower, upper, x, y, z, count, squared_radius, search):
    """Find the k points nearest to (x, y, z), from the shared search if it is wide enough."""
    k, packed, positions = len(search.gaps), search.buffer.packed, search.buffer.positions
    nearest = radius_of_nearest(packed, count, x, y, z, k, squared_radius, search.squared)
    if nearest < 0.0:
        return steps_by_itself(points, lower, upper, x, y, z, search)
    slot = 0
    for j in range(count):
        positions[slot] = j  # always written and then counted or not: a branch would be mispredicted often
        slot += 1 if search.squared[j] <= nearest else 0
    farthest = 0.0
    for slot in range(k):
        j = positions[slot]
        search.local[0, slot], search.local[1, slot] = packed[0, j] - x, packed[1, j] - y
        search.local[2, slot] = packed[2, j] - z
        farthest = max(farthest, search.squared[j])
    return farthest


@kernel(fastmath=False)
def steps_by_itself(points, lower, upper, x, y, z, search):
    """Find the k points nearest to (x, y, z) by a search of the tree; otherwise like `steps_to_nearest`."""
    nearest_in_tree(points, lower, upper, x, y, z, search.positions, search.gaps)
    for slot in range(len(search.gaps)):
        j = search.positions[slot]
        search.local[0, slot], search.local[1, slot] = points[0, j] - x, points[1, j] - y
        search.local[2, slot] = points[2, j] - z
    return search.gaps[-1]


@kernel(fastmath=False, allocates=False, forceinline=True)
def sort_nearest(x, y, z, count, squared_radius, search):
    """Find what `nearest_in_tree` finds in the shared search; return whether that is wide enough and none are tied."""
    k, near, gaps = len(search.gaps), search.positions, search.gaps
    along_x, along_y, along_z = search.buffer.packed[0], search.buffer.packed[1], search.buffer.packed[2]
    squared = search.squared[:count]
    for j in range(count):
        squared[j] = (along_x[j] - x) ** 2 + (along_y[j] - y) ** 2 + (along_z[j] - z) ** 2
    limit = _radius_holding(squared, k, squared_radius)
    if limit < 0.0:
        return False
    slot, j, distinct = 0, 0, True
    while slot < k:
        near[slot] = j  # always written and then counted or not: a branch would be mispredicted often
        slot += 1 if squared[j] <= limit else 0
        j += 1
    for n in range(k):
        j, slot = near[n], n
        while slot > 0 and gaps[slot - 1] > squared[j]:
            gaps[slot], near[slot] = gaps[slot - 1], near[slot - 1]
            slot -= 1
        distinct = distinct and not (slot > 0 and gaps[slot - 1] == squared[j])
        gaps[slot], near[slot] = squared[j], search.buffer.positions[j]
    return distinct


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def radius_of_nearest(packed, count, x, y, z, k, squared_radius, squared):
    """Return a squared distance within which exactly k packed points, (3, m), lie, by regula falsi; or -1."""
    along_x, along_y, along_z = packed[0][:count], packed[1][:count], packed[2][:count]
    squared = squared[:count]
    for j in range(len(along_x)):
        dx, dy, dz = along_x[j] - x, along_y[j] - y, along_z[j] - z
        squared[j] = dx * dx + dy * dy + dz * dz
    return _radius_holding(squared, k, squared_radius)


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def _radius_holding(squared, k, squared_radius):
    """Return a limit that exactly k of the squared distances, (m,), do not exceed, by regula falsi; or -1."""
    lower, upper = 0.0, squared_radius
    below, above = 0.0, _within(squared, upper)
    for _ in range(24):
        if above < k:
            break
        if above == k:
            return upper
        middle = lower + (upper - lower) * (k - below) / (above - below)
        inside = _within(squared, middle)
        if inside == k:
            return middle
        if inside < k:
            lower, below = middle, inside
        else:
            upper, above = middle, inside
    return -1.0


@kernel(inline="always", fastmath={"nsz", "arcp", "contract", "reassoc"})
def _within(squared, limit):
    """Return how many of the squared distances, (m,), are at most `limit`."""
    count = 0.0
    for j in range(len(squared)):
        count += 1.0 if squared[j] <= limit else 0.0
    return count


def on_leaves(kernel: Callable[..., Any], tree: KdTree, queries: KdTree, *arguments: Any) -> None:
    """Call a kernel on ranges of runs of leaves of queries, with both trees as `KdTree.arrays`, on several threads."""
    runs = max(1, min(queries.leaves // RUN_LEAVES, MAX_RUNS))
    on_ranges(kernel, runs, runs, tree.arrays, queries.arrays, *arguments)


@kernel(allocates=False)
def leaves_of_runs(first, last, runs, queries):
    """Return the first leaf of a range of runs, and the leaf behind the last."""
    leaves = first_leaf(queries[1])
    return leaves + leaves * first // runs, leaves + leaves * last // runs


@kernel(forceinline=True)
def look_around_leaf(tree, queries, leaf, runs, mean, search, alone=False):
    """Find and pack the points near a leaf of queries, by the mean squared distance that the last leaf needed.

    In the first leaf of a run, it is that of the first query, or 0 if all its queries search `alone`. Returns where
    its queries begin and end, the number of points, and the squared radius within which all are found.
    """
    points, lower, upper = tree
    of_queries, queries_lower, queries_upper = queries
    leaves = first_leaf(queries_lower)
    begin, end = leaf_range(of_queries.shape[1], leaves, leaf)
    run = ((leaf - leaves + 1) * runs - 1) // leaves
    if leaf == leaves + leaves * run // runs:  # there is no last leaf
        x, y, z = of_queries[0, begin], of_queries[1, begin], of_queries[2, begin]
        nearest_in_tree(points, lower, upper, x, y, z, search.positions, search.gaps)
        mean = 0.0 if alone else search.gaps[-1]
    squared_radius = WIDER * mean
    count = look_around(points, lower, upper, queries_lower[leaf], queries_upper[leaf], squared_radius, search)
    return begin, end, count, squared_radius
