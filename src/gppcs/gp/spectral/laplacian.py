"""Eigenpairs of the cloud's Laplace-Beltrami operator (paper, Eq. 6), on landmarks where the cloud is large."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
import robust_laplacian
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.kdtree import KdTree, nearest_in_tree
from gppcs.spatial.spacing import nearest_distances

LEAST_AREA_SHARE = 0.75  # of the area that the spacing tells; whole surfaces measure .83 to 1.9
FEWEST_LANDMARKS = 500  # below this, halving the landmarks helps no more
LIFTING_LANDMARKS = 8  # nearest landmarks whose partition of unity carries a function to a point
DENSE_SIZE = 400  # up to this many landmarks a dense eigensolver is as fast and needs no start


@dataclass(frozen=True)
class Eigenpairs:
    """The lowest eigenvalues and eigenfunctions of the Laplace-Beltrami operator of a surface of unit area.

    Attributes
    ----------
    eigenvalues : (L,) array, float64
        Ascending, the first zero; those of the cloud as it is are these divided by its area.
    eigenfunctions : (N, L) array, float64
        Values at the points; their squares have mean one over the surface.
    """

    eigenvalues: NDArray[np.float64]
    eigenfunctions: NDArray[np.float64]


def eigenpairs(
    points: NDArray[np.float64], count: int, landmarks: int = 4000, tree: KdTree | None = None
) -> Eigenpairs:
    """Compute the `count` lowest eigenpairs at all points.

    Clouds of more than `landmarks` points are represented by so many farthest points; the functions found there
    are carried to all points by a smooth partition of unity (Nasikun et al. 2018). The tufted Laplacian
    (Sharp and Crane 2020) loses area where points lie too irregularly for their density: its lumped area is
    compared with what the spacing tells, and the landmarks are halved until it agrees.

    Parameters
    ----------
    points : (N, 3) array
        Without repeats.
    count : int
        L; at most the number of landmarks, the pairs beyond do not exist and are left out.
    tree : KdTree, optional
        The tree over `points`, where it is there already.
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
    """Return the Laplacian (N, N), positive semi-definite, the lumped mass (N,), and whether the area is whole.

    Points that span no surface (on a line, or fewer than four) get the Laplacian of their neighbourhood graph.
    """
    size = np.ptp(points, axis=0).max()
    if len(points) < 4 or not size > 0:
        return *_graph_laplacian(points), True
    scaled = points / size  # mollification is relative to the edges, but the library's guards are not
    try:
        operator, mass = robust_laplacian.point_cloud_laplacian(scaled, n_neighbors=min(30, len(points) - 1))
    except RuntimeError:  # its triangulation came out empty
        return *_graph_laplacian(points), True
    masses = mass.diagonal()
    is_whole = bool(np.median(masses) >= LEAST_AREA_SHARE * _disc_area(scaled))
    masses = np.maximum(masses, 1e-6 * masses.mean())  # so that no point is without area
    return operator, masses, is_whole


def _disc_area(points: NDArray[np.float64]) -> float:
    """Return the area of a point's share of the surface that its spacing tells: the median over the points."""
    k = min(16, len(points) - 1)
    return float(np.pi / k * np.median(nearest_distances(KdTree.build(points), k)) ** 2)


def _graph_laplacian(points: NDArray[np.float64]) -> tuple[scipy.sparse.csr_matrix, NDArray[np.float64]]:
    """Return the Laplacian of the graph of nearest neighbours, with Gaussian weights, and uniform mass."""
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
    """Solve L f = lambda M f for the lowest pairs, M-orthonormal."""
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
    """Carry functions from landmarks to points, by weights 1 - 3 x^2 + 2 x^3 of the distance that add up to one.

    The distance x is relative to that of the farthest of the landmarks used, and a little.
    """
    tree = KdTree.build(landmarks)
    lifted = np.empty((len(points), functions.shape[1]), dtype=np.float64)
    count = min(LIFTING_LANDMARKS, len(landmarks))
    _weigh_nearest(tree.points, tree.low, tree.high, functions[tree.order], points, count, lifted)
    return lifted


@nb.njit(cache=True, parallel=True, nogil=True)
def _weigh_nearest(landmarks, low, high, functions, points, count, lifted):
    for i in nb.prange(len(points)):
        found = np.empty(count, dtype=np.int64)
        squared = np.empty(count, dtype=np.float64)
        x, y, z = points[i]
        nearest_in_tree(landmarks, low, high, x, y, z, found, squared)
        reach = 1.001 * np.sqrt(squared[-1])  # so that landmarks that are all equally far have weight
        total = 0.0
        lifted[i] = 0.0
        for slot in range(count):
            share = np.sqrt(squared[slot]) / reach
            weight = 1.0 - share * share * (3.0 - 2.0 * share)
            total += weight
            for f in range(functions.shape[1]):
                lifted[i, f] += weight * functions[found[slot], f]
        for f in range(functions.shape[1]):
            lifted[i, f] /= total
