"""Normals from quadrics fitted to the cloud, signed so that neighbours agree and pieces point outward."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import whole_number
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import normalised
from gppcs.surface.noise import NEIGHBOURS, neighbours_across_noise, projections
from gppcs.surface.quadrics import fit_quadrics

CLOSE = 16  # points of the fits by which signs are found: fewer, since thin parts matter more there than noise
EDGES = 8  # nearest neighbours that signs are passed to; farther ones lie on the other side of thin parts
MOST = 1_000_000  # points of the cloud that take part in that
UP = np.array([0.01, 0.03, 0.1])  # how flat pieces are turned; never quite along a face that stands upright


def estimate_normals(
    cloud: PointCloud | ArrayLike, at: PointCloud | ArrayLike | None = None, neighbours: int | None = None
) -> NDArray[np.float64]:
    """Estimate the unit normals of the surface that a cloud lies on, with signs.

    At each place z = a + b u + c v + d u^2 + e u v + f v^2 is fitted to the nearest points of the cloud, over the
    plane fitted to the same points and with Gaussian weights; its gradient gives the normal (Cazals and Pouget 2005).
    Signs are passed from neighbour to neighbour along a minimum spanning tree (Hoppe et al. 1992), over steps out of
    the tangent plane last, since these lead to another sheet. Where parts are about as thin as the points are apart,
    signs can go wrong. Each connected piece as a whole points outward if it is closed. If it is open it points away
    from the middle of the cloud, to the side that bulges, or, if flat, up (+z): a convention, since the points do not
    say which side is outside.

    Parameters
    ----------
    cloud : PointCloud or (N, 3) array-like
        Points that repeat another exactly count once.
    at : PointCloud or (M, 3) array-like, optional
        Places on the surface at which the normals are wanted, the points themselves by default.
    neighbours : int, optional
        The number of points that each quadric is fitted to; with fewer than 6 the normal is that of the plane. By
        default 30; or 60 or 120, where points lie off their quadrics by more than a quarter of the neighbourhoods'
        radius. With 60 or more, signs are passed on among feet of the points on quadrics of half as many.

    Returns
    -------
    (M, 3) array, float64

    Raises
    ------
    InputError
        If the cloud or the places are empty, misshapen or not finite.
    ParameterError
        If there are fewer than 3 neighbours.

    Examples
    --------
    >>> import gppcs
    >>> ball = gppcs.sample("sphere", n_points=1000)
    >>> normals = gppcs.estimate_normals(ball)
    >>> bool(((normals * ball.normals()).sum(axis=1) > 0.99).all())
    True
    """
    if neighbours is not None:
        neighbours = whole_number("the number of neighbours", neighbours, 3)
    points = PointCloud.of(cloud).usable("cloud")
    places = points if at is None else PointCloud.of(at).usable("cloud of places")
    points, corner, exponent = normalised(points)
    tree = KdTree.build(points[first_occurrences(points)])
    places = np.ldexp(places - corner, -exponent)
    neighbours = neighbours or neighbours_across_noise(tree)[0]
    of_places = KdTree.build(places)
    normals = np.empty((len(places), 3))
    normals[of_places.order] = fit_quadrics(tree, of_places, neighbours).normals.T
    widened = max(1, neighbours // NEIGHBOURS)
    every = widened * -(-tree.points.shape[1] // MOST)
    guides = np.concatenate([places, tree.points.T[::every]])  # every n-th in tree order: evenly spread
    if widened > 1:
        guides = _feet(tree, guides, neighbours // 2)
    guide_tree = KdTree.build(guides[first_occurrences(guides)])
    guide_normals = _oriented(guide_tree, (tree, neighbours) if widened > 1 else None)
    nearest = guide_tree.nearest_of(guides[: len(places)], 1)[0][:, 0]
    opposed = np.einsum("ij,ij->i", normals, guide_normals[nearest]) < 0
    normals[opposed] *= -1
    return normals


def _feet(tree: KdTree, places: NDArray[np.float64], neighbours: int) -> NDArray[np.float64]:
    """Return the feet of places, (m, 3), on the quadrics fitted to so many points of a tree around them."""
    projected, _ = projections(tree, KdTree.build(places), neighbours)
    feet = np.empty_like(places)
    feet[projected.order] = projected.points.T
    return feet


def _oriented(tree: KdTree, fits: tuple[KdTree, int] | None) -> NDArray[np.float64]:
    """Return the normals of all points of a tree, (N, 3), in the order of its input, with signs.

    Quadrics are fitted to so many points of another tree, if one is given, or else to a few of the same.
    """
    points = np.ascontiguousarray(tree.points.T)
    _, normals, reaches = fit_quadrics(tree, tree, CLOSE)
    if fits:
        normals = fit_quadrics(fits[0], tree, fits[1]).normals
    normals = np.ascontiguousarray(normals.T)
    near, _ = tree.neighbours(min(EDGES, len(points) - 1))
    areas = reaches**2
    edges = np.argsort(_doubts(points, normals, near), axis=None, kind="stable")
    pieces, signs = _signs(edges, points, normals, near)
    normals *= signs[:, None]
    normals *= _outward(points, normals, areas, pieces)[pieces, None]
    oriented = np.empty_like(normals)
    oriented[tree.order] = normals
    return oriented


def _outward(
    points: NDArray[np.float64], normals: NDArray[np.float64], areas: NDArray[np.float64], pieces: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return for each piece 1, or -1 if it has to be turned.

    That is the sign of the flux of p - c through the piece: by the divergence theorem three times its volume if it
    is closed, wherever c lies. For open pieces c decides: it lies in their middle, moved towards that of the whole,
    by no more than the size of the piece, and a little down.
    """
    size = np.bincount(pieces, areas)
    size[size == 0] = 1.0  # numbers that no piece has
    middle = np.stack([np.bincount(pieces, areas * axis) for axis in points.T], axis=1) / size[:, None]
    radius = np.sqrt(np.bincount(pieces, areas * ((points - middle[pieces]) ** 2).sum(axis=1)) / size)
    towards = np.average(points, axis=0, weights=areas) - middle
    distance = np.linalg.norm(towards, axis=1)
    towards *= np.divide(radius, distance, out=np.ones_like(radius), where=distance > radius)[:, None]
    centre = middle + towards - radius[:, None] * UP
    flux = np.bincount(pieces, areas * np.einsum("ij,ij->i", points - centre[pieces], normals))
    return np.where(flux < 0, -1.0, 1.0)


@nb.njit(cache=True, parallel=True, nogil=True)
def _doubts(points, normals, near):
    """Return how doubtful it is to pass the sign on from each point to each neighbour, (N, edges).

    That is little where the normals fit each other but for the sign, and the step between the points stays in the
    surface; points of another sheet, and noise, lie off it.
    """
    doubts = np.empty(near.shape, dtype=np.float32)
    for i in nb.prange(len(points)):
        for slot in range(near.shape[1]):
            fit, off = _fit_of_normals(points, normals, i, near[i, slot])
            doubts[i, slot] = 1.0 - abs(fit) + 0.5 * off
    return doubts


@nb.njit(cache=True, inline="always")
def _fit_of_normals(points, normals, i, j):
    """Return how well one normal fits the other, from -1 to 1, and how far the step between the points is off.

    On an arc, the normal at one end is that at the other mirrored in the plane halfway, so the former is the cosine
    between the one and the mirrored other; unlike that between the two it sees round an edge (a criterion that Koenig
    and Gumhold 2009 discuss).
    The latter is the sum of the sines between the step and the tangent planes.
    """
    squared = cosine = rise_i = rise_j = 0.0
    for axis in range(3):
        step = points[j, axis] - points[i, axis]
        squared += step * step
        cosine += normals[i, axis] * normals[j, axis]
        rise_i += step * normals[i, axis]
        rise_j += step * normals[j, axis]
    if squared == 0.0:
        return cosine, 0.0
    return cosine - 2.0 * rise_i * rise_j / squared, (abs(rise_i) + abs(rise_j)) / np.sqrt(squared)


@nb.njit(cache=True, nogil=True)
def _signs(edges, points, normals, near):
    """Join the points by edges in the order given (Kruskal 1956); return the piece and the sign of each, both (N,).

    A set of joined points is a tree of parents, in which each knows its sign relative to its parent.
    """
    parents = np.arange(len(points))
    signs = np.ones(len(points), dtype=np.int8)
    for edge in edges:
        i = edge // near.shape[1]
        j = near[i, edge % near.shape[1]]
        a, sign_a = _root(parents, signs, i)
        b, sign_b = _root(parents, signs, j)
        if a != b:
            fit, _ = _fit_of_normals(points, normals, i, j)
            parents[b] = a
            signs[b] = sign_a * sign_b * (1 if fit >= 0.0 else -1)
    for i in range(len(points)):
        parents[i], signs[i] = _root(parents, signs, i)
    return parents, signs


@nb.njit(cache=True)
def _root(parents, signs, i):
    """Return the root of a point and its sign relative to that, and halve the way there for the next time."""
    sign = 1
    while parents[i] != i:
        signs[i] *= signs[parents[i]]
        parents[i] = parents[parents[i]]
        sign *= signs[i]
        i = parents[i]
    return i, sign
