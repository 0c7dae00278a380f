"""The cells of a cloud on disk: the same as in memory, found tile by tile."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.stages import Stages
from gppcs.methods.voxel.grid import representatives, searched_edge
from gppcs.spatial.boxes import Each, Tile
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.row_sample import place_hashes
from gppcs.spatial.stored import StoredPoints, store

TILE = 1 << 19  # Points of a tile at most.


class Representatives(NamedTuple):
    """One point for each occupied cell.

    Attributes
    ----------
    rows : (cells,) array, int64
        Ascending.
    places, means : (cells, 3) arrays
        The points, and the means of all points of their cells.
    """

    rows: NDArray[np.int64]
    places: NDArray[np.float64]
    means: NDArray[np.float64]


def representatives_in_tiles(
    points: ChunkedPoints, n_points: int, folder: Path, stages: Stages, each: Each
) -> Representatives:
    """Return the points that stand for their cells, where at least M cells are occupied, and few more.

    Parameters
    ----------
    points : ChunkedPoints
        N points, which may repeat each other.
    n_points : int
        M.
    folder : path
        An empty folder. It takes 32 bytes for each point.
    stages : Stages
        Times "sample", "boxes", "size of cells" and "representatives".
    each : callable
        Applies a function to each tile, like `map`.

    Returns
    -------
    Representatives
        Of all places, if these are not more than M.
    """
    stored, _ = store(points, folder, stages)
    tiles = stored.boxes.tiles(stored.counts, TILE)

    def occupied(edge: float) -> int:
        found = np.empty(0, dtype=np.uint64)
        for some in each(partial(_cells, stored, corner, edge), tiles):
            found = np.union1d(found, some)
        return len(found)

    with stages("size of cells"):
        bounds = np.array(list(each(partial(_bounds, stored), tiles)))
        corner = bounds[:, 0].min(axis=0)
        size = float((bounds[:, 1] - corner).max())
        enough = size > 0.0 and occupied(0.0) > n_points
        edge = searched_edge(size, n_points, occupied) if enough else 0.0
    with stages("representatives"):
        found = list(each(partial(_representatives, stored, corner, edge), tiles))
    rows, places, means = (np.concatenate(columns) for columns in zip(*found, strict=True))
    order = np.argsort(rows)
    return Representatives(rows[order], places[order], means[order] + corner)


def _bounds(points: StoredPoints, tile: Tile) -> NDArray[np.float64]:
    """Return lowest and highest coordinates, (2, 3)."""
    places = points.inside(tile)
    return np.array([places.min(axis=0), places.max(axis=0)])


def _cells(points: StoredPoints, corner: NDArray[np.float64], edge: float, tile: Tile) -> NDArray[np.uint64]:
    """Return a number for each occupied cell of a tile, or without an edge length for each place."""
    local = points.inside(tile) - corner
    return np.unique(place_hashes(np.floor(local / edge) if edge else local))


def _representatives(points: StoredPoints, corner: NDArray[np.float64], edge: float, tile: Tile) -> Representatives:
    """Return the points of a tile that stand for their cells, or all without repeats; means without the corner."""
    near = points.near(tile, edge)
    first = np.flatnonzero(first_occurrences(near.points))
    local = near.points[first] - corner
    indices, means = representatives(local, edge) if edge else (np.arange(len(first)), local)
    own = near.inside[first[indices]]
    chosen = first[indices[own]]
    return Representatives(near.rows[chosen], near.points[chosen], means[own])
