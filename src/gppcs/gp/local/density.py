"""The desired spacing at each place: small where the surface is rough, and changing slowly from place to place.

The rows "density off", "gradation off" and "segregation off" of the ablation (benchmarks/results/gp_ablation.md) show
what the parts are worth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range, squared_distance_of_boxes, squared_distance_to_box

GROUP_SIZE = 8  # Points with one limit of the gradation. Limits for each point take eight times as long and gain 0.5 %.
# Flat places count as this rough, so that they are not left bare. Without it, H max is 6 % larger; 0.03 is as good and
# 0.1 is 1 % worse in H mean (research/experiments.md, "floor of the roughness").
LEAST_ROUGHNESS = 0.05
EDGE_ROUGHNESS = 0.29  # Roughness on a right-angled edge: 0.292 at any radius (research/experiments.md).
ROUNDNESS_POWER = 4.0  # Of 1 - S^2 for a segregation S. The larger, the less flat faces with edges count as round.
GRADATION = 0.1  # Growth of the spacing with distance, at most; 0.05 and 0.2 are worse (research/experiments.md).
# Near a jump of the weights, and where normals turn much from one point to the next, the choice follows the desired
# spacings less than it should. With this power of the weights, densities have the wanted ratio (docs/ask.md).
WEIGHT_POWER = 1.15
FINEST = 8.0  # Times the usual number of candidates at most, where large weights want many points in few places.
ROUNDING = 1e-12  # Surface variation, or its standard deviation, below this is only rounding.


def density_of(roughness: NDArray[np.float64], power: float) -> NDArray[np.float64]:
    """Return the wanted density of points, up to a factor, given the roughness of n places, (n,).

    It is a power of the roughness, as a piecewise linear surface of given size has the least mean error if its density
    goes as the square root of the curvature.
    """
    return np.maximum(roughness, LEAST_ROUGHNESS) ** power


def weighted(spacings: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return spacings of n places of which the density is multiplied by weights, (n,); the mean of their density is 1.

    The weights come after the gradation, so that the density jumps where they do.
    """
    density = weights**WEIGHT_POWER * spacings**-2.0
    return np.sqrt(np.mean(density) / density)


def refinement(weights: NDArray[np.float64]) -> float:
    """Return how many times as many candidates are needed as without weights, (N,)."""
    return min(float(weights.max() / weights.mean()), FINEST)


def roundness_of(roughness: NDArray[np.float64]) -> float:
    """Return from 1 for a cloud whose places are alike to 0 for flat faces and edges only, given roughness, (n,).

    It depends on the variance of the roughness, divided by the largest variance that values from 0 to `EDGE_ROUGHNESS`
    with the same mean can have: the intensity of segregation of a mixture (Danckwerts 1952). That is 1 for flat faces
    and right-angled edges only, and 0 if all places are alike.
    """
    clipped = np.minimum(roughness, EDGE_ROUGHNESS)
    mean = float(np.mean(clipped))
    most = mean * (EDGE_ROUGHNESS - mean)
    segregation = float(np.var(clipped)) / most if most > ROUNDING else 0.0
    return (1.0 - min(segregation, 1.0) ** 2) ** ROUNDNESS_POWER


def graded(tree: KdTree, spacings: NDArray[np.float64], slope: float) -> NDArray[np.float64]:
    """Return the given spacings, lowered where they would grow faster than `slope` with the distance.

    Normals among few points are good only where the density changes slowly.

    Each group of about `GROUP_SIZE` points that follow each other in a leaf has one limit, computed from its mean
    density at its middle. So spacings can differ more within a group, and by the size of a group between two groups.
    The limit at x_i is the minimum over j of s_j + slope |x_i - x_j| (Persson 2006, Mesh size functions for implicit
    geometries and PDE-based gradient limiting, Engineering with Computers). Shapes: spacings (N,); returns (N,).
    """
    n, leaves = len(spacings), tree.leaves
    in_leaf = max(1, round(n / leaves / GROUP_SIZE))
    leaf, part = np.divmod(np.arange(leaves * in_leaf), in_leaf)
    begin, end = n * leaf // leaves, n * (leaf + 1) // leaves
    starts = begin + (end - begin) * part // in_leaf
    counts = np.diff(starts, append=n)
    centres = KdTree.over(np.add.reduceat(tree.points, starts, axis=1) / counts)
    density = np.add.reduceat(spacings**-2.0, starts) / counts
    means, level = density**-0.5, centres.leaves
    least = np.empty(2 * level)  # of each node's groups
    least[level:] = np.minimum.reduceat(means, len(means) * np.arange(level) // level)
    while level > 1:
        level //= 2
        least[level : 2 * level] = least[2 * level : 4 * level].reshape(-1, 2).min(axis=1)
    limits = means.copy()
    on_ranges(
        _limit_leaves, centres.leaves, centres.points, centres.low, centres.high, means, slope, least, limits, least=16
    )
    return np.minimum(spacings, np.repeat(limits, counts))


@kernel
def _limit_leaves(begin, end, points, low, high, spacings, slope, least, result):
    """Limit `result`, (N,), in a range of leaves, given points, (3, N), boxes, (nodes, 3), and `least`, (nodes,).

    For each leaf, visit the nodes that can lower the spacing of one of its points, those with the lowest bounds first.
    """
    leaves = first_leaf(low)
    n = len(spacings)
    for leaf in range(begin, end):
        box_low, box_high = low[leaves + leaf], high[leaves + leaf]
        first, last = leaf_range(n, leaves, leaves + leaf)
        greatest = _greatest(result, first, last)
        stack, bounds = np.empty(64, dtype=np.int64), np.empty(64, dtype=np.float64)
        stack[0], bounds[0] = 1, least[1]
        height = 1
        while height:
            height -= 1
            node = stack[height]
            if bounds[height] >= greatest:
                continue
            if node >= leaves:
                start, stop = leaf_range(n, leaves, node)
                for j in range(start, stop):
                    gap = squared_distance_to_box(box_low, box_high, points[0, j], points[1, j], points[2, j])
                    if spacings[j] + slope * np.sqrt(gap) < greatest:
                        _lower(points[:, first:last], points[:, j], spacings[j], slope, result[first:last])
                        greatest = _greatest(result, first, last)
                continue
            for child in (2 * node, 2 * node + 1):
                gap = squared_distance_of_boxes(low[child], high[child], box_low, box_high)
                stack[height], bounds[height] = child, least[child] + slope * np.sqrt(gap)
                height += 1
            a, b = height - 2, height - 1
            if bounds[a] < bounds[b]:
                stack[a], stack[b], bounds[a], bounds[b] = stack[b], stack[a], bounds[b], bounds[a]


@kernel(allocates=False)
def _greatest(values, first, last):
    """Return the greatest of the values, (N,), from `first` to `last`."""
    greatest = values[first]
    for i in range(first + 1, last):
        greatest = max(greatest, values[i])
    return greatest


@kernel(allocates=False)
def _lower(places, source, spacing, slope, result):
    """Lower the spacings, (m,), at places, (3, m), to the limit that one point, (3,), with its spacing sets."""
    for i in range(len(result)):
        distance = np.sqrt(
            (places[0, i] - source[0]) ** 2 + (places[1, i] - source[1]) ** 2 + (places[2, i] - source[2]) ** 2
        )
        result[i] = min(result[i], spacing + slope * distance)
