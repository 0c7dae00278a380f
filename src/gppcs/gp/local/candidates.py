"""Candidates of each stage: the sharpest point in each cell of a grid, finer from stage to stage."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.cells import greatest_in_cells

FIRST = 64  # points of the first stage at most; it costs as little as any
FEWEST = 3  # candidates for each point wanted, below which there is nothing to choose from
MANY = 3  # times as many candidates as there are cells to the square of the target spacing: more than a surface has
SMALLEST = 1e-200  # area that anything is told apart in


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
