"""Simplify a cloud that does not fit into memory: tile by tile."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial, reduce
from operator import add
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gppcs.amounts.accuracy import Bracketing, fewest_points
from gppcs.amounts.choice import check_count, number_of_discs, task_of
from gppcs.amounts.constraints import Constraints, check_constraints, check_finite
from gppcs.amounts.options import Options
from gppcs.amounts.quotas import numbers_of
from gppcs.clouds.quantities import Measure, Scale, Tolerance, units_of
from gppcs.clouds.ranges import Details
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods import Selection
from gppcs.spatial.boxes import Boxes, Tile, neighbours_before
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.samples import HASHES, point_hashes
from gppcs.spatial.scaling import Frame
from gppcs.spatial.spacing import surface_area
from gppcs.streaming.graph import Engine
from gppcs.streaming.passes import (
    Choice,
    distances_in_tile,
    file_of_gaps,
    fill_gaps_in_tile,
    in_order_of_choice,
    margin_of_gaps,
    outliers_in_tile,
    unchosen_in_tile,
)
from gppcs.streaming.plan import Plan
from gppcs.streaming.rows import Rows
from gppcs.streaming.source import Part, Source, sorted_once
from gppcs.streaming.survey import Overview, read_all
from gppcs.streaming.tiles import Guide, Kept, Tiling, choose_in_tile

T = TypeVar("T")

TILE = 1 << 19  # Points of a tile at most, without its halo.
SAMPLED_PER_CHOSEN = 26  # Points of the sample for each point of the first choice, at least.
FIRST = 0.05  # Fraction of the kept points that all tiles keep from the first choice.
HALO = 6.0  # In target spacings.
MAX_RATIO = math.log(8.0)  # Of a density to that of the first choice, from the middle one: few points tell little.
PILOT, BLOCK = 1 << 19, 400  # Points of the pilot choice, about, and kept points of each of its blocks.
REREADINGS = 3  # Of files whose points lie near each other, rather than to sort them once.


@dataclass(frozen=True, eq=False)
class Survey:
    """A cloud whose points can be read by boxes, and what the first reading found out about it."""

    parts: list[Part]
    overview: Overview
    source: Source
    options: Options
    frame: Frame
    boxes: Boxes
    folder: Path
    run_on: Engine
    timer: Timer

    @classmethod
    def read(
        cls, files: CloudFiles, plan: Plan, options: Options, scratch: Path, folder: Path, run_on: Engine, timer: Timer
    ) -> Survey:
        """Read a cloud once or twice; check that it can be simplified as the options ask for.

        Tiles will be stored in `folder`, and what no later run needs, in `scratch`.
        """
        overview, parts = read_all(files.parts(plan.part), plan.points_in, options, run_on, timer)
        check_finite(overview.count, overview.n_bad, overview.first_bad, options.invalid)
        check_constraints(options, int(overview.keep.sum()), overview.weights)
        assert overview.sample is not None
        frame = Frame.from_bounds(overview.lower, overview.upper, units_of(options.unit, overview.columns.header))
        boxes = Boxes.from_sample(overview.sample.points, overview.lower, overview.upper)
        direct = _lie_together(parts, overview, boxes)
        pieces = parts if direct else sorted_once(parts, boxes, scratch, run_on, timer)
        source = Source(pieces, overview.sample.take(np.arange(0)), np.empty(0, dtype=np.int64))
        survey = cls(parts, overview, source, options, frame, boxes, folder, run_on, timer)
        return survey.without_outliers() if options.drop_outliers else survey

    @property
    def outliers(self) -> Ints | None:
        """The indices of the outliers that are dropped, ascending; None if they are not."""
        return self.source.excluded if self.options.drop_outliers else None

    def parts_of(self, path: Path) -> list[Part]:
        """Return the parts of a file."""
        return [part for part in self.parts if list(part.files.paths) == [path]]

    @property
    def n_points(self) -> int:
        """Number of points among which is chosen."""
        return self.overview.count - self.overview.n_bad - len(self.source.excluded)

    @property
    def sample(self) -> Rows:
        """Points of different places, at random."""
        assert self.overview.sample is not None
        return self.overview.sample

    @cached_property
    def scale(self) -> Scale:
        """What turns lengths of the options into those of the frame."""
        diagonal = float(np.linalg.norm(self.frame.local(self.overview.upper[None])))
        return Scale(diagonal, units_of(self.options.unit, self.overview.columns.header), self.frame.exponent)

    @cached_property
    def details(self) -> Details:
        """The attributes that count beside the shape."""
        return Details.from_cloud(self.sample.attributes, self.options.details)

    @cached_property
    def area(self) -> float:
        """Area of the surface, in the frame."""
        return surface_area(KdTree.build(self.frame.local(self.sample.points)))

    def run(
        self, stage: str, task: Callable[[int], T], tiling: Tiling, before: Sequence[Sequence[int]] = ()
    ) -> list[T]:
        """Do a task in each tile, after it is done in some others."""
        with self.timer(stage, len(tiling.tiles)) as on_progress:
            return self.run_on.run(task, range(len(tiling.tiles)), before, on_progress)

    def without_outliers(self) -> Survey:
        """Return the survey of all points but the outliers."""
        tiling = self.tiling(np.zeros(3))
        outliers = Rows.joined(self.run("outliers", partial(outliers_in_tile, tiling), tiling))
        stays = ~np.isin(self.sample.indices, outliers.indices)
        overview = replace(
            self.overview,
            sample=self.sample.only(stays),
            hashes=self.overview.hashes[stays],
            labels=self.overview.labels - np.bincount(outliers.labels, minlength=256),
            keep=self.overview.keep - np.bincount(outliers.labels[outliers.keep], minlength=256),
        )
        return replace(self, overview=overview, source=replace(self.source, excluded=np.sort(outliers.indices)))

    def tiling(self, halo: Floats, fraction: float = 1.0, **more: Any) -> Tiling:
        """Divide the cloud into tiles, of as many points that take part in the choice."""
        tiles = self.nodes(TILE / fraction)
        return Tiling(
            self.source, self.options, self.frame, self.boxes, tiles, halo, fraction,
            self.overview.weights.maximum, self.details, self.folder, **more,
        )  # fmt: skip

    def nodes(self, n_points: float) -> list[Tile]:
        """Return the largest nodes of the tree of boxes with at most so many points, about."""
        counts = np.bincount(self.boxes.box_of(self.sample.points), minlength=len(self.boxes))
        return self.boxes.tiles(counts * (self.overview.n_usable / len(self.sample)), n_points)

    def tiling_for(self, n_points: int) -> tuple[Tiling, Mapping[str, float]]:
        """Return the tiles for a choice of a number of points besides those to keep, after a first choice in a sample.

        Returns the diagnostics of that, too.
        """
        holds_all = self.overview.n_places <= len(self.sample)
        n_chosen = n_points if holds_all else min(n_points, len(self.sample) // SAMPLED_PER_CHOSEN + 1)
        chosen, selection = self.choose(self.sample, n_chosen)
        mass = self._mass(chosen)
        if n_chosen < n_points and selection.scale is not None:
            finer, ratios = self._pilot(n_points, mass)
            mass *= ratios
            if finer.scale is not None:
                selection = replace(finer, scale=selection.scale.refined(finer.scale))
        self.write_guide(chosen, mass, min(int(FIRST * n_points), len(chosen) // 2))
        halo = self.frame.lengths(np.full(3, HALO * math.sqrt(self.area / n_points)))
        fraction = min(1.0, self.options.algorithm.points_per_kept * n_points / self.overview.n_places)
        tiling = self.tiling(halo, fraction, n_points=n_points, scale=selection.scale)
        return tiling, selection.diagnostics

    def choose(self, rows: Rows, n_points: int) -> tuple[Ints, Selection]:
        """Choose among rows in memory; return which ones, in the order of choice, and what the method returned."""
        constraints = Constraints(weights=rows.columns.get("weight"), columns=rows.attributes.attributes)
        points = self.frame.local(rows.points)
        task, indices, _ = task_of(points, self.options, constraints, self.details, self.timer)
        if n_points >= len(indices):
            return indices, Selection(np.arange(len(indices)), ranked=False)
        selection = self.options.algorithm(replace(task, n_points=max(1, n_points)))
        return indices[selection.indices], selection

    def _mass(self, chosen: Ints) -> Floats:
        """Return how many of the chosen points of the sample each of its points stands for, (n,)."""
        points = self.frame.local(self.sample.points)
        nearest = KdTree.build(points[chosen]).nearest_of(points, 1)[0][:, 0]
        return 1.0 / np.bincount(nearest, minlength=len(chosen))[nearest]

    def _pilot(self, n_points: int, mass: Floats) -> tuple[Selection, Floats]:
        """Choose in blocks spread over the cloud, as densely as in the whole: a sample is too sparse for that.

        Returns also by which factor more points are chosen than by the choice in the sample where each of its points
        is, (n,), up to a common one: what is measured in the blocks, and a power of the density elsewhere.
        """
        fraction = min(1.0, SAMPLED_PER_CHOSEN * n_points / self.overview.n_places)
        blocks = self.nodes(BLOCK * self.overview.n_usable / n_points)
        n_drawn = math.ceil(len(blocks) * min(1.0, PILOT / (fraction * self.overview.n_usable)))
        drawn = np.sort(np.random.default_rng(0).permutation(len(blocks))[:n_drawn])
        block_of_box = np.repeat(np.arange(len(blocks)), [block.last - block.first for block in blocks])
        rows = Rows.joined(
            rows.only(block_of_box[self.boxes.box_of(rows.points)] == i)  # not those on a cut, which may be a face
            for i in drawn
            for rows in [self.source.read(blocks[i].lower, blocks[i].upper)]
        )
        rows = rows.only(point_hashes(rows.points, size=1.0) < fraction * HASHES)
        chosen, selection = self.choose(rows, round(len(rows) / (fraction * self.overview.n_places) * n_points))
        of_sample, of_chosen = (
            block_of_box[self.boxes.box_of(points)] for points in (self.sample.points, rows.points[chosen])
        )
        size, expected, actual = (
            np.bincount(of_point, weights, len(blocks)).clip(1e-3)
            for of_point, weights in ((of_sample, None), (of_sample, mass), (of_chosen, None))
        )
        density, ratio = np.log(expected / size), np.log(actual / expected)
        if n_drawn > 2:
            ratio[:] = np.poly1d(np.polyfit(density[drawn], ratio[drawn], 1, w=np.sqrt(expected[drawn])))(density)
        ratio[drawn] = np.log(actual[drawn] / expected[drawn])
        middle = float(np.median(ratio))
        return selection, np.exp(np.clip(ratio - middle, -MAX_RATIO, MAX_RATIO))[of_sample]

    def write_guide(self, chosen: Ints, mass: Floats, n_first: int) -> None:
        """Write what tiles need to know of the choice in the sample."""
        from gppcs.surface.normals import estimate_normals

        sample = self.sample
        normals = estimate_normals(self.frame.local(sample.points)) if self.options.normals else None
        mass = mass / mass.sum()
        guide = Guide(sample.points, mass, sample.indices[chosen], sample.points[chosen], n_first, normals)
        guide.write(self.folder / "guide.npz")


# What stays of the tiles, what is added besides, and diagnostics.
Chosen = tuple[Choice, list[Kept], Mapping[str, float]]


def choose(survey: Survey) -> Chosen:
    """Choose as many points as the options mean."""
    options, max_gap = survey.options, survey.options.lengths.get("max_gap")
    overview, n_keep = survey.overview, int(survey.overview.keep.sum())
    count = options.count(survey.n_points)
    if count is not None:
        choice, more, diagnostics = _numbered(survey, count, n_keep)
    elif options.max_error is not None:
        choice, more, diagnostics = _within(survey, options.max_error, n_keep)
    elif options.spacing is not None:
        choice, more, diagnostics = _spaced(survey, survey.scale.inside(options.lengths["spacing"]))
    else:
        assert max_gap is not None
        n = number_of_discs(survey.area, survey.scale.inside(max_gap))
        choice, more, diagnostics = _numbered(survey, min(max(n, n_keep, 1), overview.n_places), n_keep)
    if n_keep:
        diagnostics = {**diagnostics, "points_to_keep": float(n_keep)}
    if max_gap is not None:
        added, of_gaps = _in_gaps(survey, choice, survey.scale.inside(max_gap))
        more, diagnostics = [*more, *added], {**diagnostics, **of_gaps}
    return choice, more, diagnostics


def all_kept(survey: Survey, choice: Choice, more: Sequence[Kept]) -> Kept:
    """Return all kept points."""
    kept = Kept.joined([*map(choice.kept, range(len(choice.tiling.tiles))), *more])
    return in_order_of_choice(kept, survey.options)


def _numbered(survey: Survey, count: int, n_keep: int) -> Chosen:
    """Choose a number of points, those to keep among them, by quotas if there are some."""
    options, overview = survey.options, survey.overview
    if options.quotas:
        n_parts = len(options.quotas) + 1
        of_parts = numbers_of(options.quotas, overview.labels[:n_parts], overview.keep[:n_parts], count)
    else:
        check_count(count, n_keep, overview.n_usable)
        of_parts = np.array([count])
    numbers = np.zeros(256, dtype=np.int64)
    numbers[: len(of_parts)] = of_parts
    needed = np.where(numbers < overview.labels, numbers, 0)  # all points of a quota need no ranking
    length = max(1, count - n_keep)
    while True:
        by_cells = options.algorithm.by_cells
        tiling, diagnostics = (_cells(survey, length), {}) if by_cells else survey.tiling_for(length)
        counts = np.array(survey.run("tiles", partial(choose_in_tile, tiling), tiling, tiling.before))
        reached = counts.sum(axis=0)
        if not options.quotas or (reached >= needed).all() or length >= overview.n_usable - n_keep:
            break
        growth = min(float((needed / np.maximum(reached, 1)).max()), 4.0)
        length = min(overview.n_usable - n_keep, math.ceil(1.05 * growth * length))
    choice = Choice(tiling, _divided(counts, numbers))
    missing = np.maximum(numbers - reached, 0)
    return choice, _filled(survey, choice, missing) if missing.any() else [], diagnostics


def _divided(counts: Ints, numbers: Ints) -> Ints:
    """Return how many points of each tile and quota stay, so that their sums are numbers, (256,), or what is there."""
    total = counts.sum(axis=0)
    exact = counts * (np.minimum(numbers, total) / np.maximum(total, 1))
    ends = np.rint(np.cumsum(exact, axis=0)).astype(np.int64)  # rounded so that no sum is off by more than a half
    return np.diff(ends, axis=0, prepend=0)


def _filled(survey: Survey, choice: Choice, missing: Ints) -> list[Kept]:
    """Return as many more points as are missing of each quota, (256,), such as repeats of those that are kept."""
    task = partial(unchosen_in_tile, choice, missing)
    spare = Kept.joined(survey.run("repeats", task, choice.tiling))
    order = np.lexsort([spare.indices, point_hashes(spare.points, size=1.0)])
    by_quota = [order[spare.labels[order] == label][: missing[label]] for label in np.flatnonzero(missing)]
    return [spare.take(np.concatenate(by_quota))]


def _spaced(survey: Survey, spacing: float) -> Chosen:
    """Choose as many points as have a spacing: their number, if the method tells it, or tile by tile."""
    algorithm, overview = survey.options.algorithm, survey.overview
    if (count := algorithm.number_at(survey.area, spacing)) is not None:
        return _numbered(survey, min(count, overview.n_places), 0)
    survey.write_guide(np.zeros(1, dtype=np.int64), np.ones(len(survey.sample)), 0)
    halo = survey.frame.lengths(np.multiply(algorithm.halo, spacing))
    tiling = survey.tiling(halo, n_points=overview.n_usable, spacing=spacing)
    counts = survey.run("tiles", partial(choose_in_tile, tiling), tiling, tiling.before)
    if not np.sum(counts):
        raise InputError("expected cells with enough points, found none; lower min_points, or raise `spacing`")
    return Choice(tiling, np.array(counts)), [], {}


def _cells(survey: Survey, count: int) -> Tiling:
    """Return tiles with the spacing that makes the method choose a number of points, and few more, or all places."""
    lower, upper, spacing = 0.0, math.inf, math.sqrt(survey.area / count) or 1.0
    best, best_number = None, 0
    for _ in range(60):
        choice = _spaced(survey, spacing)[0]
        number = int(choice.n_staying.sum())
        if best is None or (number >= count, -abs(number - count)) > (best_number >= count, -abs(best_number - count)):
            best, best_number = choice.tiling, number
        if count <= number <= 1.001 * count + 1 or spacing < 1e-12:
            break
        lower, upper = (spacing, upper) if number > count else (lower, spacing)
        guess = spacing * math.sqrt(max(number, 1) / (1.0005 * count))
        middle = (lower + upper) / 2.0 if lower else spacing / 16.0
        spacing = guess if number and lower < guess < upper else middle
    if best_number < min(count, 0.9 * survey.overview.n_places):
        raise InputError(f"expected {count:,} cells with enough points, found {best_number:,}; ask for fewer points")
    assert best is not None
    return best


def _within(survey: Survey, tolerance: Tolerance, n_keep: int) -> Chosen:
    """Choose the fewest points whose local surface is within a tolerance, as `fewest_points` does in memory."""
    limit, measure = survey.scale.inside(tolerance.length), tolerance.measure or "max"
    judged, n_outliers = survey, 0
    if tolerance.measure is None:
        judged = survey.without_outliers()
        n_outliers = len(judged.source.excluded)
    n, minimum = survey.overview.n_places, max(n_keep, 1)
    points = survey.frame.local(survey.sample.points)
    first = fewest_points(
        points, tolerance, survey.scale, lambda m: Selection(survey.choose(survey.sample, m)[0]), True, 1, survey.timer
    )
    count = max(2 * len(first.indices), minimum + 1)
    while True:
        choice, _, diagnostics = _numbered(survey, min(count, n), n_keep)
        of_judged = replace(choice.tiling, source=judged.source)

        def errors(m: int) -> dict[Measure, float]:
            prefix = replace(choice, tiling=of_judged, below=float(m - n_keep))  # noqa: B023
            sums = survey.run("accuracy", partial(distances_in_tile, prefix, limit), of_judged)  # noqa: B023
            return reduce(add, sums).errors(limit)

        if count >= n or errors(count)[measure] <= limit:
            break
        count = 2 * count
    errors_of = cache(errors)
    search = Bracketing(lambda m: errors_of(m)[measure], limit, minimum)
    enough = search.smallest(count / 2, min(count, n), 1.0)
    diagnostics = {**diagnostics, "tolerance": survey.scale.outside(limit)}
    if tolerance.measure is None:
        diagnostics["largest_error"] = survey.scale.outside(errors_of(enough)["max"])
        if n_outliers:
            diagnostics["points_set_aside"] = float(n_outliers)
    diagnostics |= {f"surface_{name}": survey.scale.outside(error) for name, error in errors_of(enough).items()}
    return replace(choice, below=float(enough - n_keep)), [], diagnostics


def _in_gaps(survey: Survey, choice: Choice, gap: float) -> tuple[list[Kept], Mapping[str, float]]:
    """Add points, each the farthest from all others, until none is farther from one than a gap."""
    before = neighbours_before(choice.tiling.tiles, margin_of_gaps(choice.tiling, gap))
    largest = survey.run("gaps", partial(fill_gaps_in_tile, choice, gap), choice.tiling, before)
    added = [Kept.read(file_of_gaps(choice.tiling, number)) for number in range(len(largest))]
    outside = survey.scale.outside
    figures = {"added_in_gaps": float(sum(len(kept.indices) for kept in added)), "largest_gap": outside(max(largest))}
    return added, {**figures, "max_gap": outside(gap)}


def _lie_together(parts: Sequence[Part], overview: Overview, boxes: Boxes) -> bool:
    """Return whether tiles meet so few files that it is cheaper to read these than to sort all points."""
    assert overview.sample is not None
    for part in parts:
        with part.files as files:
            if files.has_copies:
                return False
    counts = np.bincount(boxes.box_of(overview.sample.points), minlength=len(boxes))
    tiles = boxes.tiles(counts * (overview.n_usable / len(overview.sample)), TILE)
    margins = [0.1 * (tile.upper - tile.lower) for tile in tiles]
    met = sum(
        part.count or 0
        for tile, margin in zip(tiles, margins, strict=True)
        for part in parts
        if part.meets(tile.lower - margin, tile.upper + margin)
    )
    return met <= REREADINGS * overview.count
