"""Let a method choose as many points as the options mean: a number, or what a tolerance, spacing or gap takes."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from gppcs.amounts.accuracy import fewest_points
from gppcs.amounts.constraints import Constraints, relative_weights
from gppcs.amounts.options import Options
from gppcs.amounts.quotas import choose_quotas
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.lookup import numbers_in
from gppcs.clouds.quantities import Length, Scale
from gppcs.clouds.ranges import Details
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.methods import Feature, Method, Selection, Task
from gppcs.methods.method import selected
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.farthest_points import fill_gaps
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.samples import short_hashes
from gppcs.spatial.spacing import surface_area

AREA_SAMPLE = 100_000  # Points on which an area is measured, as a tree over millions takes longer than the choice.


def choose_by_options(
    points: Floats, options: Options, constraints: Constraints, scale: Scale, timer: Timer
) -> Selection:
    """Let the method choose as many of the points, (N, 3), as the options mean."""
    method, max_gap = options.algorithm, options.lengths.get("max_gap")
    count = options.count(len(points))
    if count is not None and count >= len(points) and not options.constrains_points and max_gap is None:
        return Selection(np.arange(len(points)), ranked=False)
    with timer("repeats"):
        details = Details.from_cloud(PointCloud(points, constraints.columns), options.details)
        task, indices, repeats = task_of(points, options, constraints, details, timer)
    rank = partial(_ranked, method, task)
    if count is not None:
        ranked = partial(_ranked, method, task, indices=indices)
        selection = _number(count, len(points), options, constraints, repeats, ranked)
    else:
        if options.max_error is not None:
            is_ranking = Feature.RANKING in method.supports
            minimum = max(task.fixed, 1)
            selection = fewest_points(task.points, options.max_error, scale, rank, is_ranking, minimum, timer)
        elif options.spacing is not None:
            spacing = scale.inside(options.lengths["spacing"])
            n = method.number_at(area_of(task.points), spacing)
            selection = rank(len(task.points), spacing) if n is None else rank(n)
        else:
            assert max_gap is not None
            n = number_of_discs(area_of(task.points), scale.inside(max_gap))
            selection = rank(min(max(n, task.fixed, 1), len(task.points)))
        selection = _with_repeats(replace(selection, indices=indices[selection.indices]), repeats, task.fixed)
    if max_gap is None:
        return selection
    return _without_gaps(points, constraints.usable(len(points)), selection, max_gap, scale, timer)


def _ranked(method: Method, task: Task, n: int, spacing: float | None = None, indices: Ints | None = None) -> Selection:
    """Choose n of the points of a task, which have some indices, or at most n with a spacing; all in their order."""
    if n >= len(task.points) and spacing is None:
        selection = Selection(np.arange(len(task.points)), ranked=False)
    else:
        selection = selected(method, replace(task, n_points=n, spacing=spacing))
    return selection if indices is None else replace(selection, indices=indices[selection.indices])


def _number(
    count: int, n: int, options: Options, constraints: Constraints, repeats: Ints, rank: Callable[[int], Selection]
) -> Selection:
    """Choose a number of n points: by quotas or the first of a ranking, and repeats where there are too few positions.

    `rank` chooses a number of distinct positions, those to keep first; `repeats` are indices to keep at the positions
    of others.
    """
    fixed = len(constraints.keep) - len(repeats)
    if options.quotas:
        assert constraints.labels is not None
        selection, fill = choose_quotas(options.quotas, constraints.labels, count, constraints.keep, repeats, rank)
        return _extended(_with_repeats(selection, repeats, fixed), fill)
    check_count(count, len(constraints.keep), constraints.n_usable(n))
    selection = _with_repeats(rank(count - len(repeats)), repeats, fixed)
    missing = count - len(selection.indices)
    if missing <= 0:
        return selection
    return _extended(selection, np.setdiff1d(constraints.usable(n), selection.indices)[:missing])


def check_count(count: int, n_keep: int, n_usable: int) -> None:
    """Check that there are as many points as are asked for, and that no more are to be kept."""
    if count > n_usable:
        raise InputError(f"expected at least {count:,} points of a weight above 0, found {n_usable:,}; ask for fewer")
    if n_keep > count:
        raise InputError(
            f"{n_keep:,} points are to be kept whatever happens, but only {count:,} points are asked for; ask for at "
            f"least {n_keep:,}, give them a number of the points with `quota`, or read no others with `only`"
        )


def _with_repeats(selection: Selection, repeats: Ints, fixed: int) -> Selection:
    """Return a selection with repeats to keep after its first `fixed` points, and the number of points to keep."""
    if not fixed:
        return selection
    diagnostics = {**selection.diagnostics, "points_to_keep": float(fixed + len(repeats))}
    longer = selection.arranged(np.insert(selection.indices, fixed, repeats))
    return replace(longer, diagnostics=diagnostics)


def _extended(selection: Selection, indices: Ints) -> Selection:
    """Return a selection with further points at its end, which the method did not choose."""
    return selection.arranged(np.concatenate([selection.indices, indices]))


def task_of(
    points: Floats, options: Options, constraints: Constraints, details: Details, timer: Timer
) -> tuple[Task, Ints, Ints]:
    """Return the task to choose among the distinct positions of points, (N, 3), those to keep first.

    Returns also the indices of these positions, (n,), and those of points to keep at the positions of others.
    """
    keep = constraints.keep
    if constraints.weights is None and not len(keep):
        indices, repeats = np.flatnonzero(first_occurrences(points)), keep
    else:
        indices = np.concatenate([keep, np.setdiff1d(constraints.usable(len(points)), keep, assume_unique=True)])
        is_first = first_occurrences(points.take(indices, axis=0))
        indices, repeats = indices[is_first], keep[~is_first[: len(keep)]]
    fixed = len(keep) - len(repeats)
    cloud, attribute = PointCloud(points, constraints.columns), options.algorithm.reads_attribute
    arrays: dict[str, Any] = {}
    if constraints.weights is not None:
        weights = relative_weights(constraints.weights)[indices]
        arrays["weights"] = np.maximum(weights, weights[weights > 0.0].min())  # those of points to keep may be 0
    if (detail := details.values(cloud)) is not None:
        arrays["detail"] = detail.take(indices, axis=0)
    if attribute is not None:
        arrays["values"] = numbers_in(cloud, attribute, "to choose points by")[indices]
    distinct = points if len(indices) == len(points) and not fixed else points.take(indices, axis=0)
    return Task(distinct, len(indices), fixed=fixed, timer=timer, **arrays), indices, repeats


def area_of(points: Floats) -> float:
    """Estimate the area of the surface of points, (N, 3), of many by a sample."""
    if len(points) > 1.5 * AREA_SAMPLE:
        points = points[short_hashes(points, 32) < AREA_SAMPLE / len(points) * 2.0**32]
    return surface_area(KdTree.build(points))


def number_of_discs(area: float, radius: float) -> int:
    """Return how many discs of a radius cover an area, in a hexagonal lattice."""
    density = 2.0 / (3.0 * math.sqrt(3.0))  # discs of radius 1 for each unit of area
    return math.ceil(min(density * area / radius / radius, 1e18))


def _without_gaps(
    points: Floats, usable: Ints, selection: Selection, max_gap: Length, scale: Scale, timer: Timer
) -> Selection:
    """Add usable points, each the farthest from all others, until none is farther from one than a length."""
    kept = points[selection.indices] if selection.points is None else selection.points
    with timer("gaps"):
        added, gap = fill_gaps(points[usable], kept, scale.inside(max_gap))
    diagnostics = {"added_in_gaps": float(len(added)), "largest_gap": scale.outside(gap)}
    diagnostics["max_gap"] = scale.outside(scale.inside(max_gap))
    moved = None if selection.points is None else np.concatenate([kept, points[usable[added]]])
    longer = _extended(selection, usable[added])
    return replace(longer, diagnostics={**selection.diagnostics, **diagnostics}, points=moved)
