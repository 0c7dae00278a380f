"""Measurements on the whole cloud before any point is chosen: area, noise and sharp places."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.timer import Timer
from gppcs.gp.local.candidates import cell_edge, thinned
from gppcs.gp.local.density import ROUNDING
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area
from gppcs.surface.noise import Noise
from gppcs.surface.surface_variation import features_in_radius

LARGE = 100_000  # A larger cloud is sampled, as a tree over many millions takes longer than the choice.
PER_POINT = 26  # Sampled points for each point to keep: about as many as measuring the noise needs.


class Survey(NamedTuple):
    """What is known of a cloud of N points before the choice.

    Attributes
    ----------
    area : float
        Area of the surface, corrected by the number of occupied cells.
    noise : Noise
    sharpness : (N,) array, float32
        Surface variation within the edge length of a candidate's cell. It is 0 if the cloud is not clean, where it was
        not measured, and where it is only rounding.
    """

    area: float
    noise: Noise
    sharpness: NDArray[np.float32]


def survey(points: NDArray[np.float64], n_points: int, density: float, timer: Timer) -> Survey:
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
    return Survey(area, noise, sharpness)


def sample_size(n_points: int) -> int:
    """Return of how many points, about, a sample of a large cloud consists."""
    return max(LARGE, PER_POINT * n_points)


def sample(points: NDArray[np.float64], n_points: int) -> NDArray[np.int64]:
    """Return all rows, or those of a random sample of a large cloud without the repeats among them, ascending.

    A sample measures the area as well as all points do, and the noise, unless that is thicker than the
    target spacing: then a sample has too few points for the widest neighbourhoods.
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
