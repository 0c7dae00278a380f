"""Measurements on the whole cloud before any point is chosen: area, noise and sharp places."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.stages import Stages
from gppcs.gp.local.candidates import corrected_area
from gppcs.gp.local.density import ROUNDING
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.chunks import ALIKE, ChunkedPoints, SparseValues
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area
from gppcs.surface.noise import Noise
from gppcs.surface.surface_variation import variation_in_radius

LARGE = 100_000  # A larger cloud is sampled, as a tree over many millions takes longer than the choice.
PER_POINT = 26  # Sampled points for each point to keep: about as many as measuring the noise needs.
PER_CELL = 25  # Points of a cell whose sharpness is measured. The cost grows as their square, the gain is small.


class Survey(NamedTuple):
    """What is known of a cloud of N points before the choice.

    Attributes
    ----------
    area : float
        Area of the surface, corrected by the number of occupied cells.
    noise : Noise
    sharpness : SparseValues
        Surface variation within the edge length of a candidate's cell. It is 0 if the cloud is not clean, where it was
        not measured, and where it is only rounding.
    """

    area: float
    noise: Noise
    sharpness: SparseValues


def survey(points: ChunkedPoints, n_points: int, density: float, clock: Stages) -> Survey:
    """Measure a cloud. This takes one pass over its points.

    Parameters
    ----------
    points : ChunkedPoints
        N points. They may repeat each other if `is_sampled`.
    n_points : int
        M, the number of points to keep.
    density : float
        Candidate cells in a square whose side is the target spacing.
    clock : Stages
        Times "sample", "tree", "noise" and "candidates". A step of the first is a point read.

    Returns
    -------
    Survey
    """
    with clock("sample", len(points)) as advanced:
        rows, places = sample(points, n_points, advanced)
    with clock("tree"):
        tree = KdTree.build(places)
        area = corrected_area(places, n_points, surface_area(tree), density)
    with clock("noise"):
        noise = Noise.measure(tree, n_points, math.sqrt(area / n_points))
    with clock("candidates"):
        sharpness = ALIKE
        if noise.clean:  # otherwise noisy points would look sharp
            sharpness = SparseValues(rows, sharpness_of(tree, area, density * n_points).astype(np.float32))
    return Survey(area, noise, sharpness)


def is_sampled(n: int, n_points: int) -> bool:
    """Return whether a cloud is so large that only some of its points are measured.

    Parameters
    ----------
    n : int
        N, the number of points.
    n_points : int
        M, the number of points to keep.

    Returns
    -------
    bool
    """
    return n > 1.5 * sample_size(n_points)


def sample_size(n_points: int) -> int:
    """Return of how many points, about, a sample of a large cloud consists.

    Parameters
    ----------
    n_points : int
        M, the number of points to keep.

    Returns
    -------
    int
    """
    return max(LARGE, PER_POINT * n_points)


def sample(
    points: ChunkedPoints, n_points: int, advanced: Callable[[int], None]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return all points, or a random sample of a large cloud without the repeats among them, in one pass.

    A sample measures the area as well as all points do, and the noise, unless that is thicker than the
    target spacing: then a sample has too few points for the widest neighbourhoods.

    Parameters
    ----------
    points : ChunkedPoints
    n_points : int
        M, the number of points to keep.
    advanced : callable
        Is called with the number of points read since the last call.

    Returns
    -------
    rows : (n,) array, int64
        Ascending.
    places : (n, 3) array
    """
    n = len(points)
    if not is_sampled(n, n_points):
        return np.arange(n), points.every(1, advanced)
    draws = round(-n * math.log1p(-sample_size(n_points) / n))  # with replacement: some rows are drawn twice
    rows = np.unique(np.random.default_rng(0).integers(0, n, draws))
    places = points.take(rows, advanced)
    first = first_occurrences(places)
    return rows[first], places[first]


def sharpness_of(tree: KdTree, area: float, cells: float) -> NDArray[np.float64]:
    """Return the surface variation of points within the edge length of a cell.

    Of the points in a cell with a crease through it, those on the crease have the most. Rounding counts as none, as it
    changes with the place of the cloud. If there are far more points than cells, only some are measured, evenly spread
    over the tree.

    Parameters
    ----------
    tree : KdTree
        Over N points.
    area : float
        Area of the surface.
    cells : float
        Number of square cells that cover the area.

    Returns
    -------
    (N,) array
        In the tree's input order; 0 where it was not measured.
    """
    some = slice(None, None, max(1, len(tree.order) // math.ceil(PER_CELL * cells)))
    measured = KdTree.over(np.ascontiguousarray(tree.points[:, some]))
    variation = variation_in_radius(measured, math.sqrt(area / cells) or 1.0)
    sharpness = np.zeros(len(tree.order))
    sharpness[tree.order[some]] = np.where(variation > ROUNDING, variation, 0.0)
    return sharpness
