"""Simplify a cloud in files without ever holding all of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.accuracy import Measure
from gppcs.amounts.choice import Scale, choose, choose_guided, fewest_without_gaps, with_errors, without_gaps
from gppcs.amounts.guide import ChunkGuide, nothing_to_keep
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.expressions import Expression
from gppcs.clouds.lengths import Length
from gppcs.engine.ahead import compiled_ahead
from gppcs.engine.journal import Journal
from gppcs.engine.stages import Stages
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods import Method, Selection
from gppcs.simplification import Result, check_scores, check_usable, number_to_keep, with_scores
from gppcs.spatial.chunks import ChunkedPoints, ChunkedValues, Places
from gppcs.spatial.scaling import Frame
from gppcs.streaming.cluster import Cluster
from gppcs.streaming.outliers import OutlierSearch, passes_over
from gppcs.streaming.overview import Overview
from gppcs.streaming.partitions import ClusterPasses
from gppcs.streaming.plan import Plan, Way
from gppcs.streaming.reading import FilePasses
from gppcs.streaming.scratch import scratch_folder, work_name


class Accuracy(NamedTuple):
    """An accuracy that tells how many points are kept.

    Attributes
    ----------
    tolerance : Length
    measure : str
        Which error is meant.
    most : int
        So many points at most can be ranked in memory. Resumed work goes on with the number of the first run.
    memory : int or None
        Bytes of memory that users allow; None if they do not say it.
    """

    tolerance: Length
    measure: Measure
    most: int
    memory: int | None


def simplify_in_passes(
    files: CloudFiles,
    plan: Plan,
    method: Method,
    ratio: float | None,
    n_points: int | None,
    invalid: str,
    scores: bool,
    stages: Stages,
    scratch: Path | None = None,
    cluster: Cluster | None = None,
    resume: bool = False,
    keep: str | None = None,
    weight: str | None = None,
    accuracy: Accuracy | None = None,
    max_gap: Length | None = None,
    metres: float | None = None,
    repeats: bool = True,
    search: OutlierSearch | None = None,
) -> tuple[Result, int]:
    """Choose exactly M points of a cloud without ever holding all of it.

    Parameters
    ----------
    files : CloudFiles
    plan : Plan
        Made for them.
    method : Method
    ratio, n_points, invalid, scores
        As for `simplify_files`. No number is given with an accuracy.
    stages : Stages
        Times "bounds", the stages of the method, and "kept points". A step of a pass is a point.
    scratch : path, optional
        As for `simplify_files`.
    cluster : Cluster, optional
        Where to work; by default in this process.
    resume : bool
        As for `simplify_files`.
    keep : str, optional
        A condition on points that are kept whatever happens, as for `simplify_files`. Not in tiles.
    weight : str, optional
        An attribute that multiplies the density, as for `simplify_files`. Not in tiles.
    accuracy : Accuracy, optional
        Then the fewest points that reach it are kept. Not in tiles.
    max_gap : Length, optional
        Then points are added until no gap is larger, as for `simplify_files`.
    metres : float, optional
        The unit of the cloud in metres, if it is known.
    repeats : bool
        Whether repeats are kept where there are too few different places.
    search : OutlierSearch, optional
        If it is given, the outliers that it finds are left out.

    Returns
    -------
    result : Result
    n : int
        The number of points in the files, without outliers.

    Raises
    ------
    ClusterError, FileFormatError, InputError, OSError, ParameterError
        As for `simplify_files`.
    """
    check_scores(scores, method, files.head().cloud)
    outliers = None if search is None else search.found(plan).left_out
    passes = passes_over(files, plan, cluster, outliers)
    guide, shared = _guide_of(keep, weight), cluster is not None
    wanted = None if accuracy is None else accuracy._replace(most=0)  # which depends on the memory that is free
    asked: tuple[object, ...] = (method, ratio, n_points, invalid, plan.way, shared, keep, weight, wanted, max_gap)
    asked += (metres, repeats, search is not None)
    with scratch_folder(scratch, plan.disk, work_name(files, asked) if resume else None) as folder:
        journal = Journal(folder)
        seen = journal.once("bounds", lambda: _overview(passes, plan, stages, guide))
        _check_seen(seen, invalid, keep)
        frame = Frame.around(seen.low, seen.high)
        points = passes.points(seen, frame)
        scale = _scale(seen, frame, metres)
        weights = None if weight is None else passes.weights(seen, seen.weights)

        def chosen() -> Selection:
            with compiled_ahead(method.name):
                if accuracy is not None:
                    return _accurate(points, accuracy, scale, seen.to_keep(frame), weights, method, stages, journal)
                count = number_to_keep(seen.finite, ratio, n_points)
                if plan.way is Way.TILES and count < len(points):
                    return method.in_tiles(points, count, folder, stages, cluster.each if cluster else map)
                if guide is not None or max_gap is not None:
                    to_keep = seen.to_keep(frame)
                    return choose_guided(points, count, to_keep, weights, method, stages, repeats=repeats)
                return choose(points, count, method, stages, repeats=repeats)

        selection = journal.once("choice", chosen)
        if max_gap is not None:
            before = selection
            selection = journal.once("gaps", lambda: without_gaps(points, before, max_gap, scale, stages))
        rows, kept = _kept(passes, seen, selection, stages)
    if selection.points is not None:
        kept = kept.moved(np.ldexp(selection.points, frame.exponent) + frame.corner)
    if scores:
        kept = with_scores(kept, method, selection)
    ranked = method.ranks and selection.ranked
    result = Result(rows, kept, method, stages.seconds, selection.diagnostics, ranked=ranked)
    return result if outliers is None else result.with_outliers(outliers.rows), seen.count - seen.left_out


def _accurate(
    points: ChunkedPoints,
    accuracy: Accuracy,
    scale: Scale,
    to_keep: Places,
    weights: ChunkedValues | None,
    method: Method,
    stages: Stages,
    journal: Journal,
) -> Selection:
    """Choose the fewest points that reach an accuracy; the diagnostics tell the errors in the unit of the cloud."""
    from gppcs.amounts.accuracy_in_passes import fewest_points_in_passes

    def ranked(count: int) -> Selection:
        return journal.once(
            f"ranking of {count}",
            lambda: choose_guided(points, count, to_keep, weights, method, stages, repeats=False),
        )

    most = journal.once("most", lambda: accuracy.most)
    tolerance, least = scale.inside(accuracy.tolerance), max(len(to_keep.rows), 1)
    selection, errors = fewest_points_in_passes(
        points, tolerance, accuracy.measure, ranked, least, most, stages, journal
    )
    return with_errors(selection, errors, scale)


def count_in_passes(
    files: CloudFiles,
    plan: Plan,
    method: Method,
    asked: Mapping[str, Any],
    metres: float | None,
    stages: Stages,
    cluster: Cluster | None = None,
    search: OutlierSearch | None = None,
) -> int:
    """Return how many points of a cloud have a spacing, or leave about no gap, by two passes over its files.

    Parameters
    ----------
    files : CloudFiles
    plan : Plan
        Made for them.
    method : Method
        Whose `counts_at_spacing` or `measures_area` is true.
    asked : mapping of str to object
        The arguments `spacing`, `max_gap`, `keep`, `weight` and `invalid` of `simplify_files`. If there is a spacing,
        it counts.
    metres : float or None
        The unit of the cloud in metres, if it is known.
    stages : Stages
        Times "bounds", and the stages of the method.
    cluster : Cluster, optional
        Where to work; by default in this process.
    search : OutlierSearch, optional
        If it is given, the outliers that it finds are left out.

    Returns
    -------
    int
        From 1 to the number of points.

    Raises
    ------
    ClusterError, FileFormatError, InputError, OSError, ParameterError
        As for `simplify_files`.
    """
    passes = passes_over(files, plan, cluster, None if search is None else search.found(plan).left_out)
    seen = _overview(passes, plan, stages, _guide_of(asked["keep"], asked["weight"]))
    _check_seen(seen, asked["invalid"], asked["keep"])
    frame = Frame.around(seen.low, seen.high)
    points, scale = passes.points(seen, frame), _scale(seen, frame, metres)
    if asked["spacing"] is not None:
        count = method.count_at_spacing(points, scale.inside(Length.of("spacing", asked["spacing"])), stages)
        assert count is not None
        return count
    gap, area = scale.inside(Length.of("max_gap", asked["max_gap"])), method.surface_area(points, stages)
    assert area is not None
    return fewest_without_gaps(area, gap, len(seen.to_keep(frame).rows), len(points))


def _scale(seen: Overview, frame: Frame, metres: float | None) -> Scale:
    diagonal = np.linalg.norm(np.subtract(*frame.local(np.array([seen.high, seen.low]))))
    return Scale(float(diagonal), metres, frame.exponent)


def _check_seen(seen: Overview, invalid: str, keep: str | None) -> None:
    """Check that there are points to choose among, and all that users say of them."""
    check_usable(seen.count, seen.bad, seen.first_bad, invalid)
    if keep is not None and not seen.keeps:
        raise nothing_to_keep(keep)
    if seen.weight is not None:
        seen.weights.check()


def _guide_of(keep: str | None, weight: str | None) -> ChunkGuide | None:
    """Return what users know of the points."""
    if keep is None and weight is None:
        return None
    return ChunkGuide(None if keep is None else Expression.of(keep), weight)


def _overview(
    passes: FilePasses | ClusterPasses, plan: Plan, stages: Stages, guide: ChunkGuide | None = None
) -> Overview:
    with stages("bounds", plan.points) as advanced:
        return passes.overview(advanced, guide)


def _kept(
    passes: FilePasses | ClusterPasses, seen: Overview, selection: Selection, stages: Stages
) -> tuple[NDArray[np.int64], PointCloud]:
    """Read the chosen points with their attributes, in the order of choice, and their rows among all points."""
    with stages("kept points", seen.usable) as advanced:
        order = np.argsort(selection.indices)
        rows, clouds = passes.kept(seen, selection.indices[order], advanced)
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return rows[back], seen.columns.joined(clouds).take(back)
