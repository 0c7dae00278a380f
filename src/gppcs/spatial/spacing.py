"""Estimate the area that each point stands for, and the radius of a neighbourhood."""

from __future__ import annotations

import sys

import numpy as np

from gppcs.engine.arrays import Floats
from gppcs.spatial.kdtree import AREA_QUANTILE, NEIGHBOURS, KdTree, nearest_distances
from gppcs.spatial.nearest import squared_radii


def paper_radius(points: Floats, k: int = 25) -> float:
    """Return CloudCompare's radius for about k neighbours, which the paper uses (section 3.1): sqrt(k V^(2/3) / N)."""
    volume = np.prod(np.ptp(points, axis=0))
    return float(np.sqrt(k * np.cbrt(volume) ** 2 / len(points)))


def areas_of_points(tree: KdTree) -> Floats:
    """Estimate the area, (N,), that each point stands for, of which the largest 1 % are cut, for outliers."""
    areas = squared_radii(tree) * (np.pi / max(1, min(NEIGHBOURS, len(tree.order) - 1)))
    largest = np.quantile(areas, AREA_QUANTILE)
    return np.minimum(areas, largest) if largest > 0.0 else np.ones(len(areas))


def neighbourhood_radius(tree: KdTree, k: int = 25) -> float:
    """Return `paper_radius`, unless a flat or stretched box makes it wrong: then the median k-th distance."""
    k = min(k, sys.maxsize)  # which a float can hold
    radius, robust = paper_radius(tree.points.T, k), float(np.median(nearest_distances(tree, k - 1)))
    return radius if robust / 3 <= radius <= 3 * robust else robust
