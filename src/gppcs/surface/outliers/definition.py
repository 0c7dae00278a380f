"""What an outlier is: the rule for points whose neighbours are known.

The neighbours of a point are all others at most as far as the 16th nearest. So it does not matter in which order points
at the same distance are found.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.kdtree import QUERIES_AT_ONCE, KdTree
from gppcs.spatial.near_points import medians, others_within

NEIGHBOURS = 16  # More than there are points in a clump of outliers.
LONELY = 2.0  # Times the distance that the neighbours have to their own: on a surface, even at its border, it is less.
FAR = 10.0  # From so many times that distance on, no surface reaches the point.
ROWS = 1 << 16  # Points whose neighbours are looked up at once.
SURE = 1.0 + 1e-9  # A neighbour must be nearer than what was not looked at by this factor, as squares are rounded.


class Look(NamedTuple):
    """What a tree tells of its first points.

    Attributes
    ----------
    reach : (n,) array
        Squared distance of each point to the 16th nearest other of the tree; infinite if there are too few.
    outside, undecided : (k,) arrays, int64
        Which points are outliers, and of which this tree does not tell it; ascending.
    """

    reach: NDArray[np.float64]
    outside: NDArray[np.int64]
    undecided: NDArray[np.int64]


def look_at(tree: KdTree, n: int, clearance: NDArray[np.float64] | None = None) -> Look:
    """Find outliers among the points of a tree, as far as it tells.

    Shapes: clearance (N,).
    """
    if len(tree.order) <= NEIGHBOURS:
        return Look(np.full(n, np.inf), np.empty(0, dtype=np.int64), np.arange(n))
    points = np.ascontiguousarray(tree.points.T)
    means, reach = np.empty(len(points)), np.empty(len(points))
    for begin in range(0, len(points), ROWS):
        end = begin + ROWS
        squared = tree.nearest_of(points[begin:end], NEIGHBOURS + 1)[1][:, 1:]
        means[begin:end], reach[begin:end] = mean_distances(squared), squared[:, -1]
    if clearance is not None:
        means[reach * SURE >= (np.maximum(clearance, 0.0) ** 2)[tree.order]] = np.nan
    own = np.flatnonzero(tree.order < n)
    lonely, unknown = [], []
    for begin in range(0, len(own), ROWS):
        some = own[begin : begin + ROWS]
        starts, found = others_within(tree, points[some], reach[some])
        around = medians(starts, means[found])
        unknown.append(some[np.isnan(means[some]) | np.isnan(around)])
        lonely.append(_strays(tree, points, means, around, reach, some))
    of_own = np.empty(n)
    of_own[tree.order[own]] = reach[own]
    outside, undecided = (np.sort(tree.order[np.concatenate(parts)]) for parts in (lonely, unknown))
    return Look(of_own, outside, undecided)


def _strays(
    tree: KdTree,
    points: NDArray[np.float64],
    means: NDArray[np.float64],
    around: NDArray[np.float64],
    reach: NDArray[np.float64],
    some: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return which points at `some` positions of a tree are outliers; `around` is of these, the others of all."""
    lonely = means[some] > LONELY * around
    some, around = some[lonely], around[lonely]
    starts, found = others_within(tree, points[some], reach[some])
    return some[are_outside(points[some], means[some], around, starts, points[found])]


def mean_distances(squared: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean distance of each row of squared distances, (n, k). They are added in their order."""
    total = np.zeros(len(squared))
    for column in np.sqrt(squared).T:
        total += column
    return total / squared.shape[1]


def are_outside(
    points: NDArray[np.float64],
    means: NDArray[np.float64],
    around: NDArray[np.float64],
    starts: NDArray[np.int64],
    neighbours: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Tell which points are outliers.

    Shapes: points (m, 3), means (m,), around (m,), starts (m + 1,), neighbours (n, 3); returns (m,).
    """
    owners = np.repeat(np.arange(len(points)), np.diff(starts))
    neighbours = neighbours[np.lexsort([*neighbours.T, owners])]
    moments, away = np.empty((len(points), 3, 3)), np.empty((len(points), 3))
    on_ranges(_planes, len(points), points, starts, neighbours, moments, away, least=QUERIES_AT_ONCE)
    _, axes = np.linalg.eigh(moments)
    beside = np.abs(np.einsum("ni,ni->n", away, axes[:, :, 0]))
    outside: NDArray[np.bool_] = (means > LONELY * around) & ((means > FAR * around) | (beside > around))
    return outside


@kernel
def _planes(begin, end, points, starts, neighbours, moments, away):
    """Fill `moments`, (m, 3, 3), of neighbours around their centre, and the way from it to points, `away`, (m, 3)."""
    centre = np.empty(3)
    for i in range(begin, end):
        some = neighbours[starts[i] : starts[i + 1]]
        for a in range(3):
            centre[a] = 0.0
            for j in range(len(some)):
                centre[a] += some[j, a]
            centre[a] /= len(some)
            away[i, a] = points[i, a] - centre[a]
        for a in range(3):
            for b in range(3):
                moments[i, a, b] = 0.0
                for j in range(len(some)):
                    moments[i, a, b] += (some[j, a] - centre[a]) * (some[j, b] - centre[b])
