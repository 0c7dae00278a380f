"""Surface variation and normals of any cloud, and how large its points are drawn, as pictures and pages show them."""

import math

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Floats, Ints
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_of_each
from gppcs.spatial.scaling import Frame, normalised
from gppcs.spatial.spacing import neighbourhood_radius
from gppcs.surface.surface_variation import Features, features_in_radius, features_of_nearest

AROUND = 16  # neighbours that tell a line from a surface: enough to reach lines of a scan whose discs close it
# Neighbours, and the largest ratio of their deviations across and in all directions, along wires and poles: some far
# around, as at the edge of a surface it is smaller than 0.5, and the next ones, as a second wire can be near.
ON_LINE = ((32, 0.36), (8, 0.08))  # in descending order
MAX_MEASURED = 50_000  # points that pages measure of more
FEWEST = 8  # points of a neighbourhood: the nearest ones, if fewer lie in the ball
UNTURNED = math.cos(math.radians(12.0))  # median cosine of normals of 25 and 100 points, at least, without noise
WIRE = 0.3  # radius of points of wires and poles, in that of most points: larger discs would be beads


def tree_over(points: Floats) -> tuple[KdTree, Ints]:
    """Return a tree over the distinct ones of points (N, 3), and which of these each point is (N,)."""
    is_first = first_occurrences(points)
    tree = KdTree.build(points[is_first])
    return tree, np.arange(len(points)) if is_first.all() else tree.nearest_of(points, 1)[0][:, 0]


def estimates(points: Floats) -> tuple[Floats, Floats, KdTree, Ints, Frame]:
    """Return surface variation (N,) and normals (N, 3) without a sign at points (N, 3), and `tree_over` them.

    The variation is NaN with fewer than four points. The points of the tree are in the frame, the last value.
    """
    local, frame = normalised(points)
    tree, same = tree_over(local)
    features = _across_noise(tree)
    sparse = np.flatnonzero(features.neighbours[tree.order] < FEWEST)
    if len(sparse):
        nearest, at = features_of_nearest(tree, FEWEST, KdTree.over(tree.points[:, sparse])), tree.order[sparse]
        features.surface_variation[at], features.normals[at] = nearest.surface_variation, nearest.normals
    # Rounding on a plane would look like relief, and fewer than four points always seem flat.
    variation = np.where(features.surface_variation <= 1e-12, 0.0, features.surface_variation)
    return np.where(len(tree.order) < 4, np.nan, variation)[same], features.normals[same], tree, same, frame


def _across_noise(tree: KdTree) -> Features:
    """Measure balls of about 25 points; of 100 or 400 where so many turn most normals, as they even out noise."""
    features = features_in_radius(tree, neighbourhood_radius(tree))
    sampled = tree.one_of_each(-(-len(tree.order) // 4096))
    queries, normals, enough = KdTree.over(tree.points[:, sampled]), features.normals[tree.order[sampled]], 25
    for count in (100, 400):
        wider = features_of_nearest(tree, count, queries).normals
        if np.median(np.abs(np.einsum("nx,nx->n", normals, wider))) > UNTURNED:
            break
        normals, enough = wider, count
    return features if enough == 25 else features_in_radius(tree, neighbourhood_radius(tree, enough))


def disc_radii(tree: KdTree, maximum: int = MAX_MEASURED) -> Floats:
    """Return the distance (N,) of each point of a tree to its sixth neighbour; less on lines and for stray points.

    Of more points than a maximum, every few are measured, and the others have the radius of the nearest of these.
    """
    in_order = tree.in_own_order()
    measured = in_order.thinned(-(-len(tree.order) // maximum))
    points = np.ascontiguousarray(measured.points.T)
    neighbours, squared = in_order.nearest_of(points, min(AROUND + 1, len(tree.order)))
    total, across, thinnest = _deviations(tree, neighbours)
    sixth = np.sqrt(squared[:, min(6, squared.shape[1] - 1)])
    radii = np.clip(3.0 * across, 0.2 * sixth, sixth)  # three standard deviations across a line
    usual = np.median(radii)
    sparse = np.flatnonzero((radii > 1.5 * usual) | ((radii > WIRE * usual) & (across < 0.45 * total)))
    radii[sparse[are_on_lines(in_order, points[sparse])]] = WIRE * usual
    in_space = (thinnest > 0.35 * across) | (across < 0.35 * total)  # on no surface, such as where wires meet
    around, _ = measured.nearest_of(points, min(AROUND, len(points)))
    alone = radii > 2.0 * np.median(radii[around], axis=1)  # such as beside a surface
    radii = np.where(in_space | alone, np.minimum(radii, usual), radii)
    if measured is not in_order:
        radii = radii[nearest_of_each(measured, tree)[0]]
    return radii[tree.positions()]


def thin_on_lines(radii: Floats, dense: KdTree, points: Floats) -> Floats:
    """Return radii (N,) that are small where a tree over the dense cloud has wires and poles: at points (N, 3)."""
    return np.where(are_on_lines(dense, points), np.minimum(radii, WIRE * np.median(radii)), radii)


def are_on_lines(tree: KdTree, points: Floats) -> NDArray[np.bool_]:
    """Return which of some points (N, 3) have their neighbours in a tree along a line, as those of wires and poles."""
    neighbours, _ = tree.in_own_order().nearest_of(points, min(1 + ON_LINE[0][0], len(tree.order)))
    spreads = ((_deviations(tree, neighbours[:, : 1 + count]), ratio) for count, ratio in ON_LINE)
    return np.logical_or.reduce([across < ratio * total for (total, across, _), ratio in spreads])


def _deviations(tree: KdTree, neighbours: Ints) -> tuple[Floats, Floats, Floats]:
    """Return deviations (N,) of neighbours (N, k), in tree order: in all directions, about the second, the third."""
    distinct = np.ascontiguousarray(tree.points.T)
    (totals, across, thinnest), at_once = np.empty((3, len(neighbours))), 1 << 12  # which fit into the cache
    for first in range(0, len(neighbours), at_once):
        part = slice(first, first + at_once)
        patches = distinct[neighbours[part]]
        patches -= patches.mean(axis=1, keepdims=True)
        spread = patches.transpose(0, 2, 1) @ patches / patches.shape[1]
        total = np.einsum("nii->n", spread)
        # About the second eigenvalue: the products of two eigenvalues each, divided by the sum of all.
        products = np.maximum(total * total - np.einsum("nij,nij->n", spread, spread), 0.0) / 2.0
        across[part] = np.sqrt(products / np.where(total > 0.0, total, 1.0))
        # And the third: the product of all, divided by those of two each.
        thinnest[part] = np.sqrt(np.maximum(np.linalg.det(spread), 0.0) / np.where(products > 0.0, products, 1.0))
        totals[part] = np.sqrt(total)
    return totals, across, thinnest
