"""Normals from quadrics fitted to the cloud. Signs agree between neighbours, and closed pieces point outward."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import CloudLike, PointCloud, usable
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.errors import InputError, whole_number
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs.spatial.scaling import Frame, normalised
from gppcs.surface.noise import NEIGHBOURS, SHEETS, NoiseLayer, across, feet_of, layer_of, two_sheets
from gppcs.surface.quadrics import TWO_PEAKS, fit_quadrics

CLOSE = 16  # Points of the fits that find signs: fewer than 30, as thin parts matter more there than noise.
SHARP = 18  # Points of the fits where there is no noise: fewer keep edges and thin parts, more even out roughness.
NARROW = 8  # Points of the fits where wider ones mix two sheets, and do not see both.
ACROSS = 40  # Points of the fits that see both of two near sheets.
CLEARNESS = 4.0  # A vote falls to 1 / e for each quarter of doubt, which is 0 in a plane and up to 2 across it.
EDGES = 8  # Nearest neighbours to which a sign is passed. Farther ones lie on the other side of thin parts.


def estimate_normals(
    cloud: CloudLike, at: CloudLike | None = None, neighbours: int | None = None
) -> NDArray[np.float64]:
    """Estimate the unit normals of the surface that a cloud lies on, with signs.

    At each point the quadric z = a + b u + c v + d u^2 + e u v + f v^2 is fitted to the nearest points of the cloud,
    with Gaussian weights. The coordinates u and v lie in the plane fitted to the same points. The quadric's gradient
    yields the normal (Cazals and Pouget 2005).

    All pairs of neighbours vote on whether their signs agree, clearly along the surface and hardly across it, where
    the step may lead to another sheet. Points with clear votes join first; then their pieces join by the sums of their
    votes. Signs can be wrong on parts that are about as thin as the distance between points. A connected piece points
    outward if it is closed. An open piece points away from the middle of the cloud, to the side that bulges, or, if it
    is flat, up (+z). This is a convention, since the points do not show which side is outside.

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like or object that `PointCloud.from_object` takes
        Exact repeats of a point count once.
    at : PointCloud, (M, 3) array-like or object that `PointCloud.from_object` takes, optional
        Places on the surface where normals are wanted; by default the points themselves.
    neighbours : int, optional
        Number of points to which each quadric is fitted; with fewer than 6, the normal is the plane's. By default 18
        where no noise is found, so that edges and thin parts stay sharp. Otherwise 30, doubled up to 120 while the
        points' distance from their quadrics exceeds a quarter of the neighbourhoods' radius. With 60 or more, signs
        are passed among the projections of the points onto quadrics of half as many.

    Returns
    -------
    (M, 3) array, float64
        Unit normals, one for each place.

    Raises
    ------
    InputError
        If the cloud or the places are empty, have a wrong shape or are not finite, or if a place is extremely far
        from the cloud.
    ParameterError
        If `neighbours` is less than 3.

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
    cloud = PointCloud.from_object(cloud)
    points = usable(cloud, "cloud")
    queries = None if at is None else usable(at, "cloud of places")
    points, frame = normalised(points, cloud.units)
    tree = KdTree.build(points[first_occurrences(points)])
    queries = points if queries is None else _near(queries, frame)
    neighbours = neighbours or _points_of_fits(tree)
    themselves = at is None and len(tree.order) == len(points)
    of_places = tree if themselves else KdTree.build(queries)
    normals = np.empty((len(queries), 3))
    normals[of_places.order] = fit_quadrics(tree, of_places, neighbours).normals.T
    if themselves and neighbours < 2 * NEIGHBOURS:
        signed = _oriented(tree, None)
    else:
        signed = _signed_nearby(tree, queries, neighbours)
    return with_signs_of(normals, signed)


def normals_of(
    tree: KdTree, near: Ints, noisy: bool, sheets: bool = False, when_fitted: Callable[[], object] | None = None
) -> Floats:
    """Estimate normals, (N, 3), at the points of a tree by their neighbours, (N, k), or those on their sheet of two.

    If there is none, a function is called before the signs are found, which takes one thread.
    """
    near = np.ascontiguousarray(near[:, :EDGES])
    if sheets:
        return _oriented(tree, None, near, NARROW, when_fitted)
    neighbours, _ = _across_noise(tree)
    if neighbours < 2 * NEIGHBOURS and not noisy:
        return _oriented(tree, None, near, SHARP, when_fitted)
    normals = np.ascontiguousarray(fit_quadrics(tree, tree, neighbours).normals.T)
    if neighbours < 2 * NEIGHBOURS:
        return with_signs_of(normals, _oriented(tree, None, near))
    return with_signs_of(normals, _signed_nearby(tree, np.ascontiguousarray(tree.points.T), neighbours))


def with_signs(tree: KdTree, near: Ints, normals: Floats) -> Floats:
    """Give normals, (N, 3), of the points of a tree signs that agree between their neighbours, (N, EDGES)."""
    return with_signs_of(normals, _oriented(tree, None, near))


def _points_of_fits(tree: KdTree) -> int:
    """Return to how many points quadrics are fitted: as few as the noise of the points of a tree allows."""
    neighbours, layer = _across_noise(tree)
    if neighbours == NEIGHBOURS and layer.is_detail(layer_of(tree, 2 * NEIGHBOURS)):
        return SHARP
    return neighbours


def _across_noise(tree: KdTree) -> tuple[int, NoiseLayer]:
    """Return the points of fits across the noise; quadrics of still more points cut off detail and take long."""
    neighbours, layer = across(partial(layer_of, tree), 4 * NEIGHBOURS)
    return (SHARP if neighbours > NEIGHBOURS and two_sheets(tree) else neighbours), layer


def with_signs_of(normals: Floats, signed: Floats) -> Floats:
    """Give normals, (M, 3), the signs of others, in place; return them."""
    normals[np.einsum("ij,ij->i", normals, signed) < 0] *= -1
    return normals


def _signed_nearby(tree: KdTree, queries: Floats, neighbours: int, n_guides: int = 1_000_000) -> Floats:
    """Return normals with signs, (M, 3), near places, (M, 3), on the surface of the points of a tree."""
    widened = max(1, neighbours // NEIGHBOURS)
    every = widened * -(-tree.points.shape[1] // n_guides)  # more would only take time and memory
    guides = np.concatenate([queries, tree.points.T[::every]])  # in tree order, so they are evenly spread
    if widened > 1:
        guides = feet_of(tree, guides, neighbours // 2)
    guide_tree = KdTree.build(guides[first_occurrences(guides)])
    normals = _oriented(guide_tree, (tree, neighbours) if widened > 1 else None)
    return normals[guide_tree.nearest_of(guides[: len(queries)], 1)[0][:, 0]]


def _near(queries: Floats, frame: Frame) -> Floats:
    """Return places, (M, 3), in the frame of a normalised cloud; raise an error if one is far from the cloud."""
    with np.errstate(over="ignore"):
        near = frame.near(queries)
    farthest = 1e6  # in sizes of the cloud; beyond, rounding hides its shape
    if len(far := np.flatnonzero(np.abs(near).max(axis=1) > farthest)):
        raise InputError(
            f"expected places on the surface of the cloud, found {len(far)} that are farther from it than "
            f"{farthest:g} times its size, the first at index {far[0]}: use the same unit and origin for both"
        )
    return near


def _oriented(
    tree: KdTree,
    fits: tuple[KdTree, int] | None,
    near: Ints | None = None,
    close: int = CLOSE,
    when_fitted: Callable[[], object] | None = None,
) -> Floats:
    """Return signed normals, (N, 3), of the points of a tree, fitted to `close` of them or as `fits` says."""
    points = np.ascontiguousarray(tree.points.T)
    fitted = fit_quadrics(tree, tree, close)
    normals, radii = fitted.normals, fitted.radii
    if fits:
        normals = fit_quadrics(fits[0], tree, fits[1]).normals
    elif close == NARROW:
        across = fit_quadrics(tree, tree, ACROSS, sheets=TWO_PEAKS)
        if across.two_sheets.mean() > SHEETS:
            normals = np.where(across.two_sheets, across.normals, normals)
    normals = np.ascontiguousarray(normals.T)
    if near is None:
        near, _ = nearest_others(tree, min(EDGES, len(points) - 1))
    areas = radii**2
    votes = np.empty(near.shape)
    on_ranges(_vote, len(points), points, normals, near, votes, minimum=1024)
    if when_fitted:
        when_fitted()
    cast = np.flatnonzero(votes)
    pairs = np.array([cast // near.shape[1], near.ravel()[cast]])
    pieces, signs = signs_by_votes(len(points), pairs, votes.ravel()[cast])
    normals *= signs[:, None]
    normals *= _outward(points, normals, areas, pieces)[pieces, None]
    oriented = np.empty_like(normals)
    oriented[tree.order] = normals
    return oriented


def signs_by_votes(n: int, pairs: Ints, votes: Floats) -> tuple[Ints, Floats]:
    """Return the piece and the sign of each of n, so that pairs, (2, p), agree where their votes, (p,), are positive.

    In each round, each piece joins the one with which its votes, summed over all pairs, are clearest (Borůvka 1926).
    So one wrong vote turns nothing where others are right, as between the sheets of a thin part.
    """
    pieces, signs = np.arange(n), np.ones(n)
    while len(votes):
        piece, sign = np.arange(n), np.ones(n)
        _join_by_votes(pairs, votes, np.full(n, -1), piece, sign)
        signs *= sign[pieces]
        pieces = piece[pieces]
        pairs, votes = _summed(pairs, votes, piece, sign)
    return pieces, signs


def _outward(points: Floats, normals: Floats, areas: Floats, pieces: Ints) -> Floats:
    """Return for each piece, by its number, 1, or -1 if it must be turned: the sign of the flux of p - c through it."""
    size = np.bincount(pieces, areas)
    size[size == 0] = 1.0  # these numbers belong to no piece
    middle = np.stack([np.bincount(pieces, areas * axis) for axis in points.T], axis=1) / size[:, None]
    radius = np.sqrt(np.bincount(pieces, areas * ((points - middle[pieces]) ** 2).sum(axis=1)) / size)
    towards = np.average(points, axis=0, weights=areas) - middle
    distance = np.linalg.norm(towards, axis=1)
    towards *= np.divide(radius, distance, out=np.ones_like(radius), where=distance > radius)[:, None]
    up = np.array([0.01, 0.03, 0.1])  # flat pieces point to +z; the tilt also decides upright faces
    # The flux of a closed piece is three times its volume, wherever c lies.
    centre = middle + towards - radius[:, None] * up
    flux = np.bincount(pieces, areas * np.einsum("ij,ij->i", points - centre[pieces], normals))
    return np.where(flux < 0, -1.0, 1.0)


@kernel
def _vote(begin, end, points, normals, near, votes):
    """Fill the votes, (N, edges), that signs agree, negative that they differ: clear along the surface, each once."""
    for i in range(begin, end):
        for slot in range(near.shape[1]):
            j, is_second = near[i, slot], False
            if j < i:
                for other in range(near.shape[1]):
                    is_second = is_second or near[j, other] == i
            fit, off = _fit_of_normals(points, normals, i, j)
            vote = np.copysign(np.exp(-CLEARNESS * (1.0 - abs(fit) + 0.5 * off)), fit)
            votes[i, slot] = 0.0 if is_second else vote


@kernel(allocates=False)
def _fit_of_normals(points, normals, i, j):
    """Return how well two normals agree, one mirrored in the plane halfway (Koenig and Gumhold 2009), and how far off.

    The agreement is from -1 to 1; the other number is the sum of the sines of the step between them off their planes.
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


@kernel(allocates=False)
def _join_by_votes(pairs, votes, clearest, parents, signs):
    """Join each of n by the pair of its clearest vote; `parents` become pieces, `signs` are relative to these, (n,)."""
    for e in range(len(votes)):
        for side in range(2):
            v = pairs[side, e]
            if clearest[v] < 0 or abs(votes[e]) > abs(votes[clearest[v]]):
                clearest[v] = e
    for e in clearest:
        if e >= 0:
            a, sign_a = _root(parents, signs, pairs[0, e])
            b, sign_b = _root(parents, signs, pairs[1, e])
            if a != b:
                parents[b] = a
                signs[b] = sign_a * sign_b * (1.0 if votes[e] >= 0.0 else -1.0)
    for i in range(len(parents)):
        parents[i], signs[i] = _root(parents, signs, i)


@kernel
def _summed(pairs, votes, pieces, signs):
    """Return pairs of pieces, (2, p), and the sums of the votes between them, (p,), but not those within a piece."""
    n = len(pieces)
    ends = np.zeros(n + 1, dtype=np.int64)
    for e in range(len(votes)):
        a, b = pieces[pairs[0, e]], pieces[pairs[1, e]]
        ends[min(a, b) + 1] += a != b
    for a in range(n):
        ends[a + 1] += ends[a]
    joined, sums, between = np.empty(ends[n], dtype=np.int64), np.empty(ends[n]), np.empty((2, ends[n]), dtype=np.int64)
    for e in range(len(votes)):
        p, q = pairs[0, e], pairs[1, e]
        a, b = min(pieces[p], pieces[q]), max(pieces[p], pieces[q])
        if a != b:
            joined[ends[a]], sums[ends[a]] = b, votes[e] * signs[p] * signs[q]
            ends[a] += 1
    count, slots = 0, np.full(n, -1)
    for a in range(n):
        first = count
        for entry in range(ends[a - 1] if a else 0, ends[a]):
            b = joined[entry]
            if slots[b] >= first:
                sums[slots[b]] += sums[entry]
            else:
                slots[b], sums[count] = count, sums[entry]
                between[0, count], between[1, count] = a, b
                count += 1
    return between[:, :count].copy(), sums[:count]


@kernel
def _root(parents, signs, i):
    """Return the root of point i and its sign relative to the root; halve the path there for the next call."""
    sign = 1.0
    while parents[i] != i:
        signs[i] *= signs[parents[i]]
        parents[i] = parents[parents[i]]
        sign *= signs[i]
        i = parents[i]
    return i, sign
