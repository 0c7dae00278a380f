"""Candidates of each stage: the sharpest point in each cell of a grid that gets finer from stage to stage.

The row "sharpness off" of the ablation (benchmarks/results/gp_ablation.md) takes the first point of each cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.cells import greatest_in_cells

FIRST_STAGE = 64  # Points of the first stage at most. A still smaller stage would cost no less.
ENOUGH = 3  # Candidates for each point to keep, at least. With fewer, all points stay candidates.
TOO_MANY = 3  # Occupied cells for each cell that the area has room for. A plane has 1.5 on average, 1.7 at most.
SMALLEST_AREA = 1e-200  # Halving of the area stops here, before it becomes zero.


class Candidates(NamedTuple):
    """The candidates of a stage.

    Attributes
    ----------
    target : int
        Number of points that are chosen when the stage ends.
    indices : (n,) array, int64
        Rows of the candidates, ascending.
    thinned : bool
        Whether the candidates are one in each cell. Otherwise they are those of the next finer stage, or all points.
    area : float
        Area of the surface, corrected by the number of occupied cells.
    """

    target: int
    indices: NDArray[np.int64]
    thinned: bool
    area: float


def nested_candidates(
    points: NDArray[np.float64], n_points: int, area: float, density: float, sharpness: NDArray[np.float32]
) -> list[Candidates]:
    """Return the candidates of all stages. Those of a coarse stage are among those of the finer ones.

    The candidate of a grid's cell is its sharpest point, and of several the first. If that leaves too few, the stage
    takes the candidates of the finer stage.

    The number of occupied cells shows if the area is wrong. It is estimated too small for points on curves, and too
    large for a cloud with most points in one spot. The area is then doubled until there are not too many occupied
    cells, or halved until there are not too few, for this stage and the coarser ones.

    Parameters
    ----------
    points : (N, 3) array
        Without repeats.
    n_points : int
        M, the number of points to keep.
    area : float
        Area of the surface, in squared units of the points.
    density : float
        Number of cells in a square whose side is the target spacing. A surface along the grid occupies so many, a
        tilted one half as many again.
    sharpness : (N,) array, float32
        Surface variation within a cell; 0 where all points count alike.

    Returns
    -------
    list of Candidates
        From coarse to fine. The first stage wants at most `FIRST_STAGE` points, each other about twice as many as
        the one before, and the last M.
    """
    stages = []
    target, candidates, places = n_points, None, points
    while True:
        area, kept = _thinned(places, target, area, density, sharpness)
        thinned = len(kept) >= ENOUGH * target
        if thinned:
            candidates = kept if candidates is None else candidates[kept]
            places, sharpness = places[kept], sharpness[kept]
        elif candidates is None:
            candidates = np.arange(len(points))
        stages.append(Candidates(target, candidates, thinned, area))
        if target <= FIRST_STAGE:
            return stages[::-1]
        target = -(-target // 2)


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
    return _thinned(points, n_points, area, density, np.zeros(len(points), dtype=np.float32))[0]


def _thinned(
    points: NDArray[np.float64], target: int, area: float, density: float, sharpness: NDArray[np.float32]
) -> tuple[float, NDArray[np.int64]]:
    """Return the corrected area, and the rows, (n,), of the sharpest points of the cells."""
    many, cells = TOO_MANY * density * target, density * target
    seen, kept = next(grid for grid in _grids(points, area, cells, sharpness) if len(grid[1]) <= many)
    if seen == area and len(kept) < ENOUGH * target and len(points) > many:
        area = _halved(points, target, area, density, sharpness)
        seen, kept = next(grid for grid in _grids(points, area, cells, sharpness) if len(grid[1]) <= many)
    return seen, kept


def _halved(
    points: NDArray[np.float64], target: int, area: float, density: float, sharpness: NDArray[np.float32]
) -> float:
    """Return the area, halved until enough cells hold points.

    A sample of the points finds a number of halvings that is enough, quickly; all points then take some of them back.
    """
    few, cells = ENOUGH * target, density * target
    some = slice(None, None, len(points) // int(TOO_MANY * cells))
    halvings = 1
    while (
        len(greatest_in_cells(points[some], _edge(area * 0.5**halvings, cells), sharpness[some])) < few
        and area * 0.5**halvings > SMALLEST_AREA
    ):
        halvings += 4  # the loop below takes back what is too much
    found = area * 0.5**halvings
    for _, (coarser, kept) in zip(range(halvings), _grids(points, found, cells, sharpness), strict=False):
        if len(kept) >= few:
            found = coarser
    return found


def _grids(
    points: NDArray[np.float64], area: float, cells: float, sharpness: NDArray[np.float32]
) -> Iterator[tuple[float, NDArray[np.int64]]]:
    """Yield an area and the rows of the sharpest points of its cells, then twice the area, and so on.

    Four times the area is twice the edge length. Such cells consist of whole cells of the grid two steps before, so
    their sharpest points are among the sharpest points of that grid.
    """
    finest = finer = None  # all points
    while True:
        some, sharp = (points, sharpness) if finest is None else (points[finest], sharpness[finest])
        kept = greatest_in_cells(some, _edge(area, cells), sharp)
        finest, finer = finer, kept if finest is None else finest[kept]
        yield area, finer
        area *= 2.0


def _edge(area: float, cells: float) -> float:
    """Return the edge length of the cells when so many squares cover the area."""
    return float(np.sqrt(area / cells)) or 1.0
