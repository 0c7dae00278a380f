"""The greatest value below each node of a k-d tree: where it is, and how it follows when values change."""

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.spatial.kdtree import first_leaf, leaf_range


@kernel
def greatest_of_all(values, greatest, holder):
    """Fill each node with the greatest value, (N,), among its points, and the first of these positions, `holder`."""
    leaves = first_leaf(greatest)
    for node in range(2 * leaves - 1, 0, -1):
        if node >= leaves:
            greatest_in_leaf(node, values, greatest, holder)
        else:
            greater_child(node, greatest, holder)


@kernel(fastmath={"nnan", "nsz"}, allocates=False)
def greatest_in_leaf(node, values, greatest, holder):
    """Update the greatest value of one leaf, and its position."""
    begin, end = leaf_range(len(values), first_leaf(greatest), node)
    of_leaf, best = values[begin:end], -np.inf  # loops over slices are vectorised
    for j in range(len(of_leaf)):
        best = max(best, of_leaf[j])
    while values[begin] < best:
        begin += 1
    greatest[node], holder[node] = best, begin


@kernel(allocates=False)
def greater_child(node, greatest, holder):
    """Update the greatest value of one inner node, and its position, from its two children."""
    a, b = 2 * node, 2 * node + 1
    if greatest[b] > greatest[a]:
        a = b
    greatest[node], holder[node] = greatest[a], holder[a]
