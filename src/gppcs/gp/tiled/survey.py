"""Measurements on a cloud on disk, tile by tile, as `gppcs.gp.local.survey` makes them in memory: area and noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.gp.local.candidates import corrected_area
from gppcs.gp.local.survey import PER_POINT, sample_size
from gppcs.spatial.boxes import Each, Tile
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.row_sample import drawn
from gppcs.spatial.spacing import surface_area
from gppcs.spatial.stored import Neighbourhood, StoredPoints
from gppcs.surface.noise import FEWEST, NEIGHBOURS, QUIET, SAMPLES, WIDEST, Noise, across_noise, projections

HALO = 4.0  # In rough target spacings: 120 of 26 points in a square spacing lie within 1.2 of them.
DISCS = 16_384  # Points whose neighbours tell the area, as `surface_area` takes them.
NEIGHBOURS_OF_DISC = 8


@dataclass(frozen=True)
class TiledNoise:
    """What `gppcs.surface.noise.Noise` tells, without its tree, which is another in each tile.

    Attributes
    ----------
    neighbours, thick, level, spacing
        As of `Noise`.
    """

    neighbours: int
    thick: bool
    level: float
    spacing: float

    @property
    def quiet(self) -> bool:
        """As of `Noise`."""
        return self.level <= QUIET * self.spacing

    def on(self, tree: KdTree) -> Noise:
        """Return the noise on a tile.

        Parameters
        ----------
        tree : KdTree
            Over the sampled points of the tile and its halo.

        Returns
        -------
        Noise
        """
        return Noise(tree, self.neighbours, self.thick, self.level, self.spacing)


class TiledSurvey(NamedTuple):
    """What is known of a cloud before the choice.

    Attributes
    ----------
    area : float
        Area of the surface, not yet corrected by the number of occupied cells.
    noise : TiledNoise
    share : float
        The share of the points that are sampled.
    """

    area: float
    noise: TiledNoise
    share: float


def rough_area(sample: NDArray[np.float64], density: float) -> float:
    """Return about the area of the surface.

    Parameters
    ----------
    sample : (n, 3) array
        A random sample of the points.
    density : float
        Number of candidate cells in a square whose side is the target spacing.

    Returns
    -------
    float
    """
    places = sample[first_occurrences(sample)]
    return corrected_area(places, max(1, len(places) // PER_POINT), surface_area(KdTree.build(places)), density)


def survey_tiles(
    points: StoredPoints, tiles: Sequence[Tile], n_points: int, area: float, each: Each, advanced: Callable[[int], None]
) -> TiledSurvey:
    """Measure a cloud.

    Parameters
    ----------
    points : StoredPoints
        N points.
    tiles : sequence of Tile
    n_points : int
        M, the number of points to keep.
    area : float
        About the area of the surface.
    each : callable
        Applies a function to all tiles.
    advanced : callable
        Called with the number of points measured since the last call.

    Returns
    -------
    TiledSurvey
    """
    n = int(points.counts.sum())
    share = min(1.0, sample_size(n_points) / n)
    sampled = share * n
    within = int(np.pi * sampled / n_points)
    fits = [NEIGHBOURS << i for i in range((WIDEST // NEIGHBOURS).bit_length())]
    fits = sorted({*fits, min(within, WIDEST)}) if within >= FEWEST else []
    measure = partial(_measured, points, share, HALO * math.sqrt(area / n_points), max(1.0, sampled / DISCS), fits)
    found = []
    for tile, measured in zip(tiles, each(measure, tiles), strict=True):
        found.append(measured)
        advanced(int(points.counts[tile.first : tile.last].sum()))
    squared = np.concatenate([measured.discs for measured in found])
    places = sum(measured.places for measured in found)
    area = np.pi / NEIGHBOURS_OF_DISC * places * np.minimum(squared, np.quantile(squared, 0.99)).mean()
    return TiledSurvey(float(area), _noise([measured.fits for measured in found], fits, within, area, n_points), share)


def sampled_places(near: Neighbourhood, share: float) -> NDArray[np.int64]:
    """Return which points of a neighbourhood are sampled, without repeats among them.

    Parameters
    ----------
    near : Neighbourhood
    share : float
        Of the points.

    Returns
    -------
    (n,) array, int64
        Ascending.
    """
    some = np.flatnonzero(drawn(near.rows, share))
    return some[first_occurrences(near.points[some])]


class _Measured(NamedTuple):
    """What is measured in a tile.

    Attributes
    ----------
    places : int
        Number of sampled points.
    discs : (n,) array
        Squared distances of some of them to their 8th neighbours.
    fits : (fits, 3) array
        For each number of neighbours: the number of measured points, and the sums of the squared distances from the
        quadrics and of the squared radii.
    """

    places: int
    discs: NDArray[np.float64]
    fits: NDArray[np.float64]


def _measured(
    points: StoredPoints, share: float, halo: float, step: float, neighbours: Sequence[int], tile: Tile
) -> _Measured:
    near = points.near(tile, halo)
    some = sampled_places(near, share)
    own = near.inside[some]
    if len(some) == 0 or not own.any():
        return _Measured(0, np.empty(0), np.zeros((len(neighbours), 3)))
    tree = KdTree.build(near.points[some])
    inside = np.flatnonzero(own[tree.order])
    k = min(NEIGHBOURS_OF_DISC, len(some) - 1)
    queries = _every(inside, step)
    discs = tree.nearest_of(np.ascontiguousarray(tree.points[:, queries].T), k + 1)[1][:, -1]
    fits = np.zeros((len(neighbours), 3))
    places = KdTree.over(np.ascontiguousarray(tree.points[:, _every(inside, step * DISCS / SAMPLES)]))
    for row, count in enumerate(neighbours):
        feet, radii = projections(tree, places, count)
        fits[row] = len(radii), ((feet.points - places.points) ** 2).sum(), (radii**2).sum()
    return _Measured(len(inside), discs, fits)


def _every(values: NDArray[np.int64], step: float) -> NDArray[np.int64]:
    """Return about every `step`-th of the values, at least one."""
    return values[np.linspace(0, len(values), max(1, round(len(values) / step)), endpoint=False).astype(np.int64)]


def _noise(
    found: Sequence[NDArray[np.float64]], fits: Sequence[int], within: int, area: float, n_points: int
) -> TiledNoise:
    """Decide about the noise as `Noise.measure` does."""
    spacing = math.sqrt(area / n_points)
    if not fits:
        return TiledNoise(within, False, 0.0, spacing)
    total = np.sum(found, axis=0)
    measured = {k: tuple(np.sqrt(sums[1:] / sums[0])) for k, sums in zip(fits, total, strict=True)}
    neighbours, level = across_noise(measured.__getitem__)
    thick = neighbours > NEIGHBOURS
    if neighbours > within:
        neighbours, level = within, measured[within][0]
    return TiledNoise(neighbours, thick, float(level), spacing)
