"""Eigenpairs of the cloud's Laplace-Beltrami operator (paper, Eq. 6); large clouds are represented by landmarks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import robust_laplacian
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from gppcs.engine.blas import one_blas_thread
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.kdtree import KdTree, nearest_distances

LEAST_AREA_SHARE = 0.75  # least lumped area, relative to that estimated from spacing; whole surfaces have 0.83 to 1.9
FEWEST_LANDMARKS = 500  # with fewer landmarks, halving their number again does not help
LIFTING_LANDMARKS = 8  # nearest landmarks from which a function is interpolated at a point
DENSE_SIZE = 400  # up to this many landmarks, a dense eigensolver is as fast, and needs no start vector


@dataclass(frozen=True)
class Eigenpairs:
    """The lowest eigenpairs of the Laplace-Beltrami operator, with the surface scaled to area 1.

    Eigenvalues, (L,), ascend from zero; divide by the area of the surface for its own. Eigenfunctions, (N, L), have a
    mean square of one over the surface.
    """

    eigenvalues: NDArray[np.float64]
    eigenfunctions: NDArray[np.float64]


@one_blas_thread()
def eigenpairs(
    points: NDArray[np.float64], count: int, landmarks: int = 4000, tree: KdTree | None = None
) -> Eigenpairs:
    """Compute the L lowest eigenpairs of the Laplace-Beltrami operator (paper, Eq. 6) at all points.

    A cloud of more than `landmarks` points is represented by that many farthest points. The functions found there are
    interpolated at all points by a smooth partition of unity (Nasikun et al. 2018). The tufted Laplacian (Sharp and
    Crane 2020) loses area where points are too irregular for their density. Its lumped area is therefore compared with
    an estimate from the spacing of the points, and the landmarks are halved until the two agree. Shapes: points (N, 3).
    """
    number = min(landmarks, len(points))
    while True:
        chosen, _ = farthest_points(points, number, tree) if number < len(points) else (np.arange(number), None)
        operator, mass, is_whole = surface_laplacian(points[chosen])
        if is_whole or number <= max(FEWEST_LANDMARKS, 2 * count):
            break
        number //= 2
    area = mass.sum()
    eigenvalues, functions = _lowest(operator, mass, min(count, number))
    functions = functions * np.sqrt(area)
    if number < len(points):
        functions = _lift(points[chosen], functions, points)
    return Eigenpairs(np.maximum(eigenvalues * area, 0.0), functions)


def surface_laplacian(
    points: NDArray[np.float64],
) -> tuple[scipy.sparse.csr_matrix, NDArray[np.float64], bool]:
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
    is_whole = bool(np.median(masses) >= LEAST_AREA_SHARE * _disc_area(scaled))
    masses = np.maximum(masses, 1e-6 * masses.mean())  # every point needs a positive area
    return operator, masses, is_whole


def _disc_area(points: NDArray[np.float64]) -> float:
    """Estimate the area that a point represents from the spacing of the points, as a median over them."""
    k = min(16, len(points) - 1)
    return float(np.pi / k * np.median(nearest_distances(KdTree.build(points), k)) ** 2)


def _graph_laplacian(points: NDArray[np.float64]) -> tuple[scipy.sparse.csr_matrix, NDArray[np.float64]]:
    """Return the Laplacian, (N, N), of the nearest-neighbour graph with Gaussian weights, and equal masses, (N,)."""
    n = len(points)
    indices, squared = KdTree.build(points).nearest_of(points, min(9, n))
    scale = np.median(squared[:, -1]) or 1.0  # zero for a single point
    rows = np.repeat(np.arange(n), indices.shape[1])
    weights = scipy.sparse.csr_matrix((np.exp(-squared / scale).ravel(), (rows, indices.ravel())), shape=(n, n))
    weights = weights.maximum(weights.T)
    return scipy.sparse.csgraph.laplacian(weights), np.full(n, 1.0 / n)


def _lowest(
    operator: scipy.sparse.csr_matrix, mass: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Solve L f = lambda M f for the `count` lowest pairs: values (count,) and M-orthonormal functions (N, count)."""
    if len(mass) <= max(DENSE_SIZE, 2 * count):
        return scipy.linalg.eigh(operator.toarray(), np.diag(mass), subset_by_index=(0, count - 1))
    start = np.random.default_rng(0).standard_normal(len(mass))  # the same on every run
    values, functions = scipy.sparse.linalg.eigsh(
        operator.tocsc(), count, scipy.sparse.diags(mass).tocsc(), sigma=-0.01 / mass.sum(), v0=start
    )
    ascending = np.argsort(values)
    return values[ascending], functions[:, ascending]


def _lift(
    landmarks: NDArray[np.float64], functions: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate functions, (landmarks, L), from landmarks at points, (N, 3); return (N, L).

    The weight of a landmark at distance x is 1 - 3 x^2 + 2 x^3, and weights are divided by their sum. Distances are
    relative to slightly more than that of the farthest landmark used.
    """
    found, squared = KdTree.build(landmarks).nearest_of(points, min(LIFTING_LANDMARKS, len(landmarks)))
    # The reach is slightly longer, since landmarks that are all equally far would all have the weight zero.
    share = np.sqrt(squared) / (1.001 * np.sqrt(squared[:, -1:]))
    weights = 1.0 - share * share * (3.0 - 2.0 * share)
    weights /= weights.sum(axis=1, keepdims=True)
    lifted = np.zeros((len(points), functions.shape[1]))
    for slot in range(found.shape[1]):
        lifted += weights[:, slot, None] * functions[found[:, slot]]
    return lifted
