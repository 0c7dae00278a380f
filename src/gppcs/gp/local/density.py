"""How dense the points should lie: denser where the surface is rough, and changing slowly from place to place."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.kdtree import KdTree, first_leaf, leaf_range, squared_distance_of_boxes, squared_distance_to_box

TOGETHER = 8  # points whose spacings are graded as one: fewer would take longer and change little
EVEN = 0.05  # roughness below which a place counts as flat
EDGE = 0.29  # roughness of a right-angled edge
SLOPE = 0.1  # by which the spacing grows with the distance, at most
FLAT = 1e-12  # surface variation, or spread of it, that is nothing but rounding


def desired_spacings(tree: KdTree, roughness: NDArray[np.float64], power: float) -> NDArray[np.float64]:
    """Return the spacing that each place deserves, in units of the target spacing; all in the tree's order.

    Roughness is the square root of the surface variation, about the radius of the neighbourhood times the curvature.
    A piecewise linear surface of given size has the least mean error if its density goes as the square root of the
    curvature, so the density here is roughness to a power; the more the cloud is one of faces and edges, the smaller a
    power, lest the faces are left bare. Normals among few points are sound only where their density changes slowly, so
    it is graded.
    """
    density = np.maximum(roughness, EVEN) ** power
    spacings = graded(tree, np.sqrt(np.mean(density) / density), SLOPE)
    return spacings * np.sqrt(np.mean(spacings**-2.0))


def segregation(roughness: NDArray[np.float64]) -> float:
    """Return how far a cloud is one of flat faces and right-angled edges: 1 for nothing else, 0 for all places alike.

    It is the variance of the roughness, as a share of the most that values from 0 to `EDGE` of that mean can have: the
    intensity of segregation of a mixture (Danckwerts 1952).
    """
    clipped = np.minimum(roughness, EDGE)
    mean = float(np.mean(clipped))
    most = mean * (EDGE - mean)
    return float(np.var(clipped)) / most if most > FLAT else 0.0


def graded(tree: KdTree, spacings: NDArray[np.float64], slope: float) -> NDArray[np.float64]:
    """Return spacings, nowhere above those given and nowhere above limits that grow with the distance by `slope`.

    The points of a leaf that follow each other, about `TOGETHER` of them, have one limit, that of their mean density at
    their middle; so within such a group spacings may differ more, and between groups by its size.

    Parameters
    ----------
    tree : KdTree
    spacings : (N,) array
        In tree order, like the result.
    slope : float
        Not negative.
    """
    n, leaves = len(spacings), first_leaf(tree.low)
    in_leaf = max(1, round(n / leaves / TOGETHER))
    leaf, part = np.divmod(np.arange(leaves * in_leaf), in_leaf)
    begin, end = n * leaf // leaves, n * (leaf + 1) // leaves
    starts = begin + (end - begin) * part // in_leaf
    counts = np.diff(starts, append=n)
    centres = KdTree.over(np.add.reduceat(tree.points, starts, axis=1) / counts)
    density = np.add.reduceat(spacings**-2.0, starts) / counts
    limits = limited(centres, density**-0.5, slope)
    return np.minimum(spacings, np.repeat(limits, counts))


def limited(tree: KdTree, spacings: NDArray[np.float64], slope: float) -> NDArray[np.float64]:
    """Return the greatest spacings, nowhere above those given, that grow with the distance by `slope` at most.

    At x_i that is the least of s_j + slope |x_i - x_j| (Persson 2006, Mesh size functions for implicit geometries and
    PDE-based gradient limiting, Engineering with Computers). All are in tree order.
    """
    least = np.empty(len(tree.low))
    _least_of_all(spacings, least)
    return _limited(tree.points, tree.low, tree.high, spacings, slope, least)


@nb.njit(cache=True, nogil=True)
def _least_of_all(values, least):
    """Fill every node with the least of its points' values, in tree order."""
    leaves = first_leaf(least)
    n = len(values)
    for leaf in range(leaves):
        least[leaves + leaf] = np.min(values[slice(*leaf_range(n, leaves, leaves + leaf))])
    for node in range(leaves - 1, 0, -1):
        least[node] = min(least[2 * node], least[2 * node + 1])


@nb.njit(cache=True, nogil=True, parallel=True)
def _limited(points, low, high, spacings, slope, least):
    """Lower the points of a leaf together, by the nodes from which any of them might be; the lowest bounds go first."""
    leaves = first_leaf(low)
    n = len(spacings)
    result = spacings.copy()
    for leaf in nb.prange(leaves):
        box_low, box_high = low[leaves + leaf], high[leaves + leaf]
        begin, end = leaf_range(n, leaves, leaves + leaf)
        greatest = np.max(result[begin:end])
        stack, bounds = np.empty(64, dtype=np.int64), np.empty(64)
        stack[0], bounds[0] = 1, least[1]
        height = 1
        while height:
            height -= 1
            node = stack[height]
            if bounds[height] >= greatest:
                continue
            if node >= leaves:
                for j in range(*leaf_range(n, leaves, node)):
                    gap = squared_distance_to_box(box_low, box_high, points[0, j], points[1, j], points[2, j])
                    if spacings[j] + slope * np.sqrt(gap) < greatest:
                        _lower(points[:, begin:end], points[:, j], spacings[j], slope, result[begin:end])
                        greatest = np.max(result[begin:end])
                continue
            for child in (2 * node, 2 * node + 1):
                gap = squared_distance_of_boxes(low[child], high[child], box_low, box_high)
                stack[height], bounds[height] = child, least[child] + slope * np.sqrt(gap)
                height += 1
            a, b = height - 2, height - 1
            if bounds[a] < bounds[b]:
                stack[a], stack[b], bounds[a], bounds[b] = stack[b], stack[a], bounds[b], bounds[a]
    return result


@nb.njit(cache=True, nogil=True)
def _lower(places, source, spacing, slope, result):
    """Lower the spacings at some places to what they may be by that of one point."""
    for i in range(len(result)):
        distance = np.sqrt(
            (places[0, i] - source[0]) ** 2 + (places[1, i] - source[1]) ** 2 + (places[2, i] - source[2]) ** 2
        )
        result[i] = min(result[i], spacing + slope * distance)
