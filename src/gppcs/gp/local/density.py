"""The desired spacing at each candidate: small where the surface is rough, and changing slowly (Eqs. (3) and (4))."""

import numpy as np

from gppcs.engine.arrays import Floats
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.settings import EDGE_ROUGHNESS, MAX_REFINEMENT, MIN_ROUGHNESS, ROUNDNESS_POWER
from gppcs.spatial.box_distances import squared_distance_of_boxes, squared_distance_to_box
from gppcs.spatial.kdtree import KdTree, after, first_leaf, leaf_range
from gppcs.spatial.leaves import minimum_of_nodes

VARIATION_ROUNDING = 1e-12  # Surface variation, or its standard deviation, below this is only rounding.


def density_of(roughness: Floats, power: float) -> Floats:
    """Return the desired density of points, up to a factor, by the roughness, (n,) (Eq. (3))."""
    return np.maximum(roughness, MIN_ROUGHNESS) ** power


def refinement(weights: Floats) -> float:
    """Return how many times as many candidates are needed as without weights, (N,)."""
    return min(float(weights.max() / np.sort(weights).mean()), MAX_REFINEMENT)  # a sum of any order of points


def mean_and_variance(values: Floats) -> tuple[float, float]:
    """Return what `np.mean` and `np.var` do for values, (n,); where they are few, in a third of their time."""
    mean = float(np.add.reduce(values)) / len(values)
    return mean, float(np.add.reduce((values - mean) ** 2)) / len(values)


def roundness_of(roughness: Floats) -> float:
    """Return the roundness, Eq. (3a), by the roughness, (n,): 1 if equally rough, 0 for flat faces and edges.

    S is the variance of the roughness, divided by the largest variance that values from 0 to `EDGE_ROUGHNESS` with the
    same mean can have: the intensity of segregation of a mixture (Danckwerts 1952).
    """
    mean, variance = mean_and_variance(np.minimum(roughness, EDGE_ROUGHNESS))
    largest = mean * (EDGE_ROUGHNESS - mean)
    segregation = variance / largest if largest > VARIATION_ROUNDING else 0.0
    return (1.0 - min(segregation, 1.0) ** 2) ** ROUNDNESS_POWER


def graded(tree: KdTree, spacings: Floats, slope: float, group_size: int = 8) -> Floats:
    """Return the spacings, (N,), lowered where they grow faster than `slope` with the distance (Eq. (4)).

    Each group of about `group_size` points that follow each other in a leaf has one limit, computed from its mean
    density at its middle: limits for each point take eight times as long and gain 0.5 % (Persson 2006, Mesh size
    functions for implicit geometries and PDE-based gradient limiting, Engineering with Computers).
    """
    n, leaves = len(spacings), tree.leaves
    in_leaf = max(1, round(n / leaves / group_size))
    leaf, part = np.divmod(np.arange(leaves * in_leaf + 1), in_leaf)
    begin, end = n * leaf // leaves, n * (leaf + 1) // leaves
    ends = begin + (end - begin) * part // in_leaf  # the last is n
    starts, counts = ends[:-1], np.diff(ends)
    centres = KdTree.over(np.add.reduceat(tree.points, starts, axis=1) / counts)
    density = np.add.reduceat(1.0 / (spacings * spacings), starts) / counts
    means = density**-0.5
    minima, limits = minimum_of_nodes(means, centres.leaves), means.copy()
    on_ranges(_limit_leaves, centres.leaves, *centres.arrays, means, slope, minima, limits, minimum=16)
    return np.minimum(spacings, np.repeat(limits, counts))


@kernel
def _limit_leaves(begin, end, points, lower, upper, spacings, slope, minima, limits):
    """Lower `limits`, (N,), in a range of leaves, by points, (3, N), boxes, (nodes, 3), and `minima`, (nodes,)."""
    leaves = first_leaf(lower)
    n = len(spacings)
    for leaf in range(begin, end):
        box_lower, box_upper = lower[leaves + leaf], upper[leaves + leaf]
        first, last = leaf_range(n, leaves, leaves + leaf)
        largest = 0.0
        for i in range(first, last):
            largest = max(largest, limits[i])
        node = 1
        while node:
            gap = squared_distance_of_boxes(lower[node], upper[node], box_lower, box_upper)
            if minima[node] + slope * np.sqrt(gap) < largest:
                if node < leaves:
                    node *= 2
                    continue
                for j in range(*leaf_range(n, leaves, node)):
                    gap = squared_distance_to_box(box_lower, box_upper, points[0, j], points[1, j], points[2, j])
                    if spacings[j] + slope * np.sqrt(gap) < largest:
                        largest = _lower(points[:, first:last], points[:, j], spacings[j], slope, limits[first:last])
            node = after(node, 1)


@kernel(allocates=False)
def _lower(points, source, spacing, slope, limits):
    """Lower limits, (m,), at points, (3, m), to that which one point, (3,), sets; return the largest limit."""
    largest = 0.0
    for i in range(len(limits)):
        distance = np.sqrt(
            (points[0, i] - source[0]) ** 2 + (points[1, i] - source[1]) ** 2 + (points[2, i] - source[2]) ** 2
        )
        limits[i] = min(limits[i], spacing + slope * distance)
        largest = max(largest, limits[i])
    return largest
