"""Estimate the area of the surface and that which each point stands for, and the radius of a neighbourhood."""

import sys

import numpy as np

from gppcs.engine.arrays import Floats
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import AREA_NEIGHBOURS, squared_radii

AREA_QUANTILE = 0.99  # quantile to which larger areas are cut, for outliers
AREA_POINTS = 16_384  # of a larger cloud, the area is measured on so many points


def quantile(values: Floats, fraction: float) -> float:
    """Return what `np.quantile` does for values, (n,); where they are few, in a tenth of its time."""
    position = fraction * (len(values) - 1)
    below = int(position)
    above, part = min(below + 1, len(values) - 1), position - below
    ordered = np.partition(values, (below, above))
    a, b = float(ordered[below]), float(ordered[above])
    if part == 0.0:  # the next value may be infinite
        return a
    return b - (b - a) * (1.0 - part) if part >= 0.5 else a + (b - a) * part  # so that rounding is the same


def paper_radius(points: Floats, k: int = 25) -> float:
    """Return CloudCompare's radius for about k neighbours, which the paper uses (section 3.1): sqrt(k V^(2/3) / N)."""
    volume = np.prod(np.ptp(points, axis=0))
    return float(np.sqrt(k * np.cbrt(volume) ** 2 / len(points)))


def nearest_distances(tree: KdTree, k: int, maximum: int = 4096) -> Floats:
    """Return distances, (n,), to k-th neighbours, of points at equal steps in tree order, as files can be periodic."""
    n = tree.points.shape[1]
    chosen = np.ascontiguousarray(tree.points.T[:: max(1, -(-n // maximum))])
    _, squared = tree.nearest_of(chosen, min(k + 1, n))
    return np.sqrt(squared[:, -1])


def areas_of_points(tree: KdTree) -> Floats:
    """Estimate the area, (N,), that each point stands for, of which the largest 1 % are cut, for outliers."""
    areas = squared_radii(tree) * (np.pi / max(1, min(AREA_NEIGHBOURS, len(tree.order) - 1)))
    largest = quantile(areas, AREA_QUANTILE)
    return np.minimum(areas, largest) if largest > 0.0 else np.ones(len(areas))


def neighbourhood_radius(tree: KdTree, k: int = 25) -> float:
    """Return `paper_radius`, unless a flat or stretched box makes it wrong: then the median k-th distance."""
    k = min(k, sys.maxsize)  # which a float can hold
    radius, robust = paper_radius(tree.points.T, k), float(np.median(nearest_distances(tree, k - 1)))
    return radius if robust / 3 <= radius <= 3 * robust else robust


def surface_area(tree: KdTree) -> float:
    """Estimate the area of the surface by discs to the k-th neighbours; the largest 1 % are cut."""
    n = len(tree.order)
    k = min(AREA_NEIGHBOURS, n - 1)
    if k == 0:
        return 0.0
    squared = squared_radii(tree.in_own_order()) if n <= AREA_POINTS else nearest_distances(tree, k, AREA_POINTS) ** 2
    return float(np.pi / k * n * np.minimum(squared, quantile(squared, AREA_QUANTILE)).mean())
