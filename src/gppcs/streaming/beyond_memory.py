"""Simplify a cloud that does not fit into memory: its points are stored by boxes, and chosen part by part."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.choice import check_count, choose_quotas, with_others, with_repeats
from gppcs.amounts.groups import choose_groups, groups_of
from gppcs.amounts.guide import ChunkGuide, nothing_to_keep
from gppcs.amounts.quotas import LEFT_OUT, Parts
from gppcs.amounts.request import Request
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.quantities import Scale, metres_of
from gppcs.engine.timer import Timer
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods import Selection, Task
from gppcs.simplification import Result, check_scores, check_usable, result_of, with_scores
from gppcs.spatial.boxes import Each
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.scaling import Frame
from gppcs.spatial.stored import StoredPoints, without
from gppcs.streaming.plan import Plan
from gppcs.streaming.scan import Overview, read_all, sorted_by_boxes, take
from gppcs.surface.outliers import outliers_in_parts

NO_ROWS = np.empty(0, dtype=np.int64)


class Run(NamedTuple):
    """What a run gives."""

    result: Result
    points: int  # among which was chosen
    cloud: PointCloud | None = None  # all points, if they are in memory


def simplify_stored(files: CloudFiles, request: Request, plan: Plan, folder: Path, each: Each, timer: Timer) -> Run:
    """Simplify the cloud in some files, with temporary files in a folder."""
    if request.scores:
        check_scores(files.preview)
    sources = files.parts(plan.part)
    seen = read_all(sources, folder, plan.rows, plan.points, ChunkGuide.of(request), each, timer)
    _check_seen(seen, request)
    frame = Frame.around(seen.low, seen.high)
    stored = sorted_by_boxes(seen, folder, frame, request, each, timer)
    outliers = None
    if request.drop_outliers:
        with timer("outliers", len(stored)) as advanced:
            outliers = outliers_in_parts(stored, each, advanced)
        stored = without(stored, outliers, each)
    selection = _chosen(stored, seen, request, plan, frame, each, timer, outliers)
    kept = take(sources, seen, selection.indices, plan.rows, each, timer)
    if selection.points is not None:
        kept = kept.moved(np.ldexp(selection.points, frame.exponent) + frame.corner)
    if request.scores:
        kept = with_scores(kept, selection)
    return Run(result_of(selection, kept, request.method, timer, outliers), len(stored))


def _check_seen(seen: Overview, request: Request) -> None:
    """Check that there are points, weights, and points to keep, as far as these are asked for."""
    check_usable(seen.count, seen.bad, seen.first_bad, request.invalid)
    if request.keep is not None and not len(seen.keep):
        raise nothing_to_keep(request.keep)
    if request.weight is not None:
        seen.weights.check()


def _chosen(
    stored: StoredPoints,
    seen: Overview,
    request: Request,
    plan: Plan,
    frame: Frame,
    each: Each,
    timer: Timer,
    outliers: NDArray[np.int64] | None,
) -> Selection:
    """Let the method choose; the rows of the selection are those of the cloud."""
    count, spacing = len(stored), None
    if request.amount.spacing is not None:
        diagonal = float(np.linalg.norm(frame.local(seen.high[None])))
        scale = Scale(diagonal, metres_of(request.unit, seen.columns.header), frame.exponent)
        spacing = scale.inside(request.amount.spacing)
    else:
        known = request.amount.known_count(seen.count - seen.bad - (0 if outliers is None else len(outliers)))
        assert known is not None
        count = known
    keep = seen.keep if outliers is None else np.setdiff1d(seen.keep, outliers)
    places = frame.local(seen.places[np.isin(seen.keep, keep)])
    check_count(count, len(keep), len(stored))
    first = first_occurrences(places)
    fixed, again = keep[first], keep[~first]
    asked = Task(places[first], count, spacing, len(fixed), timer=timer, stored=stored, indices=fixed, map_parts=each)

    def chosen(wanted: int) -> Selection:
        if wanted >= len(stored) and spacing is None:
            return Selection(stored.others(NO_ROWS, wanted), ranked=False)
        return request.method(replace(asked, n_points=wanted))

    if request.group is not None:
        return choose_groups(*_groups(seen, _parts(seen, request, outliers)), len(fixed), count, chosen)
    if request.quotas:
        return choose_quotas(_parts(seen, request, outliers), count, keep, len(fixed), again, chosen)
    if count >= len(stored) and spacing is None:
        return chosen(count)
    selection = chosen(count - len(again))
    if len(fixed):
        selection = with_repeats(selection, again, len(fixed))
    lacking = 0 if spacing is not None else count - len(selection.indices)
    return with_others(selection, stored.others(selection.indices, lacking) if lacking > 0 else NO_ROWS)


def _parts(seen: Overview, request: Request, outliers: NDArray[np.int64] | None) -> Parts:
    """Return which quota counts for each row."""
    labels = np.concatenate(seen.labels)
    if outliers is not None:
        labels[outliers] = LEFT_OUT
    return Parts(request.quotas, labels)


def _groups(seen: Overview, parts: Parts) -> tuple[NDArray[np.int64], int]:
    """Return the group of each row, from 0, and the number of groups, in none of which are rows that are left out."""
    usable = parts.labels != LEFT_OUT
    found = groups_of([np.concatenate(column)[usable] for column in zip(*seen.groups, strict=True)])
    number = int(found.max()) + 1
    groups = np.full(len(usable), number)
    groups[usable] = found
    return groups, number
