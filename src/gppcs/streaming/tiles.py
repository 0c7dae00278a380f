"""Chooses points tile by tile: each with its halo and the kept points of finished neighbours, as in memory."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from gppcs.amounts.choice import task_of
from gppcs.amounts.constraints import Constraints
from gppcs.amounts.options import Options
from gppcs.clouds.ranges import Details
from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.methods import Selection
from gppcs.spatial.boxes import Tile, inside, neighbours_before
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import Frame
from gppcs.streaming.rows import Rows
from gppcs.streaming.scratch import read_arrays
from gppcs.streaming.source import Source

# Points that each tile adds to those it chose, as a fraction of these, besides a root of their number: tiles choose a
# little more or less than is expected of them. Those that are too many go at the end.
SPARE = 0.01
SPARE_FROM = 32  # Points of which each of these is the farthest from those that are kept.


@dataclass(frozen=True, eq=False)
class Guide:
    """What a first choice, in a sample of the whole cloud, tells all tiles."""

    points: Floats  # (n, 3), the sample
    mass: Floats  # (n,), fraction of the kept points for which each stands
    chosen: Floats  # (m, 3), the chosen points, in the order of choice
    first: Ints  # (k,), indices in the cloud of the first of these, which all tiles keep
    normals: Floats | None = None  # (n, 3), of the sample, with signs


def looked_up(indices: Ints, keys: Ints, values: Floats) -> Floats:
    """Return the values, (k,), at those of indices, (n,), that are among keys, (k,); infinity at others."""
    result, order = np.full(len(indices), np.inf), np.argsort(keys)
    are_keys = np.flatnonzero(np.isin(indices & 0xFFFF, keys & 0xFFFF))  # few others, and found without sorting
    are_keys = are_keys[np.isin(indices[are_keys], keys)]
    result[are_keys] = values[order[np.searchsorted(keys, indices[are_keys], sorter=order)]]
    return result


@dataclass(frozen=True, eq=False)
class Tiling:
    """A cloud in tiles, and what each of them needs to know of the whole."""

    source: Source
    options: Options
    frame: Frame
    tiles: Sequence[Tile]
    halo: Floats  # (3,), in the unit of the cloud
    fraction: float  # of the places, which takes part in the choice
    details: Details
    folder: Path  # of the file of the guide, and of those of kept points
    n_points: int = 0  # to choose besides those that are kept whatever happens
    spacing: float | None = None  # that the method keeps, instead of a number; in the frame
    scale: object = None  # see `Task`

    @cached_property
    def before(self) -> list[list[int]]:
        """Of each tile, the neighbours that go before it."""
        by_cells = self.options.algorithm.by_cells  # which do not depend on those of others
        return [[] for _ in self.tiles] if by_cells else neighbours_before(self.tiles, self.halo)

    @cached_property
    def tile_of_box(self) -> Ints:
        """The tile of each box, (boxes,)."""
        return np.repeat(np.arange(len(self.tiles)), [tile.last - tile.first for tile in self.tiles])

    def tile_of(self, points: Floats) -> Ints:
        """Return the tile of each point, (n,). Shapes: points (n, 3)."""
        return self.tile_of_box[self.source.boxes.box_of(points)]

    def meeting(self, lower: Floats, upper: Floats) -> list[int]:
        """Return the tiles that meet the box between two corners, (3,)."""
        return [i for i, tile in enumerate(self.tiles) if (tile.lower <= upper).all() and (tile.upper >= lower).all()]

    def region(self, number: int) -> tuple[Floats, Floats]:
        """Return the corners, (3,), of a tile with its halo."""
        return self.tiles[number].lower - self.halo, self.tiles[number].upper + self.halo

    def near(self, number: int) -> Rows:
        """Read the points of a tile and its halo that take part in the choice."""
        return self.source.read(*self.region(number), self.fraction)

    def own(self, number: int) -> Rows:
        """Read the points of a tile."""
        rows = self.source.read(self.tiles[number].lower, self.tiles[number].upper)
        return rows.only(self.tile_of_box[rows.boxes] == number)

    @cached_property
    def guide(self) -> Guide:
        """What the first choice tells."""
        return Guide(**read_arrays(self.guide_file))

    @property
    def guide_file(self) -> Path:
        """The file of the guide."""
        return self.folder / f"guide-{self.n_points}-{self.spacing}.npz"

    def file(self, number: int) -> Path:
        """Return the file of the kept points of a tile."""
        return self.folder / f"{self.n_points}-{self.spacing}-{number}.npz"


def choose_in_tile(tiling: Tiling, number: int) -> Ints:
    """Choose the points of a tile and write them to its file; return their number and that of points to keep.

    Returns both by quota, (2, 256).
    """
    if tiling.file(number).exists():  # by an earlier run
        return Rows.read(tiling.file(number)).counts
    rows = tiling.near(number)
    tile_of = tiling.tile_of_box[rows.boxes]
    is_own, is_done = tile_of == number, np.isin(tile_of, tiling.before[number])
    ranks = np.where(rows.keep, -1.0, np.inf)  # of those that are chosen already
    for i in tiling.before[number]:
        there, kept = np.flatnonzero(tile_of == i), Rows.read(tiling.file(i))
        of_rows = looked_up(rows.indices[there], kept.indices, kept.ranks)
        ranks[there] = np.where(of_rows < tiling.n_points, of_rows, ranks[there])  # without spare ones
    settled = is_done | np.isfinite(ranks)
    first = tiling.guide.first
    ranks = np.where(settled, ranks, looked_up(rows.indices, first, np.arange(float(len(first)))))
    fixed = np.isfinite(ranks)
    if tiling.spacing is None or tiling.options.algorithm.by_cells:
        taken = fixed | ~is_done | (tiling.scale is not None)  # not every method tells what only shows the surface
    else:
        taken = fixed & is_done | is_own  # what neighbours will see is no matter of this tile
    rows, ranks, settled, is_own = rows.only(taken), ranks[taken], settled[taken], is_own[taken]
    kept = _kept(tiling, number, rows, is_own, _selection(tiling, number, rows, ranks, settled, is_own))
    if tiling.options.normals:
        kept = with_signed_normals(tiling, number, kept)
    kept.write(tiling.file(number))
    return kept.counts


def _selection(tiling: Tiling, number: int, rows: Rows, ranks: Floats, settled: Flags, is_own: Flags) -> Selection:
    """Choose among rows in a tile and around it, first those with a rank, settled ones before others.

    Indices are those of rows; among the attributes are these ranks, infinite for new points, and NaN for spare ones.
    """
    fixed = np.flatnonzero(np.isfinite(ranks))
    constraints = Constraints(
        keep=fixed[np.lexsort([ranks[fixed], ~settled[fixed]])],
        weights=rows.columns.get("weight"),
        columns=rows.attributes.attributes,
    )
    points = tiling.frame.local(rows.points)
    task, indices, _ = task_of(points, tiling.options, constraints, tiling.details, Timer())
    settled, scale = settled[indices], tiling.scale
    task = replace(task, settled=None if scale is None else settled, scale=scale, spacing=tiling.spacing)
    if tiling.spacing is None:
        guide = tiling.guide
        waits = inside(guide.points, *tiling.region(number))
        waits &= ~np.isin(tiling.tile_of(guide.points), tiling.before[number])
        n_new = tiling.n_points * float(guide.mass[waits].sum())
        n_new -= np.count_nonzero(~settled[: task.fixed])
        task = replace(task, n_points=task.fixed + max(0, math.ceil(n_new)))
    is_free = ~settled
    is_free[: task.fixed] = True
    if task.spacing is None and not task.fixed < task.n_points < np.count_nonzero(is_free):
        selection = Selection(np.flatnonzero(is_free)[: task.n_points], ranked=False)
    else:
        selection = tiling.options.algorithm(task)
    of_chosen = np.full(len(selection.indices), np.inf)
    of_chosen[: task.fixed] = ranks[indices[: task.fixed]]  # also where others stand for them
    attributes = {**selection.attributes, "rank": of_chosen}
    selection = replace(selection, indices=indices[selection.indices], attributes=attributes)
    return selection if tiling.spacing is not None else _with_spare(selection, indices, points, is_own)


def _with_spare(selection: Selection, indices: Ints, points: Floats, is_own: Flags) -> Selection:
    """Return a selection with spare points of the tile at its end, far from all others.

    Shapes: indices (n,), in random order, of different places among points, (N, 3).
    """
    n_own = int(np.count_nonzero(is_own[selection.indices]))
    n_spare = math.ceil(SPARE * n_own + math.sqrt(n_own))
    unchosen = indices[is_own[indices] & ~np.isin(indices, selection.indices)][: SPARE_FROM * n_spare]
    if not len(unchosen):
        return selection
    kept = points[selection.indices] if selection.points is None else selection.points
    spare = unchosen[farthest_points(points[unchosen], min(n_spare, len(unchosen)), before=kept)[0]]
    moved = None if selection.points is None else np.concatenate([kept, points[spare]])
    longer = selection.arranged(np.concatenate([selection.indices, spare]))
    longer.attributes["rank"][len(selection.indices) :] = np.nan
    return replace(longer, points=moved)


def _kept(tiling: Tiling, number: int, rows: Rows, is_own: Flags, selection: Selection) -> Rows:
    """Return the kept points of a tile, by what was chosen in it and around it."""
    own = np.flatnonzero(is_own[selection.indices])
    repeats = np.setdiff1d(np.flatnonzero(rows.keep & is_own), selection.indices)  # of points to keep
    columns = {name: values[own] for name, values in selection.attributes.items()}
    columns["rank"] = _ranks(tiling, number, columns["rank"])
    if selection.points is not None:
        columns["moved"] = tiling.frame.world(selection.points[own])
    new, others = rows.take(selection.indices[own]), rows.take(repeats)
    kept = Rows.joined(
        [
            Rows(new.indices, new.points, {**columns, "label": new.labels}),
            Rows(others.indices, others.points, {"rank": np.full(len(repeats), -1.0), "label": others.labels}),
        ]
    )
    return kept.take(np.argsort(kept.ranks, kind="stable"))


def _ranks(tiling: Tiling, number: int, ranks: Floats) -> Floats:
    """Return about the place of each kept point of a tile, (k,), in the order of all, by those in the first choice.

    New points have the rank inf, and spare ones NaN.
    """
    guide, is_new = tiling.guide, np.isinf(ranks)
    n = int(np.count_nonzero(ranks >= 0.0))
    n_first = n - int(np.count_nonzero(is_new))
    # The n-th point of a tile comes about where the n-th one of the first choice does.
    of_tile = np.flatnonzero(tiling.tile_of(guide.chosen) == number)[: max(0, n - 1)]
    numbers, of_all = [-1, *range(len(of_tile)), n], [-1, *of_tile, tiling.n_points]
    ranks[is_new] = np.interp(np.arange(n_first, n), numbers, of_all)
    return np.nan_to_num(ranks, nan=tiling.n_points)


def with_signed_normals(tiling: Tiling, number: int, kept: Rows) -> Rows:
    """Return kept points of a tile with normals that have signs, by all points."""
    from gppcs.surface.normals import estimate_normals, with_signs_of

    guide, frame = tiling.guide, tiling.frame
    assert guide.normals is not None
    local = frame.near(kept.positions)
    normals = estimate_normals(frame.local(tiling.source.read(*tiling.region(number)).points), local)
    nearest = KdTree.build(frame.local(guide.points)).nearest_of(local, 1)[0][:, 0]
    return replace(kept, columns={**kept.columns, "normals": with_signs_of(normals, guide.normals[nearest])})
