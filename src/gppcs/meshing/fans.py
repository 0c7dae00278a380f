"""The fans of all points, how many of them have each triangle, and the signs of normals by what they agree on."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from gppcs.clouds.topology import connected
from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.triangles import circumradius, row
from gppcs.surface.fans import MAX_FAN, ON_CIRCLE, POINTS_AT_ONCE, corners_of_fans

AGREEING = 0.1  # least cosine between the normals of neighbours on one sheet
STEEPEST = 0.7  # largest sine of the angle between a step to a neighbour and the tangent plane


def fans_of(points: Floats, normals: Floats, near: Ints, on_circle: float = ON_CIRCLE[0]) -> tuple[Ints, Ints, Floats]:
    """Return the Delaunay triangles of fans in tangent planes, how many of three fans have each, and their radii."""
    n = len(points)
    corners = corners_of_fans(points, normals, near, AGREEING, STEEPEST, on_circle)
    votes = np.zeros((n, MAX_FAN), dtype=np.int8)
    radii = np.zeros((n, MAX_FAN))
    on_ranges(_count_votes, n, points, corners, votes, radii, minimum=POINTS_AT_ONCE)
    counted = np.flatnonzero(votes)
    triangles = np.column_stack([counted // MAX_FAN, corners.reshape(-1, 2)[counted]])
    return triangles, votes.ravel()[counted].astype(np.int64), radii.ravel()[counted]


@kernel(allocates=False)
def _count_votes(begin, end, points, corners, votes, radii):
    """Fill votes and radii, (n, MAX_FAN), at the fan of lowest index of those that have a triangle."""
    for i in range(begin, end):
        for slot in range(MAX_FAN):
            a, b = corners[i, slot]
            if a < 0:
                break
            by_a, by_b = _has(corners[a], b, i), _has(corners[b], i, a)
            if (by_a and a < i) or (by_b and b < i):
                continue
            votes[i, slot] = 1 + by_a + by_b
            radii[i, slot] = circumradius(row(points, i), row(points, a), row(points, b))


@kernel(allocates=False)
def _has(corners, a, b):
    """Return whether a fan, (MAX_FAN, 2), has the triangle with these corners."""
    for slot in range(MAX_FAN):  # noqa: SIM110 (Numba has no generators)
        if corners[slot, 0] == a and corners[slot, 1] == b:
            return True
    return False


def turned_patches(triangles: Ints, points: Floats, normals: Floats, near: Ints) -> Flags:
    """Return which normals, (n, 3), to turn so that patches, by the majority of near points, (n, k), agree."""
    patches, patch = connected(triangles[:, :2].ravel(), triangles[:, 1:].ravel(), len(points))
    pairs, agreement = _agreements(patch, points, normals, near)
    sums = coo_array((agreement, np.sort(patch[pairs], axis=0)), shape=(patches, patches)).tocsr()
    sums.eliminate_zeros()
    a, b = minimum_spanning_tree(-abs(sums)).nonzero()
    differ = patches * (sums[a, b] < 0.0)
    _, side = connected(np.append(a, a + patches), np.append(b + differ, b + patches - differ), 2 * patches)
    _, tree = connected(a, b, patches)
    by_size = np.argsort(np.bincount(patch), kind="stable")
    largest = np.empty(patches, dtype=np.int64)
    largest[tree[by_size]] = by_size
    turned: Flags = side[:patches] != side[largest[tree]]  # each patch is there twice, as it is and turned
    return turned[patch]


def _agreements(patch: Ints, points: Floats, normals: Floats, near: Ints) -> tuple[Ints, Floats]:
    """Return pairs of near points of different patches, (2, p), on one sheet, and the cosines between their normals."""
    i, j = np.repeat(np.arange(len(points)), near.shape[1]), near.ravel()
    differ = patch[i] != patch[j]
    i, j = i[differ], j[differ]
    step = points[j] - points[i]
    flat = np.einsum("ij,ij->i", step, normals[i]) ** 2 <= STEEPEST**2 * (step**2).sum(axis=1)
    i, j = i[flat], j[flat]
    return np.array([i, j]), np.einsum("ij,ij->i", normals[i], normals[j])
