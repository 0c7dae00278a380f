"""Surface variation and normals, from the covariance of each point's neighbourhood (paper, section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numba as nb
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.cloud import PointCloud
from gppcs.errors import ParameterError
from gppcs.kdtree import KdTree, nearest_in_tree
from gppcs.neighbourhood import ColumnGrid, first_occurrences, neighbourhood_radius


@dataclass(frozen=True)
class Features:
    """What the neighbourhood of each point says of the surface there.

    Attributes
    ----------
    surface_variation : (N,) array, float64
        lambda_0 / (lambda_0 + lambda_1 + lambda_2), from 0 (flat) to 1/3; 0 for fewer than three neighbours.
    normals : (N, 3) array, float64
        Unit eigenvectors of lambda_0, without a sign that means anything.
    neighbours : (N,) array, int32
        The number of points in the neighbourhood, the point itself counted.
    """

    surface_variation: NDArray[np.float64]
    normals: NDArray[np.float64]
    neighbours: NDArray[np.int32]

    @classmethod
    def empty(cls, n: int) -> Features:
        """Make room for the features of n points."""
        return cls(np.empty(n), np.empty((n, 3)), np.empty(n, dtype=np.int32))


def estimate_features(
    cloud: PointCloud | ArrayLike,
    neighbours: int = 25,
    search: Literal["radius", "nearest"] = "radius",
    tree: KdTree | None = None,
) -> Features:
    """Measure the surface variation and the normal of each point (paper, section 3.1).

    Parameters
    ----------
    cloud : PointCloud or (N, 3) array-like
    neighbours : int
        k, the number of points that a neighbourhood holds: about so many with `search` "radius", where all
        neighbourhoods are balls of the one radius that `neighbourhood_radius` gives; exactly so many, the point
        itself among them, with "nearest".
    tree : KdTree, optional
        The tree over the points, where it is there already and they are known to be without repeats.

    Raises
    ------
    InputError
        If the cloud is empty, misshapen or not finite.
    ParameterError
        If there is no such search.
    """
    points = PointCloud.of(cloud).usable("cloud")
    if search == "nearest":
        return features_of_nearest(tree or KdTree.build(points), neighbours)
    if search != "radius":
        raise ParameterError(f"expected search to be 'radius' or 'nearest', found {search!r}")
    distinct = points if tree else points[first_occurrences(points)]
    radius = neighbourhood_radius(distinct, tree or KdTree.build(distinct), neighbours)
    return features_in_radius(ColumnGrid.build(points, radius))


def features_in_radius(grid: ColumnGrid) -> Features:
    """Measure each point's neighbourhood of all points within the grid's radius (the paper's way)."""
    features = Features.empty(len(grid.order))
    columns = len(grid.starts) - 1
    with nb.parallel_chunksize(max(1, columns // 256)):
        _features_in_columns(
            grid.points, grid.order, grid.starts, grid.cells[1], grid.radius,
            features.surface_variation, features.normals, features.neighbours,
        )  # fmt: skip
    features.normals[:, grid.axes] = features.normals.copy()
    return features


@nb.njit(cache=True, parallel=True, nogil=True, fastmath={"nsz", "arcp", "contract", "reassoc"})
def _features_in_columns(points, order, starts, row_length, radius, variation, normals, neighbours):
    columns = len(starts) - 1
    squared_radius = radius * radius
    along = points[2]
    for c in nb.prange(columns):
        if starts[c] == starts[c + 1]:
            continue
        u, v = c // row_length, c % row_length
        low = np.empty(9, dtype=np.int64)
        high = np.empty(9, dtype=np.int64)
        last = np.empty(9, dtype=np.int64)
        runs = 0
        rows = columns // row_length
        for a in range(min(3, rows)):  # from the row before to that after, round the ends
            for b in range(min(3, row_length)):
                near = (u + a + rows - 1) % rows * row_length + (v + b + row_length - 1) % row_length
                if starts[near] < starts[near + 1]:
                    low[runs] = high[runs] = starts[near]
                    last[runs] = starts[near + 1]
                    runs += 1
        for i in range(starts[c], starts[c + 1]):
            x, y, z = points[0, i], points[1, i], points[2, i]
            n = sx = sy = sz = sxx = sxy = sxz = syy = syz = szz = 0.0
            for run in range(runs):
                while low[run] < last[run] and along[low[run]] < z - radius:
                    low[run] += 1
                while high[run] < last[run] and along[high[run]] <= z + radius:
                    high[run] += 1
                for j in range(low[run], high[run]):
                    dx, dy, dz = points[0, j] - x, points[1, j] - y, points[2, j] - z
                    inside = 1.0 if dx * dx + dy * dy + dz * dz <= squared_radius else 0.0
                    n += inside
                    sx += inside * dx
                    sy += inside * dy
                    sz += inside * dz
                    sxx += inside * dx * dx
                    sxy += inside * dx * dy
                    sxz += inside * dx * dz
                    syy += inside * dy * dy
                    syz += inside * dy * dz
                    szz += inside * dz * dz
            index = order[i]
            neighbours[index] = n
            variation[index] = flattest(
                sxx / n - (sx / n) ** 2, sxy / n - sx / n * sy / n, sxz / n - sx / n * sz / n,
                syy / n - (sy / n) ** 2, syz / n - sy / n * sz / n, szz / n - (sz / n) ** 2,
                normals[index],
            )  # fmt: skip


def features_of_nearest(tree: KdTree, k: int) -> Features:
    """Measure each point's neighbourhood of its k nearest points, itself among them."""
    features = Features.empty(len(tree.order))
    _features_in_tree(
        tree.points, tree.order, tree.low, tree.high, k,
        features.surface_variation, features.normals, features.neighbours,
    )  # fmt: skip
    return features


@nb.njit(cache=True, parallel=True, nogil=True)
def _features_in_tree(points, order, low, high, k, variation, normals, neighbours):
    k = min(k, points.shape[1])
    for i in nb.prange(points.shape[1]):
        found = np.empty(k, dtype=np.int64)
        squared = np.empty(k, dtype=np.float64)
        nearest_in_tree(points, low, high, points[0, i], points[1, i], points[2, i], found, squared)
        local = np.empty((3, k), dtype=np.float64)
        for axis in range(3):
            for slot in range(k):
                local[axis, slot] = points[axis, found[slot]] - points[axis, i]
            local[axis] -= local[axis].mean()
        index = order[i]
        neighbours[index] = k
        variation[index] = flattest(
            (local[0] * local[0]).mean(), (local[0] * local[1]).mean(), (local[0] * local[2]).mean(),
            (local[1] * local[1]).mean(), (local[1] * local[2]).mean(), (local[2] * local[2]).mean(),
            normals[index],
        )  # fmt: skip


@nb.njit(cache=True, fastmath=False)
def flattest(xx, xy, xz, yy, yz, zz, normal):
    """Return lambda_0 / trace of a symmetric 3 x 3 matrix, and put the eigenvector of lambda_0 into `normal`.

    Closed form (Smith 1961). The eigenvector is the longest cross product of two rows of C - lambda_0 I; where
    all three vanish, lambda_0 is repeated and any direction across the remaining one is an answer.
    """
    trace = xx + yy + zz
    normal[0], normal[1], normal[2] = 0.0, 0.0, 1.0
    if not trace > 0.0:
        return 0.0
    xx, xy, xz, yy, yz, zz = xx / trace, xy / trace, xz / trace, yy / trace, yz / trace, zz / trace
    off = xy * xy + xz * xz + yz * yz
    a, b, c = xx - 1 / 3, yy - 1 / 3, zz - 1 / 3
    p = np.sqrt((a * a + b * b + c * c + 2 * off) / 6)
    if p < 1e-12:
        return 1 / 3
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    angle = np.arccos(min(1.0, max(-1.0, determinant / (2 * p**3)))) / 3
    smallest = 1 / 3 + 2 * p * np.cos(angle + 2 * np.pi / 3)
    _null_vector(xx - smallest, xy, xz, yy - smallest, yz, zz - smallest, normal)
    return max(0.0, smallest)


@nb.njit(cache=True)
def _null_vector(xx, xy, xz, yy, yz, zz, normal):
    crosses = (
        (xy * yz - xz * yy, xz * xy - xx * yz, xx * yy - xy * xy),
        (xy * zz - xz * yz, xz * xz - xx * zz, xx * yz - xy * xz),
        (yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz),
    )
    longest = 1e-20
    for x, y, z in crosses:
        squared = x * x + y * y + z * z
        if squared > longest:
            longest = squared
            length = np.sqrt(squared)
            normal[0], normal[1], normal[2] = x / length, y / length, z / length
    if longest == 1e-20:
        # the matrix has rank one: its largest row is the one direction to stay across of
        x, y, z = xx, xy, xz
        if yy > xx and yy >= zz:
            x, y, z = xy, yy, yz
        elif zz > xx:
            x, y, z = xz, yz, zz
        if abs(x) <= abs(z) or abs(y) <= abs(z):
            x, y, z = (0.0, z, -y) if abs(x) <= abs(y) else (z, 0.0, -x)
        else:
            x, y, z = y, -x, 0.0
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0:
            normal[0], normal[1], normal[2] = x / length, y / length, z / length


@nb.njit(cache=True)
def tangents(x, y, z):
    """Return two unit vectors at right angles to a unit vector and each other."""
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        length = np.sqrt(y * y + z * z)
        u = 0.0, -z / length, y / length
    elif abs(y) <= abs(z):
        length = np.sqrt(x * x + z * z)
        u = z / length, 0.0, -x / length
    else:
        length = np.sqrt(x * x + y * y)
        u = -y / length, x / length, 0.0
    return u, (y * u[2] - z * u[1], z * u[0] - x * u[2], x * u[1] - y * u[0])
