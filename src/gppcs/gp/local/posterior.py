"""Posterior mean and variance of the local field (Eq. (8); paper, Eqs. 3 and 4), by the nearest chosen points.

This is the nearest-neighbour Gaussian process (Vecchia 1988; Datta et al. 2016). `compute_posteriors` computes the
variance of a candidate: for all of them in `posterior_of_all`, and in `greedy_state.rescore` after each choice.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.kernel import LANES, SITE, STEP, LocalField, correlate, field_distance
from gppcs.spatial.box_distances import squared_distance_of_boxes, squared_distance_to_box
from gppcs.spatial.kdtree import LEAF_SIZE, KdTree, after, first_leaf, leaf_range
from gppcs.spatial.leaves import minimum_of_nodes

NEGLIGIBLE = 1e-12  # Smallest pivot of the factorisation, in units of the prior variance: less is only rounding.
# Squared range of a search, times that of the last leaf; that of a second search, times what it is known to need.
WIDER, ROUNDED_UP = 1.3, 1.0 + 1e-9


class Conditioning(NamedTuple):
    """The K chosen points on which each of n points is conditioned, nearest first."""

    nearest: NDArray[np.int32]  # (n, K), columns of the chosen points in the field's order; -1 where fewer are chosen
    squared: Floats  # (n, K), their squared distances in the field; infinite where fewer are chosen


def posterior_of_all(
    field: LocalField, conditioning: Conditioning, error_weight: float
) -> tuple[Floats, Floats, Floats]:
    """Return mean and variance of the field, and the score, at every point; (n,) each."""
    n = len(field.y)
    means, variances, scores = results = np.empty((3, n))
    on_ranges(_posterior_everywhere, n, field, conditioning.nearest, error_weight, *results, minimum=1024)
    return means, variances, scores


@kernel
def _posterior_everywhere(begin, end, field, nearest, error_weight, means, variances, scores):
    """Fill the entries `begin` to `end` of the results, (n,) each, by nearest, (n, K)."""
    work = work_for(nearest.shape[1], len(field.detail))
    indices = np.empty(LANES * -(-(end - begin) // LANES), dtype=np.int64)
    for i in range(len(indices)):  # the last is repeated, so that all lanes are computed whatever the range
        indices[i] = min(begin + i, end - 1)
    for first in range(0, len(indices), LANES):
        compute_posteriors(field, nearest, indices, first, first + LANES, error_weight, work)
        for p in range(min(LANES, end - begin - first)):
            i = begin + first + p
            means[i], variances[i], scores[i] = work.mean[p], work.variance[p], work.score[p]


class Work(NamedTuple):
    """Memory for the posteriors of LANES points, each conditioned on K others."""

    sites: Floats  # (K + 1, SITE + k, LANES), of the K points on which each point is conditioned, and of itself
    # (K (K + 2), LANES): K rows of the Cholesky factor, with the inverse of its diagonal. Each row ends with two
    # solutions of the triangular system: for the covariances with the point, and for y.
    factor: Floats
    # (LANES,) each, the current row: covariance with the point, y, and diagonal.
    cross: Floats
    observed: Floats
    pivot: Floats
    # (LANES,) each, the results.
    mean: Floats
    variance: Floats
    score: Floats


@kernel(inline="always")
def work_for(neighbours, details):
    """Return memory for posteriors."""
    return Work(
        np.empty((neighbours + 1, SITE + details, LANES), dtype=np.float64),
        np.empty((neighbours * (neighbours + 2), LANES), dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
        np.empty(LANES, dtype=np.float64),
    )


@kernel(fastmath={"contract", "nnan", "nsz", "arcp", "reassoc"}, allocates=False)
def compute_posteriors(field, nearest, indices, begin, end, error_weight, work):
    """Compute mean and variance (Eq. (8)) and score (Eq. (9)) at the points `indices[begin:end]`, side by side."""
    neighbours, lanes = nearest.shape[1], STEP * -(-(end - begin) // STEP)
    sites, factor, cross, observed, pivot, mean, variance, score = work
    _gather(field, nearest, indices, begin, end, lanes, sites)
    for p in range(lanes):
        mean[p], variance[p] = 0.0, 1.0
    for a in range(neighbours):
        of_a = a * (neighbours + 2)
        correlate(sites, a, neighbours, field.lengthscale, field.normal_weight, lanes, cross)
        for p in range(lanes):
            observed[p], pivot[p] = sites[a, 7, p], sites[a, 8, p]
        for b in range(a):
            of_b = b * (neighbours + 2)
            correlate(sites, a, b, field.lengthscale, field.normal_weight, lanes, factor[of_a + b])
            for c in range(b):
                for p in range(lanes):
                    factor[of_a + b, p] -= factor[of_a + c, p] * factor[of_b + c, p]
            for p in range(lanes):
                entry = factor[of_a + b, p] * factor[of_b + b, p]
                factor[of_a + b, p] = entry
                cross[p] -= entry * factor[of_b + neighbours, p]
                observed[p] -= entry * factor[of_b + neighbours + 1, p]
                pivot[p] -= entry * entry
        for p in range(lanes):
            inverse = 1.0 / np.sqrt(max(pivot[p], NEGLIGIBLE))
            of_point, of_y = cross[p] * inverse, observed[p] * inverse
            factor[of_a + a, p] = inverse
            factor[of_a + neighbours, p], factor[of_a + neighbours + 1, p] = of_point, of_y
            variance[p] -= of_point * of_point
            mean[p] += of_point * of_y
    for p in range(lanes):
        variance[p] = max(variance[p], 0.0)
        # Eq. (9)
        gain = variance[p] / (variance[p] + (sites[neighbours, 8, p] - 1.0))
        score[p] = np.sqrt(gain * variance[p]) + error_weight * gain * abs(mean[p] - sites[neighbours, 7, p])


@kernel(allocates=False)
def _gather(field, nearest, indices, begin, end, lanes, sites):
    """Copy what the kernel and the observation need of each point into lanes, (K + 1, SITE + k, LANES)."""
    neighbours = nearest.shape[1]
    for p in range(lanes):
        i = indices[min(begin + p, end - 1)]
        for a in range(neighbours + 1):
            j = nearest[i, a] if a < neighbours else i
            if j < 0:
                sites[a, :, p] = 0.0
                sites[a, 0, p], sites[a, 6, p], sites[a, 8, p] = (a + 1) / NEGLIGIBLE, 1.0, 1.0
                continue
            for axis in range(3):
                sites[a, axis, p], sites[a, 3 + axis, p] = field.positions[axis, j], field.normals[axis, j]
            sites[a, 6, p], sites[a, 7, p], sites[a, 8, p] = field.spacings[j], field.y[j], 1.0 + field.noise[j]
            for c in range(len(field.detail)):
                sites[a, SITE + c, p] = field.detail[c, j]


def condition(field: LocalField, tree: KdTree, chosen: Ints, neighbours: int) -> Conditioning:
    """Find the chosen points that are nearest each point in the metric of the field. Shapes: chosen (m,)."""
    n = len(field.y)
    conditioning = Conditioning(np.full((n, neighbours), -1, dtype=np.int32), np.full((n, neighbours), np.inf))
    if len(chosen):
        indices = np.sort(chosen)  # in the tree's order, as `KdTree.over` needs it
        tree_of_chosen = KdTree.over(np.ascontiguousarray(field.positions[:, indices]))
        widest = -minimum_of_nodes(-(field.spacings[indices] ** 2), tree_of_chosen.leaves)
        tasks = min(tree.leaves, 64)  # runs of leaves, in each of which a search starts from the range of the last
        among = _Chosen(*tree_of_chosen.arrays, indices, widest)
        on_ranges(_condition_leaves, tasks, tasks, field, tree.lower, tree.upper, among, conditioning)
    return conditioning


class _Chosen(NamedTuple):
    """The k-d tree of the m chosen points."""

    points: Floats  # (3, m)
    lower: Floats  # (nodes, 3)
    upper: Floats  # (nodes, 3)
    indices: Ints  # (m,), their columns in the field's order
    widest: Floats  # (nodes,), their largest squared desired spacing


@kernel(fastmath=False)
def _condition_leaves(begin, end, tasks, field, lower, upper, chosen, conditioning):
    """Fill `conditioning`, (n, K), in a range of tasks: leaf by leaf of the field's tree, (nodes, 3)."""
    leaves = first_leaf(lower)
    neighbours = conditioning.nearest.shape[1]
    side = _SideBySide(
        np.empty((7 + len(field.detail), LEAF_SIZE), dtype=np.float64),
        np.empty((neighbours, LEAF_SIZE), dtype=np.int64),
        np.empty((neighbours, LEAF_SIZE), dtype=np.float64),
        np.empty(LEAF_SIZE, dtype=np.int64),
        np.empty(LEAF_SIZE, dtype=np.float64),
    )
    near = np.empty(len(chosen.indices) + 1, dtype=np.int64)
    for task in range(begin, end):
        squared = 1.0
        for leaf in range(leaves + leaves * task // tasks, leaves + leaves * (task + 1) // tasks):
            needed = _condition_leaf(field, lower, upper, chosen, leaf, squared, near, side, conditioning)
            squared = WIDER * needed if needed > 0.0 else 1.0  # a range of 0 could not grow


@kernel(inline="always")
def _condition_leaf(field, lower, upper, chosen, leaf, squared, near, side, conditioning):
    """Condition the points of a leaf, by a search within a squared range at first; return the largest of theirs."""
    begin, end = leaf_range(len(field.y), first_leaf(lower), leaf)
    for p in range(LEAF_SIZE):
        i = min(begin + p, end - 1)  # the last one fills the rest
        for axis in range(3):
            side.points[axis, p], side.points[3 + axis, p] = field.positions[axis, i], field.normals[axis, i]
        side.points[6, p] = field.spacings[i]
        for c in range(len(field.detail)):
            side.points[7 + c, p] = field.detail[c, i]
    while True:
        count = _find_chosen(chosen, lower[leaf], upper[leaf], squared, side.points, near)
        needed = _keep_nearest_side_by_side(field, chosen, near[:count], side)
        if needed <= squared or count == len(chosen.indices):
            break
        squared = min(ROUNDED_UP * needed, 4.0 * squared)
    for i in range(begin, end):
        for slot in range(len(side.squared)):
            conditioning.nearest[i, slot] = side.nearest[slot, i - begin]
            conditioning.squared[i, slot] = side.squared[slot, i - begin]
    return min(needed, squared)


@kernel(fastmath=False, allocates=False)
def _find_chosen(chosen, box_lower, box_upper, squared, points, near):
    """Fill `near` with the chosen points that may be within a squared range of points in a box; return their number.

    At a distance d, the squared distance in the field is at least d^2 / ((s^2 + s'^2) / 2). Shapes: points (7 + k, n).
    """
    lowest, highest = (box_lower[0], box_lower[1], box_lower[2]), (box_upper[0], box_upper[1], box_upper[2])
    n, leaves = chosen.points.shape[1], first_leaf(chosen.lower)
    node, count, widest = 1, 0, 0.0
    for p in range(points.shape[1]):
        widest = max(widest, points[6, p])
    while node:
        squared_distance = 0.5 * squared * (widest**2 + chosen.widest[node])
        if squared_distance_of_boxes(chosen.lower[node], chosen.upper[node], box_lower, box_upper) <= squared_distance:
            if node < leaves:
                node *= 2
                continue
            for j in range(*leaf_range(n, leaves, node)):
                x, y, z = chosen.points[0, j], chosen.points[1, j], chosen.points[2, j]
                near[count] = j  # always written and then counted or not: a branch would be mispredicted often
                count += 1 if squared_distance_to_box(lowest, highest, x, y, z) <= squared_distance else 0
        node = after(node, 1)
    return count


class _SideBySide(NamedTuple):
    """The points of a leaf side by side, and what each is conditioned on so far."""

    points: Floats  # (7 + k, LEAF_SIZE), rows: position, normal, desired spacing, details
    nearest: Ints  # (K, LEAF_SIZE), as in `Conditioning`, transposed
    squared: Floats  # (K, LEAF_SIZE)
    new: Ints  # (LEAF_SIZE,), a chosen point that is being inserted
    gaps: Floats  # (LEAF_SIZE,), its squared distances in the field


@kernel(fastmath=False, allocates=False)
def _keep_nearest_side_by_side(field, chosen, near, side):
    """Keep, for each point of a leaf, the nearest of some chosen points, (count,); return the largest range."""
    neighbours = len(side.squared)
    side.nearest[:] = -1
    side.squared[:] = np.inf
    for slot in near:
        j = chosen.indices[slot]
        x, y, z = field.positions[0, j], field.positions[1, j], field.positions[2, j]
        u, v, w = field.normals[0, j], field.normals[1, j], field.normals[2, j]
        s = field.spacings[j]
        for p in range(LEAF_SIZE):
            cosine = side.points[3, p] * u + side.points[4, p] * v + side.points[5, p] * w
            side.gaps[p] = field_distance(
                side.points[0, p] - x, side.points[1, p] - y, side.points[2, p] - z, cosine, side.points[6, p], s,
                field.normal_weight,
            )  # fmt: skip
            side.new[p] = j
        for c in range(len(field.detail)):
            for p in range(LEAF_SIZE):
                side.gaps[p] += (side.points[7 + c, p] - field.detail[c, j]) ** 2
        for rank in range(neighbours):
            for p in range(LEAF_SIZE):
                gap, squared, new, nearest = side.gaps[p], side.squared[rank, p], side.new[p], side.nearest[rank, p]
                nearer = gap < squared
                side.squared[rank, p], side.gaps[p] = gap if nearer else squared, squared if nearer else gap
                side.nearest[rank, p], side.new[p] = new if nearer else nearest, nearest if nearer else new
    needed = 0.0
    for p in range(LEAF_SIZE):
        needed = max(needed, side.squared[neighbours - 1, p])
    return needed
