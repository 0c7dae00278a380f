"""As many points of tiles as the options mean: a number, or what a tolerance, spacing or gap takes."""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from gppcs.amounts.accuracy import Goal, fewest_points
from gppcs.amounts.choice import check_count, number_of_discs
from gppcs.amounts.options import Options
from gppcs.amounts.quotas import first_of_parts, numbers_of
from gppcs.clouds.quantities import Measure, Tolerance
from gppcs.engine.arrays import Ints
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods import Selection
from gppcs.spatial.boxes import neighbours_before
from gppcs.spatial.samples import point_hashes
from gppcs.streaming.beyond_memory import Survey
from gppcs.streaming.graph import engine
from gppcs.streaming.passes import (
    Choice,
    distances_in_tile,
    errors_of_tiles,
    file_of_gaps,
    fill_gaps_in_tile,
    unchosen_in_tile,
)
from gppcs.streaming.plan import Plan
from gppcs.streaming.rows import Rows
from gppcs.streaming.scratch import scratch_folder
from gppcs.streaming.tiles import Tiling, choose_in_tile

Chosen = tuple[Choice, Mapping[str, float]]  # with diagnostics


@contextmanager
def chosen_in_tiles(
    files: CloudFiles, options: Options, plan: Plan, timer: Timer, folder: Path | None = None
) -> Iterator[tuple[Survey, Choice, Mapping[str, float]]]:
    """Choose points of files tile by tile; yield a survey of the cloud, and the points with diagnostics.

    Those of each tile are in a folder, where a later run finds them, or else in a temporary one.
    """
    with scratch_folder(options.scratch, plan.disk) as scratch, engine(options.workers, plan.threads) as run_on:
        survey = Survey.read(files, plan, options, scratch, folder or scratch, run_on, timer)
        yield survey, *choose(survey)


def choose(survey: Survey) -> Chosen:
    """Choose as many points as the options mean."""
    options, max_gap = survey.options, survey.options.lengths.get("max_gap")
    overview, n_keep = survey.overview, int(survey.overview.keep.sum())
    count = options.count(survey.n_points)
    if count is not None:
        choice, diagnostics = _numbered(survey, count, n_keep)
    elif options.max_error is not None:
        choice, diagnostics = _within(survey, options.max_error, n_keep)
    elif options.spacing is not None:
        choice, diagnostics = _spaced(survey, survey.scale.inside(options.lengths["spacing"]))
    else:
        assert max_gap is not None
        n = number_of_discs(survey.area, survey.scale.inside(max_gap))
        choice, diagnostics = _numbered(survey, min(max(n, n_keep, 1), overview.n_places), n_keep)
    if n_keep:
        diagnostics = {**diagnostics, "points_to_keep": float(n_keep)}
    if max_gap is not None:
        choice, of_gaps = _without_gaps(survey, choice, survey.scale.inside(max_gap))
        diagnostics = {**diagnostics, **of_gaps}
    return choice, diagnostics


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
        tiling, diagnostics = (_cells(survey, length), {}) if options.algorithm.by_cells else survey.tiling_for(length)
        counts = np.array(survey.run("tiles", partial(choose_in_tile, tiling), tiling, tiling.before))
        reached = counts[:, 0].sum(axis=0)
        if not options.quotas or (reached >= needed).all() or length >= overview.n_usable - n_keep:
            break
        growth = min(float((needed / np.maximum(reached, 1)).max()), 4.0)
        length = min(overview.n_usable - n_keep, math.ceil(1.05 * growth * length))
    choice = Choice(tiling, _divided(counts[:, 0], counts[:, 1], numbers))
    missing = np.maximum(numbers - reached, 0)
    return _filled(survey, choice, missing) if missing.any() else choice, diagnostics


def _divided(counts: Ints, n_keep: Ints, numbers: Ints) -> Ints:
    """Return how many points of each tile and quota stay, so that their sums are numbers, (256,), or what is there.

    Points to keep stay; the others are divided.
    """
    others = counts - n_keep
    total = others.sum(axis=0)
    exact = others * (np.clip(numbers - n_keep.sum(axis=0), 0, total) / np.maximum(total, 1))
    ends = np.rint(np.cumsum(exact, axis=0)).astype(np.int64)  # rounded so that no sum is off by more than a half
    return n_keep + np.diff(ends, axis=0, prepend=0)


def _filled(survey: Survey, choice: Choice, missing: Ints) -> Choice:
    """Add as many points as are missing of each quota, (256,), such as repeats of those that are kept."""
    task = partial(unchosen_in_tile, choice, missing)
    spare = Rows.joined(survey.run("repeats", task, choice.tiling))
    spare = spare.take(np.lexsort([spare.indices, point_hashes(spare.points, size=1.0)]))
    return replace(choice, added=(spare.only(first_of_parts(spare.labels, missing)),))


def _spaced(survey: Survey, spacing: float) -> Chosen:
    """Choose as many points as have a spacing: their number, if the method tells it, or tile by tile."""
    algorithm, overview = survey.options.algorithm, survey.overview
    if (count := algorithm.number_at(survey.area, spacing)) is not None:
        return _numbered(survey, min(count, overview.n_places), 0)
    halo = survey.frame.lengths(np.multiply(algorithm.halo, spacing))
    tiling = survey.tiling(halo, n_points=overview.n_usable, spacing=spacing)
    survey.write_guide(tiling, np.zeros(1, dtype=np.int64), np.ones(len(survey.overview.sample)), 0)
    counts = survey.run("tiles", partial(choose_in_tile, tiling), tiling, tiling.before)
    if not np.sum(counts):
        raise InputError("expected cells with enough points, found none; lower min_points, or raise `spacing`")
    return Choice(tiling, np.array(counts)[:, 0]), {}


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
        n_outliers = len(judged.source.excluded) - len(survey.source.excluded)
    n, minimum = survey.overview.n_places, max(n_keep, 1)
    sample = survey.overview.sample
    points = survey.frame.local(sample.points)
    first = fewest_points(
        points, tolerance, survey.scale, lambda m: Selection(survey.choose(sample, m)[0]), True, 1, survey.timer
    )
    count = max(2 * len(first.indices), minimum + 1)
    while True:
        choice, diagnostics = _numbered(survey, min(count, n), n_keep)
        of_judged = replace(choice.tiling, source=judged.source)

        def errors(m: int) -> dict[Measure, float]:
            prefix = replace(choice, tiling=of_judged, last=float(m - n_keep))  # noqa: B023
            figures = survey.run("accuracy", partial(distances_in_tile, prefix, limit), of_judged)  # noqa: B023
            return errors_of_tiles(np.array(figures), limit)

        if count >= n or errors(count)[measure] <= limit:
            break
        count = 2 * count
    enough, reached = Goal(measure, limit, minimum).smallest(errors, min(count, n), count / 2)
    diagnostics = {**diagnostics, "tolerance": survey.scale.outside(limit)}
    if tolerance.measure is None:
        diagnostics["largest_error"] = survey.scale.outside(reached["max"])
        if n_outliers:
            diagnostics["points_set_aside"] = float(n_outliers)
    diagnostics |= {f"surface_{name}": survey.scale.outside(error) for name, error in reached.items()}
    return replace(choice, last=float(enough - n_keep)), diagnostics


def _without_gaps(survey: Survey, choice: Choice, gap: float) -> Chosen:
    """Add points, each the farthest from all others, until none is farther from one than a gap."""
    margin = survey.frame.lengths(np.full(3, 1.001 * gap))
    before = neighbours_before(choice.tiling.tiles, margin)
    largest = survey.run("gaps", partial(fill_gaps_in_tile, choice, gap, margin, before), choice.tiling, before)
    added = [Rows.read(file_of_gaps(choice.tiling, number)) for number in range(len(largest))]
    outside = survey.scale.outside
    figures = {"added_in_gaps": float(sum(len(kept.indices) for kept in added)), "largest_gap": outside(max(largest))}
    return replace(choice, added=(*choice.added, *added)), {**figures, "max_gap": outside(gap)}
