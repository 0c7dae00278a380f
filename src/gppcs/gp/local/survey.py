"""Measurements on the whole cloud before any point is chosen: area, noise and sharp places."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.stages import Stages
from gppcs.gp.local.candidates import corrected_area
from gppcs.gp.local.density import ROUNDING
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
    sharpness : (N,) array, float32
        Surface variation within the edge length of a candidate's cell. It is 0 where there is noise, where it was not
        measured, and where it is only rounding.
    """

    area: float
    noise: Noise
    sharpness: NDArray[np.float32]


def survey(points: NDArray[np.float64], n_points: int, density: float, clock: Stages) -> Survey:
    """Measure a cloud.

    Parameters
    ----------
    points : (N, 3) array
        Without repeats.
    n_points : int
        M, the number of points to keep.
    density : float
        Candidate cells in a square whose side is the target spacing.
    clock : Stages
        Times "tree", "noise" and "candidates".

    Returns
    -------
    Survey
    """
    with clock("tree"):
        tree, sampled = sampled_tree(points, n_points)
        area = corrected_area(points[sampled], n_points, surface_area(tree), density)
    with clock("noise"):
        noise = Noise.measure(tree, n_points, math.sqrt(area / n_points))
    with clock("candidates"):
        sharpness = np.zeros(len(points), dtype=np.float32)
        if noise.quiet:  # otherwise noisy points would look sharp
            sharpness[sampled] = sharpness_of(tree, area, density * n_points)
    return Survey(area, noise, sharpness)


def sampled_tree(points: NDArray[np.float64], n_points: int) -> tuple[KdTree, NDArray[np.int64] | slice]:
    """Return a tree over all points, or over a random sample of a large cloud, and the rows that it holds.

    A sample measures the area as well as all points do, and the noise, unless that is thicker than the
    target spacing: then a sample has too few points for the widest neighbourhoods.

    Parameters
    ----------
    points : (N, 3) array
    n_points : int
        M, the number of points to keep.

    Returns
    -------
    tree : KdTree
    rows : (n,) array, int64, or slice
        Ascending.
    """
    enough = max(LARGE, PER_POINT * n_points)
    if len(points) <= 1.5 * enough:
        return KdTree.build(points), slice(None)
    draws = round(-len(points) * math.log1p(-enough / len(points)))  # with replacement: some rows are drawn twice
    taken = np.zeros(len(points), dtype=np.bool_)
    taken[np.random.default_rng(0).integers(0, len(points), draws)] = True
    indices = np.flatnonzero(taken)
    return KdTree.build(points[indices]), indices


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
