"""The default method's selection: from few points to many, each stage at the scale of its own target spacing.

A stage chooses until twice as many points are there as before. Its field is that of its own spacing, so the first
points are placed as if no more were to come, and every prefix of the result is a simplification of its size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.cells import greatest_in_cells
from gppcs.features import Features, features_in_radius, features_of_nearest, variation_in_radius
from gppcs.gradation import graded
from gppcs.kdtree import KdTree
from gppcs.local_field import LocalField
from gppcs.local_greedy import extend
from gppcs.stages import Stages

FIRST = 64  # points of the first stage at most; it costs as little as any
FEWEST = 3  # candidates for each point wanted, below which there is nothing to choose from
MANY = 3  # times as many candidates as there are cells to the square of the target spacing: more than a surface has
FEW = 16  # points of a neighbourhood where candidates are not thinned; a ball might hold any number of them
EVEN = 0.05  # roughness below which a place counts as flat
EDGE = 0.29  # roughness of a right-angled edge
SLOPE = 0.1  # by which the spacing grows with the distance, at most
SPARSEST = 0.7  # of the mean density of the points to be chosen: no place is left with less before grading
MOST_SAMPLED = 100_000  # points of the tree by which area and noise are judged, unless more are to be chosen
DENSE = 26  # of them for each to be chosen: as many as the widest neighbourhoods that tell noise need
REACH = 1.0  # widths of a cell, by the estimate of the area, within which its points are told apart
MOST_TOLD = 25  # points of a cell that are told apart, about: more cost their square, and tell little more
SMALLEST = 1e-200  # area that anything is told apart in
FLAT = 1e-12  # surface variation, or spread of it, that is nothing but rounding
NOISE = 1e-4  # variance of an observation without noise, in units of the prior variance: keeps covariances regular


Seen = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]


@dataclass(frozen=True)
class Criterion:
    """What the selection weighs.

    Attributes
    ----------
    density_power : float
        How the density of points follows roughness: points per area as roughness to this power, less where the cloud
        is made up of faces and edges.
    normal_weight : float
        beta: the distance, in spacings, that a right angle between normals is worth; less in the same case.
    error_weight : float
        w: of the error of the surface variation beside the uncertainty.
    lengthscale : float
        Of the Matérn kernel, in units of the spacing.
    neighbours : int
        K: how many chosen points a posterior is conditioned on.
    """

    density_power: float
    normal_weight: float
    error_weight: float
    lengthscale: float
    neighbours: int


@dataclass(frozen=True)
class Ranking:
    """Points in the order chosen.

    Attributes
    ----------
    indices : (M,) array, int64
    scores, deviations : (M,) arrays, float64
        Of each when it was chosen: its score, and the posterior's standard deviation, in units of the prior's. Scores
        fall within a stage, but for what the error and the small number of neighbours change, and rise at the start of
        the next, whose field is finer.
    """

    indices: NDArray[np.int64]
    scores: NDArray[np.float64]
    deviations: NDArray[np.float64]


def sampled_tree(points: NDArray[np.float64], n_points: int) -> tuple[KdTree, NDArray[np.int64] | slice]:
    """Return a tree over all points, or over many that chance takes, and which these are.

    Area and noise at the target spacing are judged by them, and `DENSE` points for each to be chosen tell these as well
    as more; a tree over many millions would take longer than the choice.
    """
    enough = max(MOST_SAMPLED, DENSE * n_points)
    if len(points) <= 1.5 * enough:
        return KdTree.build(points), slice(None)
    draws = round(-len(points) * math.log1p(-enough / len(points)))  # some are of points that were drawn before
    taken = np.zeros(len(points), dtype=np.bool_)
    taken[np.random.default_rng(0).integers(0, len(points), draws)] = True
    indices = np.flatnonzero(taken)
    return KdTree.build(points[indices]), indices


def sharpness_of(tree: KdTree, area: float, cells: float) -> NDArray[np.float64]:
    """Return the surface variation of the points of a tree within the width of a cell, where so many cover the area.

    Of the points in a cell with a crease through it, those on the crease have the most. What is nothing but rounding
    counts as none: it would change with where the cloud lies. Of far more points than cells only some are looked at,
    evenly spread over the tree: balls of the others would hold too many.
    """
    n = len(tree.order)
    some = slice(None, None, max(1, n // math.ceil(MOST_TOLD * cells)))
    told = tree if some.step == 1 else KdTree.build(tree.points[:, some].T)
    variation = variation_in_radius(told, REACH * _edge(area, cells))
    sharpness = np.zeros(n)
    sharpness[slice(None) if told is tree else tree.order[some]] = np.where(variation > FLAT, variation, 0.0)
    return sharpness


class Candidates(NamedTuple):
    """How many points a stage wants, the ascending indices of its candidates, if those are thinned, and the area."""

    target: int
    indices: NDArray[np.int64]
    thinned: bool
    area: float


def nested_candidates(
    points: NDArray[np.float64], n_points: int, area: float, density: float, sharpness: NDArray[np.float32]
) -> list[Candidates]:
    """Return the candidates of the stages from coarse to fine, those of a coarse stage among those of the finer ones.

    They are the sharpest points of the cells of a grid, of several the first, `density` cells to the square of the
    target spacing on a surface along the grid, half as many again on others. Where that would leave too few, those of
    the finer stage stay.

    The number of occupied cells tells where the estimate of the area fails: that of points on curves is too small, and
    that of a cloud with most points in a dot is too large. The area is then doubled until there are not too many, or
    halved until there are not too few, for this stage and the coarser ones.
    """
    stages = []
    target, candidates, places = n_points, None, points
    while True:
        area, kept = _thinned(places, target, area, density, sharpness)
        thinned = len(kept) >= FEWEST * target
        if thinned:
            candidates = kept if candidates is None else candidates[kept]
            places, sharpness = places[kept], sharpness[kept]
        elif candidates is None:
            candidates = np.arange(len(points))
        stages.append(Candidates(target, candidates, thinned, area))
        if target <= FIRST:
            return stages[::-1]
        target = -(-target // 2)


def rank(
    points: NDArray[np.float64],
    candidates: Sequence[Candidates],
    criterion: Criterion,
    seen: Seen | None = None,
    stages: Stages | None = None,
) -> Ranking:
    """Choose points, the most important first.

    Parameters
    ----------
    points : (N, 3) array
        Without repeats.
    candidates : sequence of Candidates
        Of all stages, from coarse to fine.
    criterion : Criterion
    seen : callable, optional
        Takes some of the points, (n, 3), and returns where on the surface they belong, by which features are measured,
        and the variance of the observation at each; times 1 / h^2, in units of the prior at spacing h. By default they
        are where they belong.
    stages : Stages, optional
        Times "noise", "features" and "greedy selection"; the steps of the last are points.
    """
    clock = stages or Stages()
    chosen = np.empty(0, dtype=np.int64)
    scores, deviations = [], []
    for target, indices, thinned, area in candidates:
        spacing = float(np.sqrt(area / target)) or 1.0
        tree, field = _observed(points[indices], spacing, thinned, criterion, seen, clock)
        with clock("greedy selection", target - len(chosen)) as advanced:
            before = tree.positions()[np.searchsorted(indices, chosen)]  # they are candidates here too
            extended, score, deviation = extend(
                field, tree, before, target, criterion.neighbours, criterion.error_weight
            )
            advanced(target - len(chosen))
        scores.append(score)
        deviations.append(deviation)
        chosen = indices[tree.order[extended]]
    return Ranking(chosen, np.concatenate(scores), np.concatenate(deviations))


def _observed(
    places: NDArray[np.float64], spacing: float, thinned: bool, criterion: Criterion, seen: Seen | None, clock: Stages
) -> tuple[KdTree, LocalField]:
    """Return the tree over the candidates of a stage, in units of its spacing, and the field over that."""
    with clock("noise"):
        feet, variances = (places, np.zeros(len(places))) if seen is None else seen(places)
    with clock("features"):
        tree = KdTree.build(places / spacing)
        on_surface = tree if feet is places else KdTree.build(feet / spacing)
        features = features_in_radius(on_surface, 1.0) if thinned else features_of_nearest(on_surface, FEW)
        return tree, _field(tree, features, variances / spacing**2, criterion)


def _thinned(
    points: NDArray[np.float64], target: int, area: float, density: float, sharpness: NDArray[np.float32]
) -> tuple[float, NDArray[np.int64]]:
    """Return the area, doubled or halved where it must be, and the sharpest points of the cells, at most `MANY`."""
    many, cells = MANY * density * target, density * target
    seen, kept = next(grid for grid in _grids(points, area, cells, sharpness) if len(grid[1]) <= many)
    if seen == area and len(kept) < FEWEST * target and len(points) > many:
        area = _halved(points, target, area, density, sharpness)
        seen, kept = next(grid for grid in _grids(points, area, cells, sharpness) if len(grid[1]) <= many)
    return seen, kept


def _halved(
    points: NDArray[np.float64], target: int, area: float, density: float, sharpness: NDArray[np.float32]
) -> float:
    """Return the area halved as often as it takes until the cells that hold points suffice.

    Where those that hold some of the points suffice, so do those that hold all, and one can go back from there.
    """
    few, cells = FEWEST * target, density * target
    some = slice(None, None, len(points) // int(MANY * cells))
    halvings = 1
    while (
        len(greatest_in_cells(points[some], _edge(area * 0.5**halvings, cells), sharpness[some])) < few
        and area * 0.5**halvings > SMALLEST
    ):
        halvings += 4  # some too many are taken back below
    found = area * 0.5**halvings
    for _, (coarser, kept) in zip(range(halvings), _grids(points, found, cells, sharpness), strict=False):
        if len(kept) >= few:
            found = coarser
    return found


def _grids(
    points: NDArray[np.float64], area: float, cells: float, sharpness: NDArray[np.float32]
) -> Iterator[tuple[float, NDArray[np.int64]]]:
    """Give area after area, each twice the one before, with the sharpest points of the cells of that edge.

    Cells of a grid of twice the edge are made up of whole cells, and the sharpest of these suffice to tell theirs.
    """
    finest = finer = None  # all
    while True:
        some, sharp = (points, sharpness) if finest is None else (points[finest], sharpness[finest])
        kept = greatest_in_cells(some, _edge(area, cells), sharp)
        finest, finer = finer, kept if finest is None else finest[kept]
        yield area, finer
        area *= 2.0


def _edge(area: float, cells: float) -> float:
    """Return the edge of the squares of which so many cover the area."""
    return float(np.sqrt(area / cells)) or 1.0


def _field(tree: KdTree, features: Features, noise: NDArray[np.float64], criterion: Criterion) -> LocalField:
    """Return the field over a tree in units of the target spacing; features and noise are in the tree's input order.

    Roughness is the square root of the surface variation, about the radius of the neighbourhood times the curvature.
    A piecewise linear surface of given size has the least mean error if its density goes as the square root of the
    curvature, so the density here is roughness to a power; the more the cloud is one of faces and edges, the smaller a
    power, lest the faces are left bare. Normals among few points are sound only where their density changes slowly, so
    it is graded.
    """
    variation = features.surface_variation[tree.order]
    roughness = np.sqrt(variation)
    roundness = 1.0 - _segregation(roughness) ** 2
    density = np.maximum(roughness, EVEN) ** (criterion.density_power * roundness**4)
    density = np.maximum(density, SPARSEST * np.mean(density))
    spacings = graded(tree, np.sqrt(np.mean(density) / density), SLOPE)
    spread = float(np.std(variation))
    return LocalField(
        positions=tree.points,
        normals=np.ascontiguousarray(features.normals[tree.order].T),
        spacings=spacings * np.sqrt(np.mean(spacings**-2.0)),
        y=(variation - np.mean(variation)) / spread if spread > FLAT else np.zeros(len(noise)),
        noise=NOISE + noise[tree.order],
        lengthscale=criterion.lengthscale,
        normal_weight=criterion.normal_weight * roundness**2,
    )


def _segregation(roughness: NDArray[np.float64]) -> float:
    """Return how far a cloud is one of flat faces and right-angled edges: 1 for nothing else, 0 for all places alike.

    It is the variance of the roughness, as a share of the most that values from 0 to `EDGE` of that mean can have: the
    intensity of segregation of a mixture (Danckwerts 1952).
    """
    clipped = np.minimum(roughness, EDGE)
    mean = float(np.mean(clipped))
    most = mean * (EDGE - mean)
    return float(np.var(clipped)) / most if most > FLAT else 0.0
