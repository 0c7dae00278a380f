"""Outliers: points that neither their neighbours nor the surface explain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.outliers.definition import NEIGHBOURS, look_at
from gppcs.surface.outliers.rounds import NO_POINTS, Content, Part, Points, all_outliers, repeating


def find_outliers(cloud: CloudLike) -> NDArray[np.bool_]:
    """Tell which points neither their neighbours nor the surface explain.

    Let d be the mean distance of a point to its 16 nearest others. Its neighbours are all others at most as far as the
    16th, and s is the median of their d. The point is an outlier if d is above 2 s, and it lies more than s beside the
    plane of its neighbours or d is above 10 s. Outliers are taken away and the others looked at again, until none is
    found: then outliers do not explain each other. Points of a sparse part of a scan are none, and neither are points
    of a border.

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
        If `cloud` is no cloud, or its size overflows.

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
    if len(rows):
        found[rows] = outliers_among(normalised(cloud.points[rows])[0])
    return found


def outliers_among(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points are outliers; see `find_outliers`.

    Shapes: points (N, 3); returns (N,).
    """
    firsts = np.flatnonzero(first_occurrences(points))
    if len(firsts) <= NEIGHBOURS + 1:
        return np.zeros(len(points), dtype=np.bool_)
    tree = KdTree.build(points[firsts])
    look = look_at(tree, len(firsts))
    content, positions = Content(tree, look.reach[tree.order]), tree.positions()[look.outside]
    whole = Part.of(lambda: content, np.full(3, -np.inf), np.full(3, np.inf), len(firsts))
    zeros = np.zeros(len(positions))
    found = Points(zeros.astype(np.int64), positions, content.places(positions), zeros)
    (gone,) = all_outliers([whole], found, NO_POINTS, map)
    return repeating(points, points[firsts[tree.order[gone]]])
