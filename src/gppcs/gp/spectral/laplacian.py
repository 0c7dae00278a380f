"""Eigenpairs of the cloud's Laplace-Beltrami operator (paper, Eq. 6); large clouds are represented by landmarks."""

from __future__ import annotations

import numpy as np
import robust_laplacian
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from gppcs.engine.arrays import Floats
from gppcs.engine.blas import one_blas_thread
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.kdtree import KdTree, nearest_distances


@one_blas_thread()
def eigenpairs(points: Floats, count: int, landmarks: int = 4000, tree: KdTree | None = None) -> tuple[Floats, Floats]:
    """Compute the L lowest eigenpairs of the Laplace-Beltrami operator (paper, Eq. 6), with the surface of area 1.

    Eigenvalues, (L,), ascend from zero; those of the surface itself are smaller by its area. Eigenfunctions, (N, L),
    have a mean square of one over the surface. A cloud of more than `landmarks` points is represented by that many
    farthest points. The tufted Laplacian loses area where these are too irregular for their density; their number is
    then halved. Shapes: points (N, 3).
    """
    number = min(landmarks, len(points))
    while True:
        chosen, _ = farthest_points(points, number, tree) if number < len(points) else (np.arange(number), None)
        operator, mass, is_complete = surface_laplacian(points[chosen])
        if is_complete or number <= max(500, 2 * count):  # with fewer, halving their number does not help
            break
        number //= 2
    area = mass.sum()
    eigenvalues, functions = _lowest(operator, mass, min(count, number))
    functions = functions * np.sqrt(area)
    if number < len(points):
        functions = _lift(points[chosen], functions, points)
    return np.maximum(eigenvalues * area, 0.0), functions


def surface_laplacian(points: Floats) -> tuple[scipy.sparse.csr_matrix, Floats, bool]:
    """Return the tufted Laplacian (Sharp and Crane 2020), or of points on a line the neighbour graph's; mass (N,)."""
    size = np.ptp(points, axis=0).max()
    if len(points) < 4 or not size > 0:
        return *_graph_laplacian(points), True
    scaled = points / size  # the library has absolute thresholds, so it needs points of unit size
    try:
        operator, mass = robust_laplacian.point_cloud_laplacian(scaled, n_neighbors=min(30, len(points) - 1))
    except RuntimeError:  # the library found no triangles
        return *_graph_laplacian(points), True
    masses = mass.diagonal()
    if not (np.isfinite(operator.data).all() and np.isfinite(masses).all()):  # clusters are too far from each other
        return *_graph_laplacian(points), True
    is_complete = bool(np.median(masses) >= 0.75 * _disc_area(scaled))  # complete surfaces have 0.83 to 1.9
    masses = np.maximum(masses, 1e-6 * masses.mean())  # every point needs a positive area
    return operator, masses, is_complete


def _disc_area(points: Floats) -> float:
    """Estimate the area that a point represents from the spacing of the points, as a median over them."""
    k = min(16, len(points) - 1)
    return float(np.pi / k * np.median(nearest_distances(KdTree.build(points), k)) ** 2)


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


def _lift(landmarks: Floats, functions: Floats, points: Floats) -> Floats:
    """Interpolate functions, (landmarks, L), at points, (N, 3), by a partition of unity (Nasikun et al. 2018)."""
    nearest, squared = KdTree.build(landmarks).nearest_of(points, min(8, len(landmarks)))
    # The radius is slightly larger, since landmarks that are all equally far would all have the weight zero.
    x = np.sqrt(squared) / (1.001 * np.sqrt(squared[:, -1:]))
    weights = 1.0 - x * x * (3.0 - 2.0 * x)
    weights /= weights.sum(axis=1, keepdims=True)
    lifted = np.zeros((len(points), functions.shape[1]))
    for slot in range(nearest.shape[1]):
        lifted += weights[:, slot, None] * functions[nearest[:, slot]]
    return lifted
