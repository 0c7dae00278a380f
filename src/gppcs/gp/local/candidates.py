"""Candidates of each stage: the sharpest point in each cell of a grid, finer from stage to stage."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.cells import greatest_in_cells
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.surface_variation import variation_in_radius

FIRST = 64  # points of the first stage at most; it costs as little as any
FEWEST = 3  # candidates for each point wanted, below which there is nothing to choose from
MANY = 3  # times as many candidates as there are cells to the square of the target spacing: more than a surface has
MOST_SAMPLED = 100_000  # points of the tree by which area and noise are judged, unless more are to be chosen
DENSE = 26  # of them for each to be chosen: as many as the widest neighbourhoods that tell noise need
REACH = 1.0  # widths of a cell, by the estimate of the area, within which its points are told apart
MOST_TOLD = 25  # points of a cell that are told apart, about: more cost their square, and tell little more
SMALLEST = 1e-200  # area that anything is told apart in
FLAT = 1e-12  # surface variation, or spread of it, that is nothing but rounding


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
