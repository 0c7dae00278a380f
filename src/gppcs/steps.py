"""The steps of every simplification: prepare the points of a cloud, choose among them, add what the options ask for."""

from dataclasses import replace

import numpy as np

from gppcs.amounts.choice import choose_by_options
from gppcs.amounts.constraints import Constraints, check_constraints, check_finite
from gppcs.amounts.options import Options
from gppcs.amounts.order import check_order, in_order
from gppcs.clouds.cloud import PointCloud, with_normals
from gppcs.clouds.quantities import Scale, units_of
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.methods import Feature, Selection
from gppcs.methods.method import SCORES, with_scores
from gppcs.result import Result
from gppcs.spatial.units import Units


def simplify_cloud(cloud: PointCloud, options: Options, timer: Timer) -> Result:
    """Simplify a cloud in memory: prepare its points, choose among them, and add what the options ask for."""
    from gppcs.spatial.scaling import Frame, bounds

    units = units_of(options.unit, cloud.header)
    with timer("preparation"):
        check_addable(cloud, options)
        points = cloud.points
        lower, upper = bounds(points)
        indices = None
        if not np.isfinite([lower, upper]).all():
            bad = np.flatnonzero(~cloud.is_finite())
            check_finite(len(cloud), len(bad), int(bad[0]) if len(bad) else 0, options.invalid)
            indices = np.delete(np.arange(len(cloud)), bad)
    outliers = None
    if options.drop_outliers:
        indices, outliers = _without_outliers(cloud, indices, units, timer)
    with timer("preparation"):
        constraints = Constraints()
        if options.constrains_points:
            usable = np.arange(len(cloud)) if indices is None else indices
            constraints = Constraints.from_cloud(cloud, usable, options)
            check_constraints(options, len(constraints.keep), constraints.max_weight)
        if indices is not None:
            points = points[indices]
            lower, upper = bounds(points)
        frame = Frame.from_bounds(lower, upper, units)
        points = frame.local(points)
        diagonal = float(np.linalg.norm(frame.local(upper[np.newaxis])))
        scale = Scale(diagonal, units, frame.exponent)
    selection = choose_by_options(points, options, constraints, scale, timer)
    if options.denoises:
        selection = _with_shifts(selection, points, frame.exponent)
    rows = selection.indices if indices is None else indices[selection.indices]
    ranks = np.arange(len(rows))
    if options.order != "importance":
        ranks = in_order(cloud, rows, options.order, rows)
        rows, selection = rows[ranks], selection.arranged(selection.indices[ranks])
    kept = cloud.take(rows)
    if selection.points is not None:
        kept = kept.moved(frame.world(selection.points))
    if selection.normals is not None and (original := kept.normals()) is not None:
        from gppcs.surface.normals import with_signs_of

        kept = with_normals(kept, with_signs_of(selection.normals, original))
    if options.normals:
        with timer("normals"):
            kept = _with_estimated_normals(kept, points, selection)
    return result_of(replace(selection, indices=rows), kept, ranks, outliers, len(points), options, timer)


def _without_outliers(
    cloud: PointCloud, indices: Ints | None, units: Units | None, timer: Timer
) -> tuple[Ints | None, Ints]:
    """Return the indices without those of outliers, and the latter."""
    from gppcs.surface.outliers import find_in_units

    with timer("outliers"):
        outliers = np.flatnonzero(find_in_units(cloud, units))
    if len(outliers):
        usable = np.arange(len(cloud)) if indices is None else indices
        indices = np.setdiff1d(usable, outliers, assume_unique=True)
    return indices, outliers


def _with_estimated_normals(kept: PointCloud, points: Floats, selection: Selection) -> PointCloud:
    """Return the kept points with normals estimated in the whole cloud, `points`, (N, 3)."""
    from gppcs.surface.normals import estimate_normals, with_signs_of

    positions = points[selection.indices] if selection.points is None else selection.points
    estimated = estimate_normals(points, positions)
    return with_normals(kept, estimated if selection.normals is None else with_signs_of(selection.normals, estimated))


def _with_shifts(selection: Selection, points: Floats, exponent: int) -> Selection:
    """Return a selection that also says how far its points have moved, from `points`, (N, 3)."""
    if selection.points is None:
        raise InputError(
            f"expected fewer points to keep than there are different ones with a weight above 0, found "
            f"{len(selection.indices)}: denoising fits the kept points to the others; keep fewer"
        )
    shifts = np.linalg.norm(np.ldexp(selection.points - points[selection.indices], exponent), axis=1)
    diagnostics = {"moved_mean": float(shifts.mean()), "moved_largest": float(shifts.max())}
    return replace(selection, diagnostics={**selection.diagnostics, **diagnostics})


def check_addable(cloud: PointCloud, options: Options) -> None:
    """Check by a cloud, of which some points suffice, that its points can be ordered and get scores."""
    check_order(cloud, options.order)
    if options.scores and (taken := sorted(set(SCORES) & set(cloud.attributes))):
        raise InputError(
            f"the cloud already has an attribute {taken[0]!r}, which the scores would replace: "
            "rename it, or ask for no scores"
        )


def result_of(
    selection: Selection,
    kept: PointCloud,
    ranks: Ints,
    outliers: Ints | None,
    n: int,
    options: Options,
    timer: Timer,
) -> Result:
    """Return the result of a choice among n points: kept points with their ranks in the order chosen."""
    if options.scores:
        kept = with_scores(kept, selection.attributes)
    diagnostics = dict(selection.diagnostics)
    if outliers is not None:
        diagnostics["outliers"] = float(len(outliers))
    is_ranking = Feature.RANKING in options.algorithm.supports and selection.ranked
    seconds = dict(timer.seconds)
    return Result(selection.indices, kept, options.algorithm, seconds, diagnostics, outliers, ranks, is_ranking, n)
