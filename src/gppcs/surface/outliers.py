"""Outliers: points that neither their neighbours nor the surface explain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.spatial.kdtree import KdTree

NEIGHBOURS = 16  # More than there are points in a clump of outliers.
LONELY = 2.0  # Times the distance that the neighbours have to their own: on a surface, even at its border, it is less.
FAR = 10.0  # From so many times that distance on, no surface reaches the point.
ROWS = 1 << 18  # Points whose neighbours are looked up at once.


def find_outliers(cloud: CloudLike) -> NDArray[np.bool_]:
    """Tell which points neither their neighbours nor the surface explain.

    Let d be the mean distance of a point to its 16 nearest others, and s the median of the same of these others. The
    point is an outlier if d is above 2 s, and it lies more than s beside the plane of its neighbours or d is above
    10 s. Outliers are taken away and the others looked at again, until none is found: then outliers do not explain each
    other. Points of a sparse part of a scan are none, and neither are points of a border.

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like, path or object that `PointCloud.of` takes
        Exact repeats count once.

    Returns
    -------
    (N,) array, bool
        False for points with NaN or infinite coordinates, and for all of a cloud of less than 18 different points.

    Raises
    ------
    InputError
        If `cloud` is no cloud.

    Examples
    --------
    >>> cloud = gppcs.sample("sphere", n_points=1000)
    >>> mask = gppcs.find_outliers(np.concatenate([cloud.points, [[0.0, 0.0, 400.0]]]))
    >>> np.flatnonzero(mask)
    array([1000])
    """
    from gppcs.spatial.scaling import normalised

    cloud = PointCloud.of(cloud)
    rows = cloud.finite_rows()
    found = np.zeros(len(cloud), dtype=np.bool_)
    if not len(rows):
        return found
    places, back = np.unique(normalised(cloud.points[rows])[0], axis=0, return_inverse=True)
    outside, left = np.zeros(len(places), dtype=np.bool_), np.arange(len(places))
    while len(left) > NEIGHBOURS + 1:
        new = _among(KdTree.build(places[left]))
        outside[left[new]] = True
        if not new.any():
            break
        left = left[~new]
    found[rows] = outside[back.ravel()]
    return found


def _among(tree: KdTree) -> NDArray[np.bool_]:
    """Return which points of a tree are outliers, in its input order."""
    n = len(tree.order)
    points, place = np.ascontiguousarray(tree.points.T), tree.positions()
    distances, around = np.empty(n), np.empty(n)
    nearest = np.empty((n, NEIGHBOURS), dtype=np.int32)
    for begin in range(0, n, ROWS):
        found, squared = tree.nearest_of(points[begin : begin + ROWS], NEIGHBOURS + 1)
        distances[begin : begin + ROWS] = np.sqrt(squared[:, 1:]).mean(axis=1)
        nearest[begin : begin + ROWS] = place[found[:, 1:]]
    for begin in range(0, n, ROWS):
        around[begin : begin + ROWS] = np.median(distances[nearest[begin : begin + ROWS]], axis=1)
    lonely = np.flatnonzero(distances > LONELY * around)
    outside = distances[lonely] > FAR * around[lonely]
    outside |= _beside(points[lonely], points[nearest[lonely]]) > around[lonely]
    result = np.zeros(n, dtype=np.bool_)
    result[tree.order[lonely[outside]]] = True
    return result


def _beside(points: NDArray[np.float64], neighbours: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distances of points, (n, 3), from the planes of their neighbours, (n, k, 3)."""
    centres = neighbours.mean(axis=1)
    away = neighbours - centres[:, None]
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", away, away))
    distances: NDArray[np.float64] = np.abs(np.einsum("ni,ni->n", points - centres, axes[:, :, 0]))
    return distances
