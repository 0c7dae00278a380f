"""Surface variation and normals from the covariance of each point's neighbourhood (paper, section 3.1)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import CloudLike, PointCloud, usable
from gppcs.engine.equality import ComparedByValue
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.errors import whole_number
from gppcs.spatial.box_distances import squared_distance_of_boxes, squared_span_of_boxes
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import LEAF_SIZE, KdTree, after, first_leaf, leaf_range, points_near
from gppcs.spatial.leaves import (
    leaves_of_runs,
    look_around_leaf,
    on_leaves,
    pack,
    radius_of_nearest,
    search_buffer,
    search_for,
    steps_by_itself,
)
from gppcs.spatial.scaling import normalised
from gppcs.spatial.spacing import neighbourhood_radius
from gppcs.surface.moments import (
    AT_ONCE,
    MOMENTS,
    add_shifted,
    flattest_of,
    flattest_side_by_side,
    middle,
    moments_in_ball,
)

LEAVES_PER_GROUP = 8  # the points of this many leaves share one search of the tree


@dataclass(frozen=True, eq=False)
class Features(ComparedByValue):
    """Local properties of the surface at each point.

    Attributes
    ----------
    surface_variation : (N,) array, float64
        lambda_0 / (lambda_0 + lambda_1 + lambda_2), with lambda_0 <= lambda_1 <= lambda_2 the eigenvalues of the
        covariance of the neighbourhood (Pauly, Gross and Kobbelt 2002). It lies between 0 (flat) and 1/3, and is 0
        for neighbourhoods of fewer than three points.
    normals : (N, 3) array, float64
        Unit eigenvectors of lambda_0. Their signs are arbitrary; `gppcs.estimate_normals` orients normals.
    neighbours : (N,) array, int32
        Number of points in the neighbourhood, the point itself included.

    Examples
    --------
    >>> import gppcs
    >>> features = gppcs.estimate_features(gppcs.sample("sphere", n_points=1000))
    >>> features.surface_variation.shape
    (1000,)
    """

    surface_variation: NDArray[np.float64]
    normals: NDArray[np.float64]
    neighbours: NDArray[np.int32]


def estimate_features(cloud: CloudLike, neighbours: int = 25) -> Features:
    """Measure the surface variation and the normal of each point (paper, section 3.1).

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like or object that `PointCloud.from_object` takes
    neighbours : int
        k: all neighbourhoods are balls of the same radius, which is chosen so that they hold about k points, the point
        itself included.

    Returns
    -------
    Features

    Raises
    ------
    InputError
        If the cloud is empty, has a wrong shape or has coordinates that are not finite.
    ParameterError
        If `neighbours` is below 1.

    Examples
    --------
    A bracket has flat faces and sharp edges, so its surface variation is close to zero at most points:

    >>> import numpy as np
    >>> import gppcs
    >>> variation = gppcs.estimate_features(gppcs.sample("bracket", n_points=20_000)).surface_variation
    >>> bool(np.median(variation) < 0.01 < variation.max())
    True
    """
    neighbours = whole_number("the number of neighbours", neighbours, 1)
    cloud = PointCloud.from_object(cloud)
    points, _ = normalised(usable(cloud, "cloud"), cloud.units)
    tree = KdTree.build(points)
    first = first_occurrences(points)
    distinct = tree if first.all() else KdTree.build(points[first])
    return features_in_radius(tree, neighbourhood_radius(distinct, neighbours))


def features_in_radius(tree: KdTree, radius: float) -> Features:
    """Measure each point's neighbourhood of all points within a radius; nodes of dense parts count as a whole."""
    n = len(tree.order)
    features = Features(np.empty(n), np.empty((n, 3)), np.empty(n, dtype=np.int32))
    moments = np.empty((0, MOMENTS))
    groups = max(1, tree.leaves // LEAVES_PER_GROUP)
    nodes = slice(groups, 2 * groups)
    # Nodes count as a whole only if some group of leaves is smaller than the balls.
    if (tree.upper[nodes] - tree.lower[nodes]).max(axis=1).min() <= 2.0 * radius:
        moments = np.empty((len(tree.lower), MOMENTS))
        _node_moments(*tree.arrays, moments)
    outputs = features.surface_variation, features.normals, features.neighbours
    on_ranges(_features_in_balls, groups, groups, *tree.arrays, tree.order, moments, radius * radius, *outputs)
    return features


@kernel
def _node_moments(points, lower, upper, moments):
    """Compute the moments of each node of a tree, relative to the middle of its box. Shapes: moments (nodes, 10)."""
    n, leaves = points.shape[1], first_leaf(lower)
    point = np.zeros(MOMENTS, dtype=np.float64)
    point[0] = 1.0
    for node in range(2 * leaves - 1, 0, -1):
        x, y, z = middle(lower[node], upper[node])
        moments[node] = 0.0
        if node < leaves:
            for child in (2 * node, 2 * node + 1):
                u, v, w = middle(lower[child], upper[child])
                add_shifted(moments[child], u - x, v - y, w - z, moments[node])
            continue
        for i in range(*leaf_range(n, leaves, node)):
            add_shifted(point, points[0, i] - x, points[1, i] - y, points[2, i] - z, moments[node])


@kernel
def _features_in_balls(
    first, last, groups, points, lower, upper, order, moments, squared_radius, variation, normals, neighbours
):
    """Fill the features, (N,) and (N, 3), for some groups of leaves; `moments` is (nodes, 10) or empty."""
    n, leaves = points.shape[1], first_leaf(lower)
    near, buffer = np.empty(leaves, dtype=np.int64), search_buffer(LEAVES_PER_GROUP * LEAVES_PER_GROUP)
    of_points, shared = np.ones((MOMENTS, AT_ONCE), dtype=np.float64), np.empty(MOMENTS, dtype=np.float64)
    in_group = leaves // groups
    for group in range(groups + first, groups + last):
        count = _around(group, lower, upper, moments, squared_radius, near, shared)
        if count * LEAF_SIZE > len(buffer.positions):
            buffer = search_buffer(count + LEAVES_PER_GROUP)
        for leaf in range(group * in_group, (group + 1) * in_group):
            begin, end = leaf_range(n, leaves, leaf)
            n_near = points_near(
                points, lower, upper, near[:count], lower[leaf], upper[leaf], squared_radius, buffer.positions
            )
            full = pack(points, buffer, n_near)
            for i in range(begin, end):
                x, y, z = points[0, i], points[1, i], points[2, i]
                moments_in_ball(buffer.packed, full, x, y, z, squared_radius, of_points, i - begin)
                if shared[0] > 0.0:
                    u, v, w = middle(lower[group], upper[group])
                    add_shifted(shared, u - x, v - y, w - z, of_points[:, i - begin])
            _finish(of_points, order[begin:end], variation, normals, neighbours)


@kernel
def _finish(moments, indices, variation, normals, neighbours):
    """Fill the features of a leaf's points, (n,) `indices`, from the moments of their neighbourhoods, (10, AT_ONCE)."""
    flat, normal = np.empty(AT_ONCE, dtype=np.float64), np.empty((3, AT_ONCE), dtype=np.float64)
    sure, direction = np.empty(AT_ONCE, dtype=np.float64), np.empty(3, dtype=np.float64)
    flattest_side_by_side(moments, flat, normal, sure)
    for p in range(len(indices)):
        index = indices[p]
        if sure[p] > 0.0:
            variation[index] = flat[p]
            direction[0], direction[1], direction[2] = normal[0, p], normal[1, p], normal[2, p]
        else:
            variation[index] = flattest_of(moments[:, p], direction)
        neighbours[index] = moments[0, p]
        if len(normals):  # otherwise they are not asked for
            normals[index, 0], normals[index, 1], normals[index, 2] = direction[0], direction[1], direction[2]


@kernel(inline="always")
def _around(group, lower, upper, moments, squared_radius, near, shared):
    """Fill `near` with the leaves within the radius of a node, and `shared`, (10,), by nodes that are so as a whole."""
    leaves = first_leaf(lower)
    x, y, z = middle(lower[group], upper[group])
    shared[:] = 0.0
    node, count = 1, 0
    while node:
        if squared_distance_of_boxes(lower[node], upper[node], lower[group], upper[group]) <= squared_radius:
            span = squared_span_of_boxes(lower[node], upper[node], lower[group], upper[group])
            if len(moments) and span <= squared_radius:
                u, v, w = middle(lower[node], upper[node])
                add_shifted(moments[node], u - x, v - y, w - z, shared)
            elif node < leaves:
                node *= 2
                continue
            else:
                near[count] = node
                count += 1
        node = after(node, 1)
    return count


def features_of_nearest(tree: KdTree, k: int, queries: KdTree | None = None) -> Features:
    """Measure the k nearest points of each point, itself included, or of each of n queries, in their input's order."""
    queries = queries or tree
    n = len(queries.order)
    features = Features(np.empty(n), np.empty((n, 3)), np.empty(n, dtype=np.int32))
    outputs = features.surface_variation, features.normals, features.neighbours
    on_leaves(_features_of_nearest, tree, queries, queries.order, min(k, len(tree.order)), *outputs)
    return features


@kernel
def _features_of_nearest(first, last, runs, tree, queries, order, k, variation, normals, neighbours):
    """Fill the features, (n,) and (n, 3), from the k nearest points of each of n queries, in a range of runs."""
    (points, lower, upper), (of_queries, _, _) = tree, queries
    search, moments, mean = search_for(k, tree), np.ones((MOMENTS, AT_ONCE), dtype=np.float64), 0.0
    for leaf in range(*leaves_of_runs(first, last, runs, queries)):
        begin, end, count, squared_radius = look_around_leaf(tree, queries, leaf, runs, mean, search)
        total = 0.0
        for i in range(begin, end):
            x, y, z = of_queries[0, i], of_queries[1, i], of_queries[2, i]
            squared = radius_of_nearest(search.buffer.packed, count, x, y, z, k, squared_radius, search.squared)
            if squared >= 0.0:
                moments_in_ball(search.buffer.packed, count, x, y, z, squared, moments, i - begin)
            else:
                squared, full = steps_by_itself(points, lower, upper, x, y, z, search), search.local.shape[1]
                moments_in_ball(search.local, full, 0.0, 0.0, 0.0, 2.0 * squared, moments, i - begin)
            total += squared
        mean = total / (end - begin)
        _finish(moments, order[begin:end], variation, normals, neighbours)
