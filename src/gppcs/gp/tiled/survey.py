"""Measurements on a cloud on disk, tile by tile, as `gppcs.gp.local.survey` makes them in memory: area and noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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
from gppcs.surface.noise import FEWEST, NEIGHBOURS, SAMPLES, WIDEST, Layer, Noise, projections

HALO = 4.0  # In rough target spacings: 120 of 26 points in a square spacing lie within 1.2 of them.
DISCS = 16_384  # Points whose neighbours tell the area, as `surface_area` takes them.
NEIGHBOURS_OF_DISC = 8
NOISE_TILES = 64  # Tiles in which the noise is measured, at most.


class TiledSurvey(NamedTuple):
    """What is known of a cloud before the choice.

    Attributes
    ----------
    area : float
        Area of the surface, not yet corrected by the number of occupied cells.
    noise : Noise
    share : float
        The share of the points that are sampled.
    """

    area: float
    noise: Noise
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
    share = min(1.0, sample_size(n_points) / int(points.counts.sum()))
    halo = HALO * math.sqrt(area / n_points)
    measure, found = partial(_discs, points, share, halo), []
    for tile, measured in zip(tiles, each(measure, tiles), strict=True):
        found.append(measured)
        advanced(int(points.counts[tile.first : tile.last].sum()))
    places = sum(count for count, _ in found)
    squared = np.concatenate([discs for _, discs in found])
    area = float(np.pi / NEIGHBOURS_OF_DISC * places * np.minimum(squared, np.quantile(squared, 0.99)).mean())
    noise = _noise(points, tiles, share, halo, places, n_points, area, each)
    return TiledSurvey(area, noise, share)


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


def _sampled_tree(points: StoredPoints, share: float, halo: float, tile: Tile) -> tuple[KdTree, NDArray[np.int64]]:
    """Return a tree over the sampled points of a tile and its halo, and the positions of those in the tile itself."""
    near = points.near(tile, halo)
    some = sampled_places(near, share)
    tree = KdTree.build(near.points[some] if len(some) else near.points[:1])
    return tree, np.flatnonzero(near.inside[some][tree.order]) if len(some) else np.empty(0, dtype=np.int64)


def _discs(points: StoredPoints, share: float, halo: float, tile: Tile) -> tuple[int, NDArray[np.float64]]:
    """Return the number of sampled points of a tile, and squared distances of some to their 8th neighbours."""
    tree, inside = _sampled_tree(points, share, halo, tile)
    step = max(1, round(share * int(points.counts.sum()) / DISCS))
    queries = np.ascontiguousarray(tree.points[:, inside[::step]].T)
    k = min(NEIGHBOURS_OF_DISC, len(tree.order) - 1)
    return len(inside), tree.nearest_of(queries, k + 1)[1][:, -1]


def _noise(
    points: StoredPoints,
    tiles: Sequence[Tile],
    share: float,
    halo: float,
    places: int,
    n_points: int,
    area: float,
    each: Each,
) -> Noise:
    """Measure the noise as `Noise.measure` does, in some tiles, given the number of sampled points of all tiles."""
    within, spacing = int(np.pi * places / n_points), math.sqrt(area / n_points)
    layers: dict[int, Layer] = {}
    if within >= FEWEST:
        fits = sorted({*(NEIGHBOURS << i for i in range((WIDEST // NEIGHBOURS).bit_length())), min(within, WIDEST)})
        some = tiles[:: -(-len(tiles) // NOISE_TILES)]
        step = max(1, round(places * len(some) / len(tiles) / SAMPLES))
        found = np.concatenate(list(each(partial(_distances, points, share, halo, fits, step), some)), axis=2)
        layers = {k: Layer.of(*of_fit) for k, of_fit in zip(fits, found, strict=True)}
    return Noise.from_layers(layers.__getitem__, within, spacing)


def _distances(
    points: StoredPoints, share: float, halo: float, fits: Sequence[int], step: int, tile: Tile
) -> NDArray[np.float64]:
    """Return how far each `step`-th point of a tile lies off quadrics, and the radii of their neighbourhoods.

    Shape: (numbers of neighbours, 2, points).
    """
    tree, inside = _sampled_tree(points, share, halo, tile)
    inside = inside[::step]
    found = np.zeros((len(fits), 2, len(inside)))
    if len(inside):
        places = KdTree.over(np.ascontiguousarray(tree.points[:, inside]))
        for row, count in enumerate(fits):
            feet, radii = projections(tree, places, count)
            found[row] = np.sqrt(((feet.points - places.points) ** 2).sum(axis=0)), radii
    return found
