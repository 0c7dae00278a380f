"""Outliers of a cloud on disk: each tile is looked at with a halo, and what that does not tell across all tiles."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.journal import Journal
from gppcs.engine.stages import Stages
from gppcs.spatial.boxes import Boxes, Each, Tile
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.stored import BYTES_ON_DISK, StoredPoints, store
from gppcs.surface.outliers.definition import NEIGHBOURS, look_at
from gppcs.surface.outliers.rounds import Content, Part, Points, all_outliers, joined, repeating

TILE = 1 << 18  # Points of a tile at most.
HALO = 1 << 18  # Points of its halo at most.
TRIED = 1 << 10  # Points of a tile that tell how wide the halo must be.
SHARE = 0.95  # Of these points, the neighbours and theirs are to be in the halo.
WIDER = 2.5  # Width of the halo, relative to the distance to the 16th neighbour: these have neighbours, too.
HALVED = 8  # A halo that is too large is halved so often at most.
IN_MEMORY = 130  # Bytes of memory for each point, where all are looked at at once.
IN_TILE = 320  # Bytes of memory for each point of a tile and its halo.
LOOKED_UP = 0.05  # At most about this share of the points are outliers, or their tiles do not tell it.
OF_LOOKED_UP = 160  # Bytes of memory for each of these.
ON_DISK = BYTES_ON_DISK + 46  # Bytes for each point: it is stored by boxes, and again in the tree of its tile.


def memory_of_outliers(n: int) -> int:
    """Return about how much memory `outliers_in_tiles` takes, beyond one chunk of points.

    Parameters
    ----------
    n : int
        Number of points.

    Returns
    -------
    int
        Bytes.
    """
    return IN_TILE * min(n, TILE + HALO) + round(OF_LOOKED_UP * LOOKED_UP * n)


def outliers_in_tiles(
    points: ChunkedPoints, high: NDArray[np.float64], folder: Path, stages: Stages, each: Each
) -> NDArray[np.int64]:
    """Find the outliers of a cloud: the same ones as `find_outliers`.

    Parameters
    ----------
    points : ChunkedPoints
        Finite, in the frame around them.
    high : (3,) array
        Upper corner of their bounding box; the lower one is the origin.
    folder : path
        An empty folder, or that of an interrupted call. It takes `ON_DISK` bytes for each point.
    stages : Stages
        Times "sample", "boxes" and "outliers". A step is a point.
    each : callable
        Applies a function to each tile, like `map`.

    Returns
    -------
    (n,) array, int64
        Their rows, ascending.
    """
    stored, _ = store(points, folder, stages)
    tiles = stored.boxes.tiles(stored.counts, TILE)

    def looks() -> list[_Look]:
        found = []
        with stages("outliers", len(points)) as advanced:
            for look in each(partial(_look, stored, high), [*enumerate(tiles)]):
                found.append(look)
                advanced(look.total)
        return found

    seen = Journal(folder).once("looks", looks)
    if sum(look.different for look in seen) <= NEIGHBOURS + 1:
        return np.empty(0, dtype=np.int64)
    with stages("outliers"):
        parts = [_part(stored, tile, look.different) for tile, look in zip(tiles, seen, strict=True)]
        outside, undecided = joined([look.outside for look in seen]), joined([look.undecided for look in seen])
        gone = all_outliers(parts, outside, undecided, each)
        asked = [_Gone(*of) for of in zip(tiles, gone, (look.total > look.different for look in seen), strict=True)]
        rows = list(each(partial(_rows, stored), [some for some in asked if len(some.positions)]))
    return np.sort(np.concatenate([np.empty(0, dtype=np.int64), *rows]))


class _Look(NamedTuple):
    """What a tile and its halo tell.

    `total` is the number of points of the tile, and `different` that of their places; `outside` are outliers, and
    `undecided` the points of which they do not tell it.
    """

    total: int
    different: int
    outside: Points
    undecided: Points


def _look(stored: StoredPoints, high: NDArray[np.float64], asked: tuple[int, Tile]) -> _Look:
    """Look at the points of a tile, and store its tree."""
    number, tile = asked
    own = stored.own(tile)
    firsts = first_occurrences(own.points)
    rows, places = own.rows[firsts], own.points[firsts]
    tree = KdTree.build(places)
    places = np.ascontiguousarray(tree.points.T)
    around, width = _halo(stored, tile, tree)
    low, top = tile.low - width, tile.high + width
    low, top = np.where(low <= 0.0, -np.inf, low), np.where(top >= high, np.inf, top)  # beyond there are no points
    near = np.concatenate([places, around])
    look = look_at(KdTree.build(near), len(places), np.minimum(near - low, top - near).min(axis=1))
    _save(stored.folder, tile, rows[tree.order], tree, look.reach)

    def some(positions: NDArray[np.int64]) -> Points:
        return Points(np.full(len(positions), number), positions, places[positions], look.reach[positions])

    return _Look(len(own.rows), len(places), some(look.outside), some(look.undecided))


def _halo(stored: StoredPoints, tile: Tile, tree: KdTree) -> tuple[NDArray[np.float64], float]:
    """Return the different places around a tile with a tree, up to a width; and this width."""
    n = len(tree.order)
    if n > NEIGHBOURS:
        tried = np.ascontiguousarray(tree.points[:, np.linspace(0, n - 1, min(n, TRIED)).astype(np.int64)].T)
        reach = tree.nearest_of(tried, NEIGHBOURS + 1)[1][:, -1]
        width = WIDER * float(np.sqrt(np.quantile(reach, SHARE)))
        for _ in range(HALVED):
            around = stored.halo(tile, width, HALO)
            if around is not None:
                return around[first_occurrences(around)], width
            width /= 2.0
    return np.empty((0, 3)), 0.0


def _part(stored: StoredPoints, tile: Tile, different: int) -> Part:
    """Return a tile as a part of the cloud. The outermost boxes also hold the points outside of all."""
    boxes: Boxes = stored.boxes
    low = np.where(tile.low <= boxes.low[1], -np.inf, tile.low)
    high = np.where(tile.high >= boxes.high[1], np.inf, tile.high)
    return Part.of(partial(_content, stored.folder, tile), low, high, different)


def _save(folder: Path, tile: Tile, rows: NDArray[np.int64], tree: KdTree, reach: NDArray[np.float64]) -> None:
    """Store what is looked up of a tile. A task may be done by two workers at once."""
    columns = {"row": rows, "place": tree.points, "low": tree.low, "high": tree.high, "reach": reach}
    for name, values in columns.items():
        unfinished = folder / f"{uuid4().hex}.npy"
        np.save(unfinished, values)
        os.replace(unfinished, _column(folder, tile, name))


def _load(folder: Path, tile: Tile, name: str) -> NDArray[Any]:
    """Map a column. What is changed of it is not written."""
    return np.asarray(np.load(_column(folder, tile, name), mmap_mode="c"))


def _column(folder: Path, tile: Tile, name: str) -> Path:
    return folder / f"tile-{tile.first}-{name}.npy"


def _content(folder: Path, tile: Tile) -> Content:
    rows, places, low, high, reach = (_load(folder, tile, name) for name in ("row", "place", "low", "high", "reach"))
    return Content(KdTree(rows, places, low, high), reach)


class _Gone(NamedTuple):
    """The outliers of a tile, by their positions in its tree, and whether some of its points repeat others."""

    tile: Tile
    positions: NDArray[np.int64]
    repeats: bool


def _rows(stored: StoredPoints, gone: _Gone) -> NDArray[np.int64]:
    """Return the rows of the outliers of a tile, with those that repeat them."""
    content = _content(stored.folder, gone.tile)
    if not gone.repeats:
        return np.array(content.tree.order[gone.positions])
    own = stored.own(gone.tile)
    return own.rows[repeating(own.points, content.places(gone.positions))]
