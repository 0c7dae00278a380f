"""The cells of a cloud on disk, found part by part."""

from __future__ import annotations

from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.methods.voxel.grid import COLUMNS, cell_edge, check_columns, in_cells, representatives, worth
from gppcs.spatial.boxes import MapParts, Part
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.samples import point_hashes
from gppcs.spatial.stored import StoredPoints

PART = 1 << 18  # Points of a part at most.


# One point for each occupied cell: indices, (cells,), ascending; the points, and the means of their cells, (cells, 3).
Representatives: TypeAlias = tuple[Ints, Floats, Floats]


def representatives_in_parts(
    stored: StoredPoints,
    keep: str,
    min_points: int,
    edge: float | None,
    n_points: int,
    timer: Timer,
    map_parts: MapParts,
) -> Representatives:
    """Return the points that stand for their cells, by default where at least M cells are occupied, and few more."""
    parts, size = stored.parts(PART), float(stored.sample.max())

    def full_cells(edge: float) -> NDArray[np.uint64]:
        cells, counts = np.empty(0, dtype=np.uint64), np.empty(0, dtype=np.int64)
        for of_part in map_parts(partial(_cells, stored, keep, edge), parts):
            cells, cell = np.unique(np.concatenate([cells, of_part[0]]), return_inverse=True)
            counts = np.bincount(cell, np.concatenate([counts, of_part[1]])).astype(np.int64)
        return cells[counts >= (min_points if edge else 1)]

    def occupied(edge: float) -> int:
        return len(full_cells(edge))

    if edge is None:
        with timer("size of cells"):
            different = occupied(0.0)
            if keep in COLUMNS:
                check_columns(different, n_points)
            enough = size > 0.0 and (different > n_points or keep in COLUMNS)
            edge = cell_edge(size, n_points, occupied) if enough else 0.0
    with timer("representatives"):
        by_part = list(map_parts(partial(_representatives, stored, keep, edge), parts))
    indices, points, means = (np.concatenate(columns) for columns in zip(*by_part, strict=True))
    order = np.argsort(indices)
    if keep in COLUMNS and edge:  # columns may have points in several parts
        chosen, _ = representatives(in_cells(points[order], keep), edge, worth(points[order], keep, None))
        order = order[chosen]
    if min_points > 1 and edge:
        order = order[np.isin(point_hashes(np.floor(in_cells(points[order], keep) / edge)), full_cells(edge))]
    return indices[order], points[order], means[order]


def _cells(stored: StoredPoints, keep: str, edge: float, part: Part) -> tuple[NDArray[np.uint64], Ints]:
    """Return a number for each occupied cell of a part, and how many different points it holds.

    Without an edge length, each position is a cell.
    """
    points = stored.near(part).points
    points = in_cells(points[first_occurrences(points)], keep)
    return np.unique(point_hashes(np.floor(points / edge) if edge else points), return_counts=True)


def _representatives(stored: StoredPoints, keep: str, edge: float, part: Part) -> Representatives:
    """Return the points of a part that stand for their cells, or all without an edge length."""
    near = stored.near(part, 0.0 if keep in COLUMNS else edge)
    if not edge:
        return near.indices, near.points, near.points
    indices, means = representatives(in_cells(near.points, keep), edge, worth(near.points, keep, near.values))
    inside = near.inside[indices]
    chosen = indices[inside]
    return near.indices[chosen], near.points[chosen], means[inside]
