"""Candidates of each stage on disk, found tile by tile: those that `gppcs.gp.local.candidates` finds in memory."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.gp.local.candidates import (
    DISTANCES,
    ENOUGH,
    SMALLEST_AREA,
    TOO_MANY,
    gaps_of_lone,
    largest_gap,
    numbers_of_lone,
)
from gppcs.gp.local.density import ROUNDING
from gppcs.gp.tiled.survey import TiledSurvey, sampled_places
from gppcs.spatial.boxes import Each, Tile
from gppcs.spatial.cells import first_occurrences, greatest_in_cells
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.stored import StoredPoints, StoredTable, joined, store_part
from gppcs.surface.noise import Noise
from gppcs.surface.surface_variation import variation_in_radius

Thin = Callable[[Path, Tile], NDArray[np.int64]]  # Stores what it leaves of a tile; returns how many in each box.

DIAGONAL = math.sqrt(3.0)  # Of a cell, in edge lengths. A halo this wide holds all points of the cells of a tile.
HALVINGS = 4  # Of the area at once, if too few cells are occupied. Doublings take back what is too much.
ROWS = 1 << 20  # Candidates that are looked at once.
NOISE_HALO = 3.0  # In target spacings: the points of a fit lie within 1.2 of them where a cloud is not sparse.


class Stage(NamedTuple):
    """A stage of the choice.

    Attributes
    ----------
    target : int
        Number of points that are chosen when the stage ends.
    table : StoredTable
        The candidates. Columns: "row" in the cloud, "place", "sharpness"; "parent", the row in the table of the next
        finer stage; with noise, "variance" of the observation and, if the noise is thick, "foot" on the surface.
    thinned : bool
        Whether the candidates are one in each cell. Otherwise they are those of the next finer stage, or all points.
    area : float
        Area of the surface, corrected by the number of occupied cells.
    """

    target: int
    table: StoredTable
    thinned: bool
    area: float

    @property
    def spacing(self) -> float:
        """The target spacing."""
        return math.sqrt(self.area / self.target) or 1.0


@dataclass(frozen=True)
class Search:
    """Where candidates are looked for, and how.

    Attributes
    ----------
    folder : path
        Where the candidates go.
    density : float
        Number of cells in a square whose side is the target spacing.
    noise : Noise
    each : callable
        Applies a function to all tiles.
    advanced : callable
        Called with the number of points looked through since the last call.
    most : int
        Points of a tile at most.
    """

    folder: Path
    density: float
    noise: Noise
    each: Each
    advanced: Callable[[int], None]
    most: int

    @property
    def columns(self) -> list[str]:
        """Names of the columns of each table of candidates, except "parent"."""
        observed = [] if self.noise.quiet else ["variance", "foot"] if self.noise.thick else ["variance"]
        return ["row", "place", "sharpness", *observed]

    def edge(self, area: float, target: int) -> float:
        """Return the edge length of the cells of a stage."""
        return math.sqrt(area / (self.density * target)) or 1.0

    def table(
        self, source: StoredPoints | StoredTable, thin: Thin, columns: Sequence[str], folder: Path
    ) -> StoredTable:
        """Return a table of what `thin` leaves of each tile."""
        tiles, parts = source.boxes.tiles(source.counts, self.most), []
        for tile, kept in zip(tiles, self.each(partial(thin, folder), tiles), strict=True):
            parts.append((tile, kept))
            self.advanced(int(source.counts[tile.first : tile.last].sum()))
        return joined(folder, source.boxes, parts, columns)


def finest_stage(points: StoredPoints, survey: TiledSurvey, n_points: int, search: Search) -> Stage:
    """Find the candidates of the last stage.

    Parameters
    ----------
    points : StoredPoints
    survey : TiledSurvey
    n_points : int
        M, the number of points to keep.
    search : Search

    Returns
    -------
    Stage
        If too few cells are occupied, all points without repeats are candidates.
    """

    def found(area: float, folder: Path, thinned: bool = True) -> StoredTable:
        thin = partial(_thin_points, points, survey, search.edge(area, n_points), search.density, thinned)
        return search.table(points, thin, [*search.columns, *(["gap"] if thinned else [])], folder)

    @cache
    def all_places() -> StoredTable:
        return found(survey.area, _folder(search, n_points, survey.area, "all"), thinned=False)

    n = int(points.counts.sum())
    area, table = _fitting(found, survey.area, n_points, n, lambda: len(all_places()), search)
    if table is None:
        return Stage(n_points, all_places(), False, area)
    return Stage(n_points, _without_outliers(table, area, n_points, search), True, area)


def _without_outliers(table: StoredTable, area: float, n_points: int, search: Search) -> StoredTable:
    """Return the table of the candidates without outliers: the same one if there are none."""
    spacing, lone = math.sqrt(area / n_points), np.zeros(len(DISTANCES), dtype=np.int64)
    for gaps in table.chunks_of("gap", ROWS):
        lone += numbers_of_lone(gaps, spacing)
    largest = largest_gap(lone, len(table), n_points, spacing)
    if math.isinf(largest):
        return table
    folder = _folder(search, n_points, area, "without-outliers")
    kept = search.table(table, partial(_store_near, table, search.columns, largest), search.columns, folder)
    shutil.rmtree(table.folder)
    return kept


def _store_near(
    table: StoredTable, columns: Sequence[str], largest: float, folder: Path, tile: Tile
) -> NDArray[np.int64]:
    """Store the candidates of a tile that are no farther than the largest gap from another."""
    own = table.rows_of(tile)
    kept = own.start + np.flatnonzero(table.take("gap", own) <= largest)
    return store_part(folder, tile, table.boxes, {name: table.take(name, kept) for name in columns})


def coarser_stage(finer: Stage, search: Search) -> Stage:
    """Find the candidates of the stage before a stage: one that wants about half as many points.

    Parameters
    ----------
    finer : Stage
    search : Search

    Returns
    -------
    Stage
        If too few cells are occupied, it has the table of the finer stage.
    """
    target, columns = -(-finer.target // 2), [*search.columns, "parent"]

    def found(area: float, folder: Path) -> StoredTable:
        thin = partial(_thin_candidates, finer.table, search.edge(area, target), columns)
        return search.table(finer.table, thin, columns, folder)

    area, table = _fitting(found, finer.area, target, len(finer.table), lambda: len(finer.table), search)
    return Stage(target, table or finer.table, table is not None, area)


def _fitting(
    found: Callable[[float, Path], StoredTable],
    area: float,
    target: int,
    n: int,
    places: Callable[[], int],
    search: Search,
) -> tuple[float, StoredTable | None]:
    """Return the area, doubled or halved until the number of occupied cells fits, and the candidates if enough.

    There are n points, at so many `places`. As in memory, several halvings at once are tried and then taken back.
    """
    many, few = TOO_MANY * search.density * target, ENOUGH * target
    table = found(area, _folder(search, target, area))
    halve = len(table) < few and n > many and places() >= few
    while halve and len(table) < few and area > SMALLEST_AREA:
        shutil.rmtree(table.folder)
        area /= 2.0**HALVINGS
        table = found(area, _folder(search, target, area))
    while len(table) > many or (halve and len(table) >= few):
        coarser = found(2.0 * area, _folder(search, target, 2.0 * area))
        if len(table) <= many and len(coarser) < few:
            shutil.rmtree(coarser.folder)
            break
        shutil.rmtree(table.folder)
        area, table = 2.0 * area, coarser
    if len(table) >= few:
        return area, table
    shutil.rmtree(table.folder)
    return area, None


def _folder(search: Search, target: int, area: float, kind: str = "cells") -> Path:
    """Return a new folder for a table."""
    folder = search.folder / f"{kind}-{target}-{area!r}"
    shutil.rmtree(folder, ignore_errors=True)  # what an interrupted run left
    folder.mkdir()
    return folder


def _thin_points(
    points: StoredPoints, survey: TiledSurvey, edge: float, density: float, thinned: bool, folder: Path, tile: Tile
) -> NDArray[np.int64]:
    """Store the sharpest point of each cell of a tile or, unless `thinned`, all without repeats."""
    noise, spacing = survey.noise, edge * math.sqrt(density)
    of_cells = DIAGONAL * edge + max(edge, DISTANCES[-1] * spacing)
    halo = max(of_cells, 0.0 if noise.quiet else NOISE_HALO * noise.spacing)
    near = points.near(tile, halo)
    some = sampled_places(near, survey.share)
    tree = KdTree.build(near.points[some]) if len(some) else None
    sharpness = np.zeros(len(near.rows), dtype=np.float32)
    if noise.clean and tree:
        variation = variation_in_radius(tree, edge)
        sharpness[some] = np.where(variation > ROUNDING, variation, 0.0)
    kept = (
        greatest_in_cells(near.points, edge, sharpness) if thinned else np.flatnonzero(first_occurrences(near.points))
    )
    gaps = {"gap": gaps_of_lone(near.points[kept], spacing)[near.inside[kept]]} if thinned else {}
    kept = kept[near.inside[kept]]
    found: dict[str, NDArray[Any]] = {"row": near.rows[kept], "place": near.points[kept], "sharpness": sharpness[kept]}
    observed = {} if noise.quiet else _observed(noise, tree, near.points[kept])
    return store_part(folder, tile, points.boxes, found | gaps | observed)


def _observed(noise: Noise, tree: KdTree | None, places: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return variances of observations at n places, (n, 3), and if the noise is thick, the places on the surface."""
    of_tile = replace(noise, tree=tree)  # without a tree, all observations are exact
    feet, variances = of_tile.observe(places) if len(places) else (None, np.zeros(0))
    return {"variance": variances} | ({"foot": places if feet is None else feet} if noise.thick else {})


def _thin_candidates(
    table: StoredTable, edge: float, columns: Sequence[str], folder: Path, tile: Tile
) -> NDArray[np.int64]:
    """Store the sharpest candidate of each cell of a tile."""
    near = table.rows_near(tile, DIAGONAL * edge)
    near = near[np.argsort(table.take("row", near))]  # of equal ones the first in the cloud counts
    kept = near[greatest_in_cells(table.take("place", near), edge, table.take("sharpness", near))]
    own = table.rows_of(tile)
    kept = kept[(kept >= own.start) & (kept < own.stop)]
    found = {name: kept if name == "parent" else table.take(name, kept) for name in columns}
    return store_part(folder, tile, table.boxes, found)
