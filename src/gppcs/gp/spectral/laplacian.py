"""Eigenpairs of the cloud's Laplace-Beltrami operator (paper, Eq. 6); large clouds are represented by landmarks."""

from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.blas import one_blas_thread
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import QUERIES_AT_ONCE, KdTree, limit_beside, nearest_in_tree
from gppcs.surface.fans import ANY_NORMAL, corners_of_fans
from gppcs.surface.local_surface import PLANE_NEIGHBOURS, SIN_MAX_SLOPE
from gppcs.surface.surface_variation import features_of_nearest

FAN_NEIGHBOURS = 30  # points that can be corners of a fan; with more, fans reach over gaps, with fewer they stay open
LIFTED_FROM = 8  # landmarks from which the value at another point is interpolated
ROUNDING = 1e-20  # squared sine of a turn at which points of a flat grid count as lying on one circle


class Eigenfunctions(NamedTuple):
    """Functions on the surface that are known at landmarks."""

    landmarks: Floats  # (n, 3)
    values: Floats  # (n, L)
    neighbours: int  # landmarks from which the value at a point is interpolated

    def at(self, points: Floats) -> Floats:
        """Interpolate by a partition of unity (Nasikun et al. 2018). Shapes: points (N, 3); returns (N, L)."""
        tree, lifted = KdTree.build(self.landmarks), np.empty((self.values.shape[1], len(points)))
        queries, values = np.ascontiguousarray(points.T), self.values[tree.order]
        on_ranges(_lift, len(points), *tree.arrays, values, self.neighbours, queries, lifted, minimum=QUERIES_AT_ONCE)
        return lifted.T


@one_blas_thread()
def eigenpairs(points: Floats, count: int, landmarks: Ints | None = None) -> tuple[Floats, Eigenfunctions]:
    """Compute the L lowest eigenpairs of the Laplace-Beltrami operator (paper, Eq. 6), with the surface of area 1.

    Eigenvalues, (L,), ascend from zero; those of the surface itself are smaller by its area. Eigenfunctions have a mean
    square of one over the surface. Large clouds, (N, 3), are represented by the points at indices, (n,): landmarks.
    """
    chosen = np.arange(len(points)) if landmarks is None else landmarks
    chosen = chosen[first_occurrences(points[chosen])]
    triangles = local_triangles(points[chosen])
    joined = np.bincount(triangles.ravel(), minlength=len(chosen)) > 0
    if 2 * np.count_nonzero(joined) < len(chosen):  # most points lie on lines
        operator, mass = _graph_laplacian(points[chosen])
        joined[:] = True
    else:
        chosen, triangles = chosen[joined], (np.cumsum(joined) - 1)[triangles]
        operator, mass = surface_laplacian(points[chosen], triangles)
    area = mass.sum()
    eigenvalues, functions = _lowest(operator, mass, min(count, len(chosen)))
    neighbours = 1 if landmarks is None and joined.all() else min(LIFTED_FROM, len(chosen))
    lifted = Eigenfunctions(points[chosen], functions * np.sqrt(area), neighbours)
    return np.maximum(eigenvalues * area, 0.0), lifted


def local_triangles(points: Floats) -> Ints:
    """Return the triangles, (T, 3), of Delaunay triangulations of each point's neighbours in its tangent plane.

    Where these agree, each triangle occurs three times. Shapes: points (N, 3), distinct.
    """
    tree = KdTree.build(points)
    normals = features_of_nearest(tree, PLANE_NEIGHBOURS).normals
    near, _ = tree.nearest_of(points, min(FAN_NEIGHBOURS + 1, len(points)))
    corners = corners_of_fans(points, normals, near, ANY_NORMAL, SIN_MAX_SLOPE, ROUNDING)
    points_with, slots = np.nonzero(corners[:, :, 0] >= 0)
    return np.column_stack([points_with, corners[points_with, slots]])


def surface_laplacian(points: Floats, triangles: Ints) -> tuple[scipy.sparse.csr_matrix, Floats]:
    """Return a third of the sums of linear finite elements, (N, N), and of areas, (N,), as triangles occur three times.

    The stiffness of a triangle of area A, whose edges are the vectors e_i opposite to its corners, is e_i . e_j / (4 A)
    (Dziuk 1988). Shapes: points (N, 3), triangles (T, 3).
    """
    edges = points[np.roll(triangles, 1, axis=1)] - points[np.roll(triangles, -1, axis=1)]
    inner = np.einsum("tic,tjc->tij", edges, edges)
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    areas = np.maximum(areas, 1e-6 * inner.max(axis=(1, 2)))  # without this, needles would be infinitely stiff
    stiffness = inner / (12 * areas[:, np.newaxis, np.newaxis])
    ends = np.repeat(triangles, 3, axis=1).ravel(), np.tile(triangles, 3).ravel()
    operator = scipy.sparse.csr_matrix((stiffness.ravel(), ends), shape=(len(points), len(points)))
    return operator, np.bincount(triangles.ravel(), np.repeat(areas, 3), len(points)) / 9


def _graph_laplacian(points: Floats) -> tuple[scipy.sparse.csr_matrix, Floats]:
    """Return the Laplacian, (N, N), of the nearest-neighbour graph with Gaussian weights, and equal masses, (N,)."""
    n = len(points)
    indices, squared = KdTree.build(points).nearest_of(points, min(9, n))
    scale = np.median(squared[:, -1]) or 1.0  # zero for a single point
    sources = np.repeat(np.arange(n), indices.shape[1])
    weights = scipy.sparse.csr_matrix((np.exp(-squared / scale).ravel(), (sources, indices.ravel())), shape=(n, n))
    weights = weights.maximum(weights.T)
    return scipy.sparse.csgraph.laplacian(weights), np.full(n, 1.0 / n)


def _lowest(operator: scipy.sparse.csr_matrix, mass: Floats, count: int) -> tuple[Floats, Floats]:
    """Solve L f = lambda M f for the `count` lowest pairs: values (count,) and M-orthonormal functions (N, count)."""
    if len(mass) <= max(400, 2 * count):  # a dense solver is as fast, and needs no start vector
        return scipy.linalg.eigh(operator.toarray(), np.diag(mass), subset_by_index=(0, count - 1))
    start = np.random.default_rng(0).standard_normal(len(mass))  # the same on every run
    values, functions = scipy.sparse.linalg.eigsh(
        operator.tocsc(), count, scipy.sparse.diags(mass).tocsc(), sigma=-0.01 / mass.sum(), v0=start
    )
    ascending = np.argsort(values)
    return values[ascending], functions[:, ascending]


@kernel(fastmath=False)
def _lift(begin, end, points, lower, upper, values, k, queries, lifted):
    """Fill `lifted`, (L, Q), at a range of queries, (3, Q), from the k nearest landmarks, by their values, (n, L)."""
    positions, squared = np.empty(k, dtype=np.int64), np.empty(k, dtype=np.float64)
    weights, sums = np.empty(k, dtype=np.float64), np.empty(len(lifted), dtype=np.float64)
    limit = np.inf
    for q in range(begin, end):
        x, y, z = queries[0, q], queries[1, q], queries[2, q]
        if q > begin:
            limit = limit_beside(squared[-1], x - queries[0, q - 1], y - queries[1, q - 1], z - queries[2, q - 1])
        nearest_in_tree(points, lower, upper, x, y, z, positions, squared, limit)
        # The radius is slightly larger, since landmarks that are all equally far would all have the weight zero.
        radius = 1.001 * np.sqrt(squared[-1])
        for slot in range(k):
            share = np.sqrt(squared[slot]) / radius if radius > 0.0 else 0.0
            weights[slot] = 1.0 - share * share * (3.0 - 2.0 * share)
        weights /= weights.sum()
        sums[:] = 0.0
        for slot in range(k):
            for r in range(len(sums)):
                sums[r] += weights[slot] * values[positions[slot], r]
        for r in range(len(sums)):
            lifted[r, q] = sums[r]
