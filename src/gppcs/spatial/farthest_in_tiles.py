"""Farthest point sampling of a cloud on disk, tile by tile.

All tiles choose down to one distance; it is lowered level by level until enough points are chosen. A tile chooses with
a halo, keeps what lies in itself, and takes what the tiles of earlier classes chose in its halo as given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.stages import Stages
from gppcs.spatial.boxes import Each, Tile, classes
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.stored import StoredPoints

TILE = 1 << 19  # Points of a tile at most.
FIRST = 4096  # Points that the first level chooses, about: so many of a sample tell its distance.
LEVEL_HALO = 3.0  # In units of the distance of the level.
SPARE = 1.05  # Points chosen for each one wanted: the last level is aimed a little too low.
LEAST_STEP = 0.5  # From one level to the next, at most.
NEGLIGIBLE = 1e-150  # A smaller distance counts as none; its square would vanish.


class Farthest(NamedTuple):
    """Chosen points, the farthest first.

    Attributes
    ----------
    rows : (n,) array, int64
    places : (n, 3) array
    distances : (n,) array
        Distance of each to the points that were chosen before it.
    """

    rows: NDArray[np.int64]
    places: NDArray[np.float64]
    distances: NDArray[np.float64]


def farthest_in_tiles(
    points: StoredPoints, sample: NDArray[np.float64], n_points: int, stages: Stages, each: Each
) -> NDArray[np.int64]:
    """Choose points that are far from each other.

    Parameters
    ----------
    points : StoredPoints
        N points, which may repeat each other.
    sample : (n, 3) array
        A random sample of them.
    n_points : int
        M.
    stages : Stages
        Times "farthest points". A step is a chosen point.
    each : callable
        Applies a function to each tile, like `map`.

    Returns
    -------
    (M,) array, int64
        Rows, the farthest first; fewer than M if there are fewer different places.
    """
    first = min(FIRST, n_points, len(sample))
    level = float(farthest_points(sample, first)[1][-1]) if first > 1 else math.inf
    empty = Farthest(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty(0))
    tiles, chosen = points.boxes.tiles(points.counts, TILE), empty
    with stages("farthest points", n_points) as advanced:
        while len(chosen.rows) < n_points:
            before = len(chosen.rows)
            for added in _round(points, tiles, chosen, level, each):
                chosen = Farthest._make(map(np.concatenate, zip(chosen, added, strict=True)))
            advanced(max(0, min(len(chosen.rows), n_points) - before))
            if level == 0.0:
                break
            step = math.sqrt(max(1, len(chosen.rows)) / (SPARE * n_points))
            level = _lower(level, step) if math.isfinite(level) else 0.0
    order = np.lexsort([chosen.rows, -chosen.distances])
    return chosen.rows[order[:n_points]]


def _lower(level: float, step: float) -> float:
    """Return the next level; zero, with which every place is chosen, once it is negligible."""
    lower = level * max(LEAST_STEP, step)
    return lower if lower > NEGLIGIBLE and lower < level else 0.0


def _round(points: StoredPoints, tiles: list[Tile], chosen: Farthest, level: float, each: Each) -> Iterator[Farthest]:
    """Yield what each class of tiles chooses down to a level, after what is `chosen`."""
    halo = LEVEL_HALO * level if math.isfinite(level) else 0.0
    settled, known = np.zeros(len(points.boxes), dtype=np.bool_), chosen.places
    for some in classes(tiles, halo):
        asked = [_Asked(tile, _within(known, tile, halo)) for tile in some]
        parts = list(each(partial(_choose, points, level, halo, settled), asked))
        added = Farthest._make(map(np.concatenate, zip(*parts, strict=True)))
        known = np.concatenate([known, added.places])
        settled = settled.copy()
        for tile in some:
            settled[tile.first : tile.last] = True
        yield added


class _Asked(NamedTuple):
    """A tile, and what is chosen in it and its halo, (n, 3)."""

    tile: Tile
    others: NDArray[np.float64]


def _within(places: NDArray[np.float64], tile: Tile, halo: float) -> NDArray[np.float64]:
    return places[((places >= tile.low - halo) & (places <= tile.high + halo)).all(axis=1)]


def _choose(points: StoredPoints, level: float, halo: float, settled: NDArray[np.bool_], asked: _Asked) -> Farthest:
    """Choose the points of a tile that are at least as far as `level` from others; none in boxes that are `settled`."""
    near = points.near(asked.tile, halo)
    open_ = np.flatnonzero(~settled[points.boxes.box_of(near.points)])
    open_ = open_[first_occurrences(near.points[open_])]
    places = near.points[open_]
    found, distances = farthest_points(places, len(places), others=asked.others, least=max(level, NEGLIGIBLE))
    inside = near.inside[open_[found]]
    found = found[inside]
    return Farthest(near.rows[open_[found]], places[found], distances[inside])
