"""Outliers: points that neither their neighbours nor the surface explain."""

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.queries import has_others, medians, others_within
from gppcs.spatial.scaling import normalised
from gppcs.spatial.units import Units

CLUMP_NEIGHBOURS = 16  # More than there are points in a clump of outliers.


def find_outliers(cloud: CloudLike) -> NDArray[np.bool_]:
    """Find the points that neither their neighbours nor the surface explain.

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
    return find_in_units(cloud, cloud.units)


def find_in_units(cloud: PointCloud, units: Units | None) -> Flags:
    """Find the outliers of a cloud whose axes have these units."""
    finite = np.flatnonzero(cloud.is_finite())
    mask = np.zeros(len(cloud), dtype=np.bool_)
    if len(finite):
        mask[finite] = outliers_among(normalised(cloud.points[finite], units)[0])
    return mask


def outliers_among(points: Floats) -> Flags:
    """Find the outliers among points, (N, 3); after the first round, only those near ones that are gone."""
    distinct = points[first_occurrences(points)]
    tree = KdTree.build(distinct)
    means, squared = np.empty(len(distinct)), np.empty(len(distinct))
    changed = checked = np.ones(len(distinct), dtype=np.bool_)
    gone = [np.empty((0, 3))]
    while tree.points.shape[1] > CLUMP_NEIGHBOURS + 1:
        distinct = np.ascontiguousarray(tree.points.T)
        for batch in _batches(changed):
            to_nearest = tree.nearest_of(distinct[batch], CLUMP_NEIGHBOURS + 1)[1][:, 1:]
            means[batch] = (
                np.cumsum(np.sqrt(to_nearest), axis=1)[:, -1] / CLUMP_NEIGHBOURS
            )  # in the order of the neighbours
            squared[batch] = to_nearest[:, -1]
        outside = np.zeros(len(distinct), dtype=np.bool_)
        for batch in _batches(checked):
            outside[batch] = _are_outside(tree, distinct, means, squared, batch)
        if not outside.any():
            break
        gone.append(distinct[outside])
        distinct, means, squared = distinct[~outside], means[~outside], squared[~outside]
        tree = KdTree.over(distinct.T)
        changed = has_others(KdTree.build(gone[-1]), distinct, squared)
        checked = changed | has_others(KdTree.build(distinct[changed]), distinct, squared) if changed.any() else changed
    if len(gone) == 1:
        return np.zeros(len(points), dtype=np.bool_)
    at_one: Flags = KdTree.build(np.concatenate(gone)).nearest_of(points, 1)[1][:, 0] == 0.0
    return at_one


def _batches(mask: Flags) -> list[Ints]:
    """Return the indices in a mask, in batches whose neighbours fit into memory."""
    indices, size = np.flatnonzero(mask), 1 << 16
    return [indices[begin : begin + size] for begin in range(0, len(indices), size)]


def _are_outside(tree: KdTree, distinct: Floats, means: Floats, squared: Floats, indices: Ints) -> Flags:
    """Find the outliers among points, (n, 3) in tree order, by means and squared radii of neighbourhoods, (n,)."""
    starts, near = others_within(tree, distinct[indices], squared[indices])
    around = medians(starts, means[near])
    outside = means[indices] > 2.0 * around  # on a surface, even at its boundary, it is less
    isolated, around = indices[outside], around[outside]
    starts, near = others_within(tree, distinct[isolated], squared[isolated])
    beside = _distances_to_planes(distinct[isolated], starts, distinct[near])
    outside[outside] = (means[isolated] > 10.0 * around) | (beside > around)  # so far off, there is no surface
    return outside


def _distances_to_planes(distinct: Floats, starts: Ints, neighbours: Floats) -> Floats:
    """Return the distance of each point, (m, 3), to the plane of its neighbours, (n, 3)."""
    owners = np.repeat(np.arange(len(distinct)), np.diff(starts))
    neighbours = neighbours[np.lexsort([*neighbours.T, owners])]  # the sums below do not depend on the order of points
    centres = np.add.reduceat(neighbours, starts[:-1]) / np.diff(starts)[:, np.newaxis]
    away = neighbours - centres[owners]
    moments = np.add.reduceat(away[:, :, np.newaxis] * away[:, np.newaxis], starts[:-1])
    return np.abs(np.einsum("ni,ni->n", distinct - centres, np.linalg.eigh(moments)[1][:, :, 0]))
