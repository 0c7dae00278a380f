"""A survey of the whole cloud, and from it the candidates of each stage (research/local-field.md, steps 1 and 2).

The row "sharpness off" of the ablation (benchmarks/results/gp_ablation.md) takes a random point of each cell.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.engine.timer import Timer
from gppcs.gp.local.density import VARIATION_ROUNDING
from gppcs.gp.local.detail import Detail
from gppcs.gp.local.scale import Scale
from gppcs.gp.local.settings import (
    FEWEST_CELLS,
    FIRST_STAGE,
    ISOLATION,
    MAX_CELLS,
    MIN_CANDIDATES,
    OUTLIERS,
    PLANE_POINTS,
    SAMPLE_SIZE,
    SAMPLED_PER_POINT,
    WANTED_FROM,
)
from gppcs.spatial.cells import greatest_in_cells
from gppcs.spatial.kdtree import KdTree, leaf_range
from gppcs.spatial.samples import point_hashes, short_hashes
from gppcs.spatial.spacing import surface_area
from gppcs.surface.noise import Noise
from gppcs.surface.quadrics import Quadrics
from gppcs.surface.surface_variation import features_in_radius

ALIKE = 0.8  # A ball whose radius is at least this fraction of that for planes is enlarged to that radius.
RANDOM_BITS = 16  # Of a rank, the last. The others are the first of a float32 that is not negative, in its order.

Ranks = NDArray[np.uint32]


class Measured(NamedTuple):
    """What is measured on a cloud of N points, or on a sample of n of them."""

    area: float  # Of the surface
    noise: Noise
    # (N,), by which the candidate of a cell is chosen: surface variation in a ball about as wide as the cell, and that
    # of the detail, where both are measured; then a random number, by which samples are drawn.
    ranks: Ranks
    detail: Detail | None = None
    # What is missing of these, the placement finds itself.
    tree: KdTree | None = None  # Over the n points
    normals: Floats | None = None  # (n, 3), of the planes of these balls, in tree order, if the placement can take them
    quadrics: Quadrics | None = None  # Around the n points, in tree order


def survey(
    points: Floats,
    n_points: int,
    candidate_density: float,
    timer: Timer,
    attributes: NDArray[np.float32] | None = None,
    scale: Scale | None = None,
    hashes: Ranks | None = None,
) -> Measured:
    """Measure a cloud, (N, 3), or a sample of it, unless a scale tells. Shapes: attributes (N, k), hashes (N,)."""
    with timer("sample"):
        ranks = short_hashes(points, RANDOM_BITS) if hashes is None else hashes.copy()
        indices = sample(ranks, n_points)
        sampled = points if len(indices) == len(points) else points.take(indices, axis=0)
    with timer("tree"):
        tree = KdTree.build(sampled)
        if scale is None:
            area, _ = thinned(sampled, ranks[indices], n_points, surface_area(tree), candidate_density)
        else:
            area = scale.stages[0].spacing ** 2 * n_points
    with timer("noise"):
        if scale is None:
            noise = Noise.measure(tree, n_points, math.sqrt(area / n_points))
        else:
            noise = replace(scale.noise, tree=None if scale.noise.is_negligible else tree)
    of_tree = tree.order if sampled is points else indices[tree.order]
    sharpness, normals = np.zeros(len(indices), dtype=np.float32), None
    if noise.is_below_threshold:  # otherwise noisy points would look sharp
        with timer("candidates"):
            edge, plane = cell_edge(area, candidate_density * n_points), radius_of_plane(area / len(sampled))
            radius = plane if edge < plane < edge / ALIKE else edge
            features = features_in_radius(tree.in_own_order(), radius)
            sharpness += sharpness_of(features.surface_variation)
            if sampled is points and plane <= radius <= plane / ALIKE:
                normals = features.normals
    detail = None
    if attributes is not None:
        with timer("detail"):
            detail = Detail.measure(tree, indices, attributes, cell_edge(area, candidate_density * n_points))
            sharpness += 0.0 if detail is None else detail.variation[of_tree]
    bits = sharpness.view(np.uint32) >> RANDOM_BITS << RANDOM_BITS
    bits |= ranks.take(of_tree)
    ranks[of_tree] = bits
    return Measured(area, noise, ranks, detail, tree, normals)


def sample_size(n_points: int) -> int:
    """Return of how many points, about, a sample of a large cloud consists."""
    return max(SAMPLE_SIZE, SAMPLED_PER_POINT * n_points)


def sample(ranks: Ranks, n_points: int) -> Ints:
    """Return all indices, or those of a random sample of a large cloud, ascending, by random ranks, (N,)."""
    n, size = len(ranks), sample_size(n_points)
    if n <= 1.5 * size:  # to draw most of the points would cost more than it saves
        return np.arange(n)
    return drawn(ranks, size / n)


def drawn(ranks: Ranks, fraction: float) -> Ints:
    """Return the indices of about a fraction of the points, those of the highest random bits of ranks, (N,)."""
    return np.flatnonzero(ranks.astype(np.uint16) >= round((1.0 - fraction) * 2**RANDOM_BITS))


def cells_for(wanted: float, n: int, n_points: int, density_power: float) -> float:
    """Return the number of candidate cells for each point to keep: as many as wanted, or fewer where many are kept.

    The larger the power of the density, the more points are wanted on features.
    """
    return min(wanted, max(1.0, density_power) * max(FEWEST_CELLS, wanted * n / (WANTED_FROM * n_points)))


def sharpness_of(variation: Floats) -> Floats:
    """Return the surface variation, (n,), but 0 where it is rounding, which changes with the position of the cloud."""
    return np.where(variation > VARIATION_ROUNDING, variation, 0.0)


class Stage(NamedTuple):
    """A stage of the choice, and its candidates."""

    target: int  # Number of points that are chosen when the stage ends, if no tile is finished
    indices: Ints  # (n,), indices of the candidates, ascending
    thinned: bool  # Whether they are one in each cell; otherwise those of the next finer stage, or all points
    area: float  # Area of the surface, corrected by the number of occupied cells
    tree: KdTree | None = None  # Over the candidates, in units of the target spacing, if there is one
    largest_gap: float = math.inf  # Distance from all others, in target spacings, beyond which points are excluded

    @property
    def spacing(self) -> float:
        """The target spacing h (Eq. (1))."""
        return cell_edge(self.area, self.target)


def nested_candidates(
    points: Floats,
    ranks: Ranks,
    n_points: int,
    area: float,
    candidate_density: float,
    fixed: int = 0,
    largest: float | None = None,
    finished: int = 0,
) -> list[Stage]:
    """Return all stages, from coarse to fine. The candidates of a coarse stage are among those of the finer.

    The candidate of a grid's cell is its point of the highest rank. Outliers are excluded. If that leaves too few, a
    stage takes the candidates of the finer stage, and the last stage takes all points. The first `fixed` points are
    candidates of each stage, which aims at more. Those of finished tiles have their full density.

    Shapes: points (N, 3), ranks (N,).
    """
    thin = thinned if largest is None else sharpest_in_cells  # of a part, whose area is measured in the whole
    area, indices = thin(points, ranks, n_points, area, candidate_density)
    if enough := len(indices) >= MIN_CANDIDATES * n_points:
        tree = KdTree.build(points.take(indices, axis=0) / cell_edge(area, n_points))
        gaps = gaps_of_isolated(tree)
        if largest is None:
            isolated = np.count_nonzero(gaps[gaps > 0.0, None] > ISOLATION, axis=0)
            largest = largest_gap(isolated, len(indices), n_points)
        stays = gaps <= largest
        indices = indices[stays]
        stages = [Stage(n_points, indices, True, area, tree if stays.all() else None, largest)]
    else:
        indices = np.arange(len(points))
        stages = [Stage(n_points, indices, False, area)]
    while stages[-1].target > max(FIRST_STAGE, 2 * (fixed - finished) / (1.0 - finished / n_points)):
        target = -(-stages[-1].target // 2)
        area, kept = thin(points.take(indices, axis=0), ranks[indices], target, area, candidate_density)
        if enough := len(kept) >= MIN_CANDIDATES * target:
            indices = indices[kept]
        stages.append(Stage(target, indices, enough, area))
    if fixed:
        first = np.arange(fixed)
        stages = [
            stage._replace(indices=np.concatenate([first, stage.indices[stage.indices >= fixed]]), tree=None)
            for stage in stages
        ]
    return stages[::-1]


def gaps_of_isolated(tree: KdTree) -> Floats:
    """Return how far isolated candidates, the n points of a tree, are from all others, in its unit; 0 for others."""
    n, radius = len(tree.order), ISOLATION[0]
    suspects = np.ones(n, dtype=bool)
    on_ranges(_clear_leaves, tree.leaves, tree.points, tree.leaves, radius * radius, suspects, minimum=64)
    gaps = np.full(n, 0.0 if n > 1 else np.inf)
    if n > 1:
        queries = np.ascontiguousarray(tree.points[:, suspects].T)
        nearest = np.sqrt(tree.nearest_of(queries, 2)[1][:, 1])
        gaps[tree.order[suspects]] = np.where(nearest > radius, nearest, 0.0)
    return gaps


@kernel(allocates=False)
def _clear_leaves(begin, end, points, leaves, squared_radius, suspects):
    """Clear suspects, (n,), that have another of the points, (3, n), of their leaf within a radius."""
    for leaf in range(leaves + begin, leaves + end):
        first, last = leaf_range(points.shape[1], leaves, leaf)
        for i in range(first, last):
            for j in range(first, last):
                x, y, z = points[0, j] - points[0, i], points[1, j] - points[1, i], points[2, j] - points[2, i]
                if j != i and x * x + y * y + z * z <= squared_radius:
                    suspects[i] = False
                    break


def largest_gap(isolated: Ints, n: int, n_points: int) -> float:
    """Return how far from all others a candidate may be, by how many of n are farther than each of `ISOLATION`, (4,).

    On a surface, along a wire and in a cluster, candidates are about as near each other as their cells. In sparse parts
    of a scan some are isolated, but their number falls fast with the distance. That of scattered outliers, which are
    excluded, does not.
    """
    harmless = 0.003 * n_points  # so few may stay, whatever they are
    for distance, (n_isolated, n_isolated_twice) in zip(ISOLATION, pairwise(isolated), strict=False):
        if harmless < n_isolated <= n - MIN_CANDIDATES * n_points and n_isolated_twice > OUTLIERS * n_isolated:
            return distance
    return math.inf


def radius_of_plane(area: float) -> float:
    """Return the radius of a ball with `PLANE_POINTS` points, by the area for each."""
    return math.sqrt(PLANE_POINTS * area / math.pi)


def cell_edge(area: float, cells: float) -> float:
    """Return the edge length of the cells when so many squares cover the area."""
    return math.sqrt(area / cells) or 1.0


def sharpest_in_cells(
    points: Floats, ranks: Ranks, target: int, area: float, candidate_density: float
) -> tuple[float, Ints]:
    """Return the area, and the points of the highest ranks in the cells that fit it."""
    return area, greatest_in_cells(points, cell_edge(area, candidate_density * target), ranks)


def thinned(points: Floats, ranks: Ranks, target: int, area: float, candidate_density: float) -> tuple[float, Ints]:
    """Return the area, doubled or halved until the occupied cells fit it, and their points of the highest ranks.

    The estimate is too small for points on curves, and too large for a cloud with most points in one spot.
    """
    many, cells = MAX_CELLS * candidate_density * target, candidate_density * target

    def coarsened(area: float) -> tuple[float, Ints]:
        """Double the area until there are not too many occupied cells."""
        return next((grown, kept) for grown, kept in _grids(points, ranks, area, cells) if len(kept) <= many)

    grown, kept = coarsened(area)
    if grown == area and len(kept) < MIN_CANDIDATES * target and len(points) > many:
        return coarsened(_halved(points, ranks, target, area, candidate_density))
    return grown, kept


def _halved(points: Floats, ranks: Ranks, target: int, area: float, candidate_density: float) -> float:
    """Return the area, halved until enough cells hold points: first by a sample, then by all points."""
    few, cells = MIN_CANDIDATES * target, candidate_density * target
    is_sampled = point_hashes(points) % np.uint64(len(points) // int(MAX_CELLS * cells)) == 0
    sampled, sampled_ranks = points[is_sampled], ranks[is_sampled]
    halvings = 1
    while area * 0.5**halvings > 1e-200:  # before it becomes zero
        if len(greatest_in_cells(sampled, cell_edge(area * 0.5**halvings, cells), sampled_ranks)) >= few:
            break
        halvings += 4  # the loop below takes back what is too much
    result = area * 0.5**halvings
    for _, (coarser, kept) in zip(range(halvings), _grids(points, ranks, result, cells), strict=False):
        if len(kept) >= few:
            result = coarser
    return result


def _grids(points: Floats, ranks: Ranks, area: float, cells: float) -> Iterator[tuple[float, Ints]]:
    """Yield an area and the points of the highest ranks in its cells, then twice the area, and so on."""
    finer = last = None
    while True:
        edge = cell_edge(area, cells)  # twice that of two steps before, whose points hold those of this grid
        if finer is None:
            kept = greatest_in_cells(points, edge, ranks)
        else:
            kept = finer[greatest_in_cells(points.take(finer, axis=0), edge, ranks[finer])]
        finer, last = last, kept
        yield area, kept
        area *= 2.0
