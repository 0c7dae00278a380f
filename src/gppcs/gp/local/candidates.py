"""Candidates of each stage: the sharpest point in each cell of a grid that gets finer from stage to stage.

The row "sharpness off" of the ablation (benchmarks/results/gp_ablation.md) takes the first point of each cell.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.stages import Stages
from gppcs.spatial.chunks import ALIKE, ChunkedPoints, Places, SparseValues
from gppcs.spatial.kdtree import KdTree

FIRST_STAGE = 64  # Points of the first stage at most. A still smaller stage would cost no less.
ENOUGH = 3  # Candidates for each point to keep, at least. With fewer, all points stay candidates.
TOO_MANY = 3  # Occupied cells for each cell that the area has room for. A plane has 1.5 on average, 1.7 at most.
# A candidate is lone if no other lies within the first of these distances, in target spacings.
DISTANCES = (0.45, 0.9, 1.8, 3.6)
# Those alone within a distance are outliers if more than this share of them is alone within twice that distance, too.
# It is mostly 28 % at most in scans with sparse parts, and 40 % or more of outliers (docs/experiments.md).
OUTLIERS = 0.4
FEW = 6  # Fewer lone candidates tell nothing.
HARMLESS = 0.003  # Lone candidates take so few of the points to keep that they may stay, whatever they are.
MINORITY = 0.2  # Share of the candidates that can be outliers. With more, the cloud is sparse.
FOLLOWERS = 3  # Points on each side, in tree order, that are looked at first.
SMALLEST_AREA = 1e-200  # Halving of the area stops here, before it becomes zero.


class Finest(NamedTuple):
    """The candidates of the last stage, to which those of all others belong.

    Attributes
    ----------
    area : float
        Area of the surface, corrected by the number of occupied cells.
    places : Places
        The candidates, with their sharpness.
    thinned : bool
        Whether they are one in each cell, and enough. If they are too few, all points should be candidates.
    """

    area: float
    places: Places
    thinned: bool


class Candidates(NamedTuple):
    """The candidates of a stage.

    Attributes
    ----------
    target : int
        Number of points that are chosen when the stage ends.
    indices : (n,) array, int64
        Which of the finest candidates they are, ascending.
    thinned : bool
        Whether the candidates are one in each cell. Otherwise they are those of the next finer stage, or all points.
    area : float
        Area of the surface, corrected by the number of occupied cells.
    """

    target: int
    indices: NDArray[np.int64]
    thinned: bool
    area: float


def finest_candidates(
    points: ChunkedPoints, n_points: int, area: float, density: float, sharpness: SparseValues, clock: Stages
) -> Finest:
    """Return the candidates of the last stage. They take a pass over the points, or some if the area is far off.

    The candidate of a grid's cell is its sharpest point, and of several the first. Outliers are left out.

    The number of occupied cells shows if the area is wrong. It is estimated too small for points on curves, and too
    large for a cloud with most points in one spot. The area is then doubled until there are not too many occupied
    cells, or halved until there are not too few, for this stage and the coarser ones.

    Parameters
    ----------
    points : ChunkedPoints
        N points.
    n_points : int
        M, the number of points to keep.
    area : float
        Area of the surface, in squared units of the points.
    density : float
        Number of cells in a square whose side is the target spacing. A surface along the grid occupies so many, a
        tilted one half as many again.
    sharpness : SparseValues
        Surface variation within a cell; 0 where all points count alike.
    clock : Stages
        Times "candidates". A step is a point read.

    Returns
    -------
    Finest
    """
    area, kept = _thinned(_Sharp(points, sharpness, clock), n_points, area, density)
    thinned = len(kept.rows) >= ENOUGH * n_points
    if thinned:
        with clock("candidates"):
            spacing = math.sqrt(area / n_points)
            gaps = gaps_of_lone(kept.points, spacing)
            largest = largest_gap(numbers_of_lone(gaps, spacing), len(gaps), n_points, spacing)
            if np.any(gaps > largest):
                kept = kept.take(np.flatnonzero(gaps <= largest))
    return Finest(area, kept, thinned)


def nested_candidates(finest: Finest, n_points: int, density: float, clock: Stages) -> list[Candidates]:
    """Return the candidates of all stages. Those of a coarse stage are among those of the finer ones.

    They are chosen as those of the last stage. If that leaves too few, the stage takes the candidates of the finer
    stage.

    Parameters
    ----------
    finest : Finest
        Those of the last stage.
    n_points : int
        M, the number of points to keep.
    density : float
        Number of cells in a square whose side is the target spacing.
    clock : Stages
        Times "candidates".

    Returns
    -------
    list of Candidates
        From coarse to fine. The first stage wants at most `FIRST_STAGE` points, each other about twice as many as
        the one before, and the last M.
    """
    area, places, thinned = finest
    target, candidates = n_points, np.arange(len(places.rows))
    stages = [Candidates(target, candidates, thinned, area)]
    while target > FIRST_STAGE:
        target = -(-target // 2)
        area, kept = _thinned(_Sharp.of(places, clock), target, area, density)
        if thinned := len(kept.rows) >= ENOUGH * target:
            candidates, places = candidates[kept.rows], kept
        stages.append(Candidates(target, candidates, thinned, area))
    return stages[::-1]


def gaps_of_lone(points: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return how far lone candidates are from all others.

    Parameters
    ----------
    points : (n, 3) array
        The candidates.
    spacing : float
        The target spacing.

    Returns
    -------
    (n,) array
        Distance to the nearest other candidate; infinite if there is none, 0 if it is within the first of `DISTANCES`.
    """
    tree, reach = KdTree.build(points), DISTANCES[0] * spacing
    suspects = np.ones(len(points), dtype=bool)
    for step in range(1, FOLLOWERS + 1):  # in tree order, points that follow each other are mostly near each other
        steps = tree.points[:, step:] - tree.points[:, :-step]
        near = np.einsum("an,an->n", steps, steps) <= reach**2
        suspects[step:] &= ~near
        suspects[:-step] &= ~near
    gaps = np.full(len(points), 0.0 if len(points) > 1 else np.inf)
    if len(points) > 1:
        asked = tree.order[suspects]
        nearest = np.sqrt(tree.nearest_of(points[asked], 2)[1][:, 1])
        gaps[asked] = np.where(nearest > reach, nearest, 0.0)
    return gaps


def numbers_of_lone(gaps: NDArray[np.float64], spacing: float) -> NDArray[np.int64]:
    """Return how many candidates are alone within each of some distances.

    Parameters
    ----------
    gaps : (n,) array
        Distances to the nearest other candidate, as `gaps_of_lone` returns them.
    spacing : float
        The target spacing.

    Returns
    -------
    (4,) array
        One for each of `DISTANCES`.
    """
    return np.array([np.count_nonzero(gaps > distance * spacing) for distance in DISTANCES])


def largest_gap(lone: NDArray[np.int64], n: int, n_points: int, spacing: float) -> float:
    """Return how far from all others a candidate may be. Those farther away are outliers, which are left out.

    On a surface, along a wire and in a cluster, candidates are about as near each other as their cells. In sparse parts
    of a scan some are lone, but their number falls fast with the distance. That of scattered outliers does not.

    Parameters
    ----------
    lone : (4,) array
        Numbers of candidates that are alone within each of `DISTANCES`.
    n : int
        Number of all candidates.
    n_points : int
        M, the number of points to keep.
    spacing : float
        The target spacing.

    Returns
    -------
    float
        Infinite if there are no outliers.
    """
    for distance, (number, farther) in zip(DISTANCES, pairwise(lone), strict=False):
        if max(FEW, HARMLESS * n_points) <= number <= MINORITY * n and farther > OUTLIERS * number:
            return distance * spacing
    return math.inf


def corrected_area(points: NDArray[np.float64], n_points: int, area: float, density: float) -> float:
    """Return an estimate of the area of the surface, doubled or halved until the number of occupied cells fits it.

    Parameters
    ----------
    points : (N, 3) array
        All points, or a sample with several points in a cell.
    n_points : int
        M, the number of points to keep.
    area : float
        The estimate, in squared units of the points.
    density : float
        Number of cells in a square whose side is the target spacing.

    Returns
    -------
    float
    """
    return _thinned(_Sharp(ChunkedPoints.of(points), ALIKE, Stages()), n_points, area, density)[0]


class _Sharp(NamedTuple):
    """Points with their sharpness, and the clock that times the search for the sharpest."""

    points: ChunkedPoints
    sharpness: SparseValues
    clock: Stages

    @classmethod
    def of(cls, places: Places, clock: Stages) -> _Sharp:
        rows = np.arange(len(places.rows))
        return cls(ChunkedPoints.of(places.points), SparseValues(rows, places.values), clock)

    def sharpest(self, edge: float) -> Places:
        """Return the sharpest point of each cell, and of several the first."""
        with self.clock("candidates", len(self.points)) as advanced:
            return self.points.greatest_in_cells(edge, self.sharpness, advanced)

    def every(self, step: int) -> _Sharp:
        """Return every `step`-th of them."""
        with self.clock("candidates", len(self.points)) as advanced:
            some = ChunkedPoints.of(self.points.every(step, advanced))
        return _Sharp(some, self.sharpness.every(step), self.clock)


def _thinned(cloud: _Sharp, target: int, area: float, density: float) -> tuple[float, Places]:
    """Return the corrected area, and the sharpest points of the cells."""
    many, cells = TOO_MANY * density * target, density * target
    seen, kept = next(grid for grid in _grids(cloud, area, cells) if len(grid[1].rows) <= many)
    if seen == area and len(kept.rows) < ENOUGH * target and len(cloud.points) > many:
        area = _halved(cloud, target, area, density)
        seen, kept = next(grid for grid in _grids(cloud, area, cells) if len(grid[1].rows) <= many)
    return seen, kept


def _halved(cloud: _Sharp, target: int, area: float, density: float) -> float:
    """Return the area, halved until enough cells hold points.

    A sample of the points finds a number of halvings that is enough, quickly; all points then take some of them back.
    """
    few, cells = ENOUGH * target, density * target
    some = cloud.every(len(cloud.points) // int(TOO_MANY * cells))
    halvings = 1
    while len(some.sharpest(_edge(area * 0.5**halvings, cells)).rows) < few and area * 0.5**halvings > SMALLEST_AREA:
        halvings += 4  # the loop below takes back what is too much
    found = area * 0.5**halvings
    for _, (coarser, kept) in zip(range(halvings), _grids(cloud, found, cells), strict=False):
        if len(kept.rows) >= few:
            found = coarser
    return found


def _grids(cloud: _Sharp, area: float, cells: float) -> Iterator[tuple[float, Places]]:
    """Yield an area and the sharpest points of its cells, then twice the area, and so on.

    Four times the area is twice the edge length. Such cells consist of whole cells of the grid two steps before, so
    their sharpest points are among the sharpest points of that grid.
    """
    finest = finer = None  # all points
    while True:
        edge = _edge(area, cells)
        kept = finest.take(_Sharp.of(finest, cloud.clock).sharpest(edge).rows) if finest else cloud.sharpest(edge)
        finest, finer = finer, kept
        yield area, kept
        area *= 2.0


def _edge(area: float, cells: float) -> float:
    """Return the edge length of the cells when so many squares cover the area."""
    return float(np.sqrt(area / cells)) or 1.0
