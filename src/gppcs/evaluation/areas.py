"""The area of the surface that each point of a cloud stands for, and percentiles that count by it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import nearest_distances

NEIGHBOURS = 8  # the k of `surface_area`
LARGEST = 0.99  # quantile to which larger areas are cut

Values = NDArray[np.float64]


def areas_of_points(tree: KdTree) -> Values:
    """Estimate the area that each point stands for, so that the density of a cloud has no influence.

    The estimate is that of `gppcs.spatial.spacing.surface_area`: the disc around a point that reaches to its 8th
    neighbour holds 8 other points, so the point stands for an eighth of the disc. The largest 1 % are cut to the 99 %
    quantile; otherwise a few outliers could count as much as all other points.

    Parameters
    ----------
    tree : KdTree
        The tree over N points without repeats.

    Returns
    -------
    (N,) array, float64
        Positive, in the squared unit of the points and in the order of the input. Their sum is about the area of the
        surface. All are 1 if they cannot be estimated, as for a single point.
    """
    n = len(tree.order)
    k = max(1, min(NEIGHBOURS, n - 1))
    discs = np.pi / k * nearest_distances(tree, k, most=n) ** 2
    largest = np.quantile(discs, LARGEST)
    if not largest > 0.0:
        return np.ones(n)
    areas = np.empty(n)
    areas[tree.order] = np.minimum(discs, largest)
    return areas


def weighted_quantile(values: Values, weights: Values, share: float) -> float:
    """Return the value below which a share of the weight lies.

    The weights of the values, in their order, divide a line into intervals. Each value lies in the middle of its
    interval; between two middles it is interpolated.

    Parameters
    ----------
    values : (N,) array
        At least one.
    weights : (N,) array
        Not negative, with a positive sum.
    share : float
        From 0 to 1.

    Returns
    -------
    float
    """
    order = np.argsort(values)
    ends = np.cumsum(weights[order])
    return float(np.interp(share * ends[-1], ends - weights[order] / 2.0, values[order]))
