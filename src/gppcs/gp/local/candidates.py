"""A survey of the whole cloud, and from it the candidates of each stage.

A survey measures area, noise and sharp places before any point is chosen. Candidates are the sharpest point in each
cell of a grid that gets finer from stage to stage.

The row "sharpness off" of the ablation (benchmarks/results/gp_ablation.md) takes the first point of each cell.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.timer import Timer
from gppcs.gp.local.density import ROUNDING
from gppcs.gp.local.detail import Detail
from gppcs.spatial.cells import first_occurrences, greatest_in_cells
from gppcs.spatial.kdtree import KdTree, surface_area
from gppcs.surface.noise import Noise
from gppcs.surface.surface_variation import features_in_radius

FIRST_STAGE = 64  # Points of the first stage at most. A still smaller stage would cost no less.
ENOUGH = 3  # Candidates for each point to keep, at least. With fewer, all points stay candidates.
TOO_MANY = 3  # Occupied cells for each cell that the area has room for. A plane has 1.5 on average, 1.7 at most.
# A candidate is lone if no other lies within the first of these distances, in target spacings.
DISTANCES = (0.45, 0.9, 1.8, 3.6)
# Those alone within a distance are outliers if more than this share of them is alone within twice that distance, too.
# It is mostly 28 % at most in scans with sparse parts, and 40 % or more of outliers (research/experiments.md).
OUTLIERS = 0.4
HARMLESS = 0.003  # Lone candidates take so few of the points to keep that they may stay, whatever they are.
FOLLOWERS = 3  # Points on each side, in tree order, that are looked at first.
SMALLEST_AREA = 1e-200  # Halving of the area stops here, before it becomes zero.
LARGE = 100_000  # A larger cloud is sampled, as a tree over many millions takes longer than the choice.
PER_POINT = 26  # Sampled points for each point to keep: about as many as measuring the noise needs.


class Survey(NamedTuple):
    """What is known of a cloud of N points before the choice."""

    area: float  # Area of the surface, corrected by the number of occupied cells
    noise: Noise
    # (N,): Surface variation within the edge length of a candidate's cell, and that of the detail. It is 0 if the cloud
    # is not clean, where it was not measured, and where it is only rounding.
    sharpness: NDArray[np.float32]
    detail: Detail | None  # None if there are no attributes, or only noise


def survey(
    points: NDArray[np.float64],
    n_points: int,
    density: float,
    timer: Timer,
    attributes: NDArray[np.float32] | None = None,
) -> Survey:
    """Measure a cloud, (N, 3), with `density` candidate cells in a square whose side is the target spacing."""
    with timer("sample"):
        rows = sample(points, n_points)
        places = points if len(rows) == len(points) else points[rows]
    with timer("tree"):
        tree = KdTree.build(places)
        area, _ = thinned(places, np.zeros(len(places), dtype=np.float32), n_points, surface_area(tree), density)
    with timer("noise"):
        noise = Noise.measure(tree, n_points, math.sqrt(area / n_points))
    sharpness = np.zeros(len(points), dtype=np.float32)
    if noise.clean:  # otherwise noisy points would look sharp
        with timer("candidates"):
            sharpness[rows] = sharpness_of(tree, cell_edge(area, density * n_points))
    detail = None
    if attributes is not None:
        with timer("detail"):
            detail = Detail.measure(tree, rows, attributes, cell_edge(area, density * n_points))
            sharpness += 0.0 if detail is None else detail.variation
    return Survey(area, noise, sharpness, detail)


def sample_size(n_points: int) -> int:
    """Return of how many points, about, a sample of a large cloud consists."""
    return max(LARGE, PER_POINT * n_points)


def sample(points: NDArray[np.float64], n_points: int) -> NDArray[np.int64]:
    """Return all rows, or those of a random sample of a large cloud without the repeats among them, ascending.

    A sample measures the area as well as all points do, and the noise, unless that is thicker than the target spacing.
    """
    n = len(points)
    if n <= 1.5 * sample_size(n_points):  # to draw most of the points would cost more than it saves
        return np.arange(n)
    draws = round(-n * math.log1p(-sample_size(n_points) / n))  # with replacement: some rows are drawn twice
    rows = np.unique(np.random.default_rng(0).integers(0, n, draws))
    return rows[first_occurrences(points[rows])]


def sharpness_of(tree: KdTree, edge: float) -> NDArray[np.float64]:
    """Return the surface variation within the edge length of a cell, in the order of the tree's input, (N,).

    Of the points in a cell with a crease through it, those on the crease have the most. Rounding counts as none, as it
    changes with the place of the cloud.
    """
    variation = features_in_radius(tree, edge, with_normals=False).surface_variation
    return np.where(variation > ROUNDING, variation, 0.0)


class Candidates(NamedTuple):
    """The candidates of a stage of the choice."""

    target: int  # Number of points that are chosen when the stage ends
    rows: NDArray[np.int64]  # (n,), rows of the candidates, ascending
    # Whether the candidates are one in each cell. Otherwise they are those of the next finer stage, or all points.
    thinned: bool
    area: float  # Area of the surface, corrected by the number of occupied cells


def nested_candidates(
    points: NDArray[np.float64],
    sharpness: NDArray[np.float32],
    n_points: int,
    area: float,
    density: float,
    fixed: int = 0,
) -> list[Candidates]:
    """Return the candidates of all stages, from coarse to fine. Those of a coarse stage are among those of the finer.

    The candidate of a grid's cell is its sharpest point, and of several the first. Outliers are left out. If that
    leaves too few, a stage takes the candidates of the finer stage, and the last stage takes all points. The first
    `fixed` points are candidates of each stage, which wants more.

    The number of occupied cells shows if the area is wrong. It is estimated too small for points on curves, and too
    large for a cloud with most points in one spot. The area is then doubled until there are not too many occupied
    cells, or halved until there are not too few, for this stage and the coarser ones. Shapes: points (N, 3), sharpness
    (N,).
    """
    area, rows = thinned(points, sharpness, n_points, area, density)
    if enough := len(rows) >= ENOUGH * n_points:
        spacing = math.sqrt(area / n_points)
        gaps = gaps_of_lone(points[rows], spacing)
        lone = np.count_nonzero(gaps[:, None] > np.multiply(DISTANCES, spacing), axis=0)
        rows = rows[gaps <= largest_gap(lone, len(rows), n_points, spacing)]
    else:
        rows = np.arange(len(points))
    stages = [Candidates(n_points, rows, enough, area)]
    while stages[-1].target > max(FIRST_STAGE, 2 * fixed):
        target = -(-stages[-1].target // 2)
        area, kept = thinned(points[rows], sharpness[rows], target, area, density)
        if enough := len(kept) >= ENOUGH * target:
            rows = rows[kept]
        stages.append(Candidates(target, rows, enough, area))
    if fixed:
        stages = [stage._replace(rows=np.union1d(stage.rows, np.arange(fixed))) for stage in stages]
    return stages[::-1]


def gaps_of_lone(points: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return how far lone candidates are from all others. Shapes: points (n, 3); returns (n,)."""
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


def largest_gap(lone: NDArray[np.int64], n: int, n_points: int, spacing: float) -> float:
    """Return how far from all others a candidate may be. Those farther away are outliers, which are left out.

    On a surface, along a wire and in a cluster, candidates are about as near each other as their cells. In sparse parts
    of a scan some are lone, but their number falls fast with the distance. That of scattered outliers does not. Shapes:
    lone (4,), how many are alone within each of `DISTANCES`.
    """
    for distance, (number, farther) in zip(DISTANCES, pairwise(lone), strict=False):
        if HARMLESS * n_points < number <= n - ENOUGH * n_points and farther > OUTLIERS * number:
            return distance * spacing
    return math.inf


def cell_edge(area: float, cells: float) -> float:
    """Return the edge length of the cells when so many squares cover the area."""
    return math.sqrt(area / cells) or 1.0


def thinned(
    points: NDArray[np.float64], sharpness: NDArray[np.float32], target: int, area: float, density: float
) -> tuple[float, NDArray[np.int64]]:
    """Return the area, doubled or halved until the occupied cells fit it, and the rows of their sharpest points."""
    many, cells = TOO_MANY * density * target, density * target
    grids = _grids(points, sharpness, area, cells)
    seen, kept = next(grids)
    while len(kept) > many:
        seen, kept = next(grids)
    if seen == area and len(kept) < ENOUGH * target and len(points) > many:
        area = _halved(points, sharpness, target, area, density)
        grids = _grids(points, sharpness, area, cells)
        seen, kept = next(grids)
        while len(kept) > many:
            seen, kept = next(grids)
    return seen, kept


def _halved(
    points: NDArray[np.float64], sharpness: NDArray[np.float32], target: int, area: float, density: float
) -> float:
    """Return the area, halved until enough cells hold points.

    A sample of the points finds a number of halvings that is enough, quickly; all points then take some of them back.
    """
    few, cells = ENOUGH * target, density * target
    step = len(points) // int(TOO_MANY * cells)
    some, sharp = np.ascontiguousarray(points[::step]), sharpness[::step]
    halvings = 1
    while area * 0.5**halvings > SMALLEST_AREA:
        if len(greatest_in_cells(some, cell_edge(area * 0.5**halvings, cells), sharp)) >= few:
            break
        halvings += 4  # the loop below takes back what is too much
    found = area * 0.5**halvings
    for _, (coarser, kept) in zip(range(halvings), _grids(points, sharpness, found, cells), strict=False):
        if len(kept) >= few:
            found = coarser
    return found


def _grids(
    points: NDArray[np.float64], sharpness: NDArray[np.float32], area: float, cells: float
) -> Iterator[tuple[float, NDArray[np.int64]]]:
    """Yield an area and the sharpest points of its cells, then twice the area, and so on.

    Four times the area is twice the edge length. Such cells consist of whole cells of the grid two steps before, so
    their sharpest points are among the sharpest points of that grid.
    """
    finer = last = None
    while True:
        edge = cell_edge(area, cells)
        if finer is None:
            kept = greatest_in_cells(points, edge, sharpness)
        else:
            kept = finer[greatest_in_cells(points[finer], edge, sharpness[finer])]
        finer, last = last, kept
        yield area, kept
        area *= 2.0
