"""Outliers: points that neither their neighbours nor the surface explain."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.spatial.boxes import Each, Part
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.near_points import has_others, medians, others_within
from gppcs.spatial.scaling import normalised
from gppcs.spatial.stored import StoredPoints

NEIGHBOURS = 16  # More than there are points in a clump of outliers.
LONELY = 2.0  # Times the distance that the neighbours have to their own: on a surface, even at its border, it is less.
FAR = 10.0  # From so many times that distance on, no surface reaches the point.
ROWS = 1 << 16  # Points whose neighbours are looked up at once.
PART = 1 << 17  # Points of a part on disk at most.
TRIED = 1 << 10  # Points that tell how wide the halo of a part must be.
SHARE = 0.99  # Of these points, the neighbours and theirs are to be in the halo.
WIDER = 2.5  # Width of the halo, relative to the distance to the 16th neighbour: these have neighbours, too.


def find_outliers(cloud: CloudLike) -> NDArray[np.bool_]:
    """Tell which points neither their neighbours nor the surface explain.

    Let d be the mean distance of a point to its 16 nearest others. Its neighbours are all others at most as far as the
    16th, and s is the median of their d. The point is an outlier if d is above 2 s, and it lies more than s beside the
    plane of its neighbours or d is above 10 s. Outliers are taken away and the others looked at again, until none is
    found: then outliers do not explain each other. Points of a sparse part of a scan are none, and neither are points
    of a border.

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like or object that `PointCloud.from_object` takes
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
    cloud = PointCloud.from_object(cloud)
    rows = cloud.finite_rows()
    found = np.zeros(len(cloud), dtype=np.bool_)
    if len(rows):
        found[rows] = outliers_among(normalised(cloud.points[rows])[0])
    return found


def outliers_among(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points, (N, 3), are outliers; after the first round, only those near ones that are gone."""
    places = points[first_occurrences(points)]
    tree = KdTree.build(places)
    means, reach = np.empty(len(places)), np.empty(len(places))
    changed = asked = np.ones(len(places), dtype=np.bool_)
    gone = [np.empty((0, 3))]
    while tree.points.shape[1] > NEIGHBOURS + 1:
        places = np.ascontiguousarray(tree.points.T)
        for some in _batches(changed):
            squared = tree.nearest_of(places[some], NEIGHBOURS + 1)[1][:, 1:]
            means[some] = (
                np.cumsum(np.sqrt(squared), axis=1)[:, -1] / NEIGHBOURS
            )  # added in the order of the neighbours
            reach[some] = squared[:, -1]
        outside = np.zeros(len(places), dtype=np.bool_)
        for some in _batches(asked):
            outside[some] = _are_outside(tree, places, means, reach, some)
        if not outside.any():
            break
        gone.append(places[outside])
        places, means, reach = places[~outside], means[~outside], reach[~outside]
        tree = KdTree.over(np.ascontiguousarray(places.T))
        changed = has_others(KdTree.build(gone[-1]), places, reach)
        asked = changed | has_others(KdTree.build(places[changed]), places, reach) if changed.any() else changed
    return _lie_at(points, np.concatenate(gone))


def _batches(asked: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Return the rows that are asked for, in batches whose neighbours fit into memory."""
    rows = np.flatnonzero(asked)
    return [rows[begin : begin + ROWS] for begin in range(0, len(rows), ROWS)]


def _are_outside(
    tree: KdTree,
    places: NDArray[np.float64],
    means: NDArray[np.float64],
    reach: NDArray[np.float64],
    some: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Tell which of some places, (n, 3) in tree order, are outliers, by means and reaches of neighbourhoods, (n,)."""
    starts, found = others_within(tree, places[some], reach[some])
    around = medians(starts, means[found])
    outside = means[some] > LONELY * around
    lonely, around = some[outside], around[outside]
    starts, found = others_within(tree, places[lonely], reach[lonely])
    beside = _distances_to_planes(places[lonely], starts, places[found])
    outside[outside] = (means[lonely] > FAR * around) | (beside > around)
    return outside


def _distances_to_planes(
    places: NDArray[np.float64], starts: NDArray[np.int64], neighbours: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distance of each place, (m, 3), to the plane of its neighbours, (n, 3)."""
    owners = np.repeat(np.arange(len(places)), np.diff(starts))
    neighbours = neighbours[np.lexsort([*neighbours.T, owners])]  # the sums below do not depend on the order of points
    centres = np.add.reduceat(neighbours, starts[:-1]) / np.diff(starts)[:, np.newaxis]
    away = neighbours - centres[owners]
    moments = np.add.reduceat(away[:, :, np.newaxis] * away[:, np.newaxis], starts[:-1])
    return np.abs(np.einsum("ni,ni->n", places - centres, np.linalg.eigh(moments)[1][:, :, 0]))


def _lie_at(points: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points, (N, 3), lie at some places, (n, 3)."""
    if not len(places):
        return np.zeros(len(points), dtype=np.bool_)
    at_one: NDArray[np.bool_] = KdTree.build(places).nearest_of(points, 1)[1][:, 0] == 0.0
    return at_one


def outliers_in_parts(stored: StoredPoints, each: Each, advanced: Callable[[int], None]) -> NDArray[np.int64]:
    """Find the rows of the outliers of stored points, ascending: those of `find_outliers`, part by part."""
    parts = stored.parts(PART)
    found = [np.empty(0, dtype=np.int64)]
    for part, rows in zip(parts, each(partial(_outliers_of_part, stored), parts), strict=True):
        found.append(rows)
        advanced(int(stored.counts[part.first : part.last].sum()))
    return np.sort(np.concatenate(found))


def _outliers_of_part(stored: StoredPoints, part: Part) -> NDArray[np.int64]:
    """Find the outliers of a part, with a halo in which the neighbours of most points lie, and theirs."""
    own = stored.near(part)
    tree = KdTree.build(own.points)
    tried = own.points[:: max(1, len(own.rows) // TRIED)]
    reach = np.sqrt(tree.nearest_of(tried, min(NEIGHBOURS + 1, len(own.rows)))[1][:, -1])
    near = stored.near(part, WIDER * float(np.quantile(reach, SHARE)), repeats=True)
    return near.rows[outliers_among(near.points) & near.inside]
