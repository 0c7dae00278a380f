"""How near points are: the radius of a neighbourhood, the spacing and the area of a cloud."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.kdtree import KdTree


def paper_radius(points: NDArray[np.float64], k: int = 25) -> float:
    """Return CloudCompare's radius for about k neighbours, the paper's choice (its section 3.1).

    r = sqrt(k V^(2/3) / N), with V the volume of the bounding box: the surface is taken to be as large as a side
    of the cube of that volume. A box of no volume gives zero.
    """
    volume = np.prod(np.ptp(points, axis=0))
    return float(np.sqrt(k * np.cbrt(volume) ** 2 / len(points)))


def nearest_distances(tree: KdTree, k: int, most: int = 4096) -> NDArray[np.float64]:
    """Return the distance of up to `most` points of the tree to their k-th nearest neighbour, in tree order.

    They are evenly spread over the order of the tree, so that each part of the cloud has its share of them; that of a
    file can have a rhythm, as where several scanners take turns. The point itself does not count; where fewer than k
    others exist, the farthest takes the k-th's place.
    """
    n = tree.points.shape[1]
    chosen = np.ascontiguousarray(tree.points.T[:: max(1, -(-n // most))])
    _, squared = tree.nearest_of(chosen, min(k + 1, n))
    return np.sqrt(squared[:, -1])


def spacing(tree: KdTree) -> float:
    """Return the median distance of a point to its nearest neighbour; there must be no repeats."""
    return float(np.median(nearest_distances(tree, 1)))


def surface_area(tree: KdTree, k: int = 8) -> float:
    """Return an estimate of the area of the surface that the points lie on, whatever their density.

    A disc around a point to its k-th neighbour holds k others, so the point stands for a k-th of it. The hundredth of
    the points with the largest discs stand for no more than the next, lest a few strays count as much as all others.
    There must be no repeats; a single point has no area.
    """
    n = tree.points.shape[1]
    k = min(k, n - 1)
    if k == 0:
        return 0.0
    squared = nearest_distances(tree, k, most=16_384) ** 2
    return float(np.pi / k * n * np.minimum(squared, np.quantile(squared, 0.99)).mean())


def neighbourhood_radius(points: NDArray[np.float64], tree: KdTree, k: int = 25) -> float:
    """Return the radius that holds about k points, the point itself counted: the paper's, where it can be used.

    The paper's rule sees only the bounding box. Where that is flat, or stretched by far points, it can be off
    without bound, so a radius more than three times the median distance to the k-th point, or less than a
    third of it, is replaced by that distance.
    """
    radius, robust = paper_radius(points, k), float(np.median(nearest_distances(tree, k - 1)))
    return radius if robust / 3 <= radius <= 3 * robust else robust
