"""Simplify a cloud that does not fit into memory: its points are stored by boxes, and chosen part by part."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gppcs.amounts.choice import check_count, choose_number
from gppcs.amounts.constraints import Constraints, check_constraints, check_finite
from gppcs.amounts.options import Options
from gppcs.amounts.quotas import EXCLUDED
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.quantities import Scale, units_of
from gppcs.engine.arrays import Ints
from gppcs.engine.timer import Timer
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods import Selection, Task
from gppcs.spatial.boxes import MapParts
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.scaling import Frame
from gppcs.spatial.stored import StoredPoints, without
from gppcs.spatial.units import Units
from gppcs.streaming.plan import Plan
from gppcs.streaming.scan import Overview, read_all, sorted_by_boxes, take
from gppcs.surface.outliers import outliers_in_parts


def choose_beyond_memory(
    files: CloudFiles, options: Options, plan: Plan, folder: Path, map_parts: MapParts, timer: Timer
) -> tuple[Selection, PointCloud, Ints | None, int]:
    """Choose points of files, with temporary files in a folder.

    Returns the selection, the kept points as they are in the files, the outliers, if any are dropped, and the number of
    points among which was chosen.
    """
    sources = files.parts(plan.part)
    overview = read_all(sources, folder, plan.points_in, options, map_parts, timer)
    check_finite(overview.count, overview.n_bad, overview.first_bad, options.invalid)
    check_constraints(options, len(overview.keep), overview.weights)
    units = units_of(options.unit, overview.columns.header)
    frame = Frame.from_bounds(overview.lower, overview.upper, units)
    stored = sorted_by_boxes(overview, folder, frame, options, map_parts, timer)
    outliers = None
    if options.drop_outliers:
        with timer("outliers", len(stored)) as on_progress:
            outliers = outliers_in_parts(stored, map_parts, on_progress)
        stored = without(stored, outliers, map_parts)
    selection = _chosen(stored, overview, outliers, options, units, frame, map_parts, timer)
    kept = take(sources, overview, selection.indices, map_parts, timer)
    if selection.points is not None:
        kept = kept.moved(frame.world(selection.points))
    return selection, kept, outliers, len(stored)


def _chosen(
    stored: StoredPoints,
    overview: Overview,
    outliers: Ints | None,
    options: Options,
    units: Units | None,
    frame: Frame,
    map_parts: MapParts,
    timer: Timer,
) -> Selection:
    """Let the method choose; indices are those in the cloud."""
    keep, keep_points = overview.keep, frame.local(overview.keep_points)
    labels = np.concatenate(overview.labels) if overview.labels else None
    if outliers is not None:
        is_outlier = np.isin(keep, outliers)
        keep, keep_points = keep[~is_outlier], keep_points[~is_outlier]
        if labels is not None:
            labels[outliers] = EXCLUDED
    is_first = first_occurrences(keep_points)
    task = Task(
        keep_points[is_first],
        len(stored),
        fixed=int(is_first.sum()),
        timer=timer,
        stored=stored,
        indices=keep[is_first],
        map_parts=map_parts,
    )
    if options.spacing is not None:
        diagonal = float(np.linalg.norm(frame.local(overview.upper[None])))
        scale = Scale(diagonal, units, frame.exponent)
        spacing = scale.inside(options.lengths["spacing"])
        return options.algorithm(replace(task, spacing=spacing))

    def rank(n: int) -> Selection:
        if n >= len(stored):
            return Selection(stored.besides(np.empty(0, dtype=np.int64), n), ranked=False)
        return options.algorithm(replace(task, n_points=n))

    count = options.count(overview.count - overview.n_bad - (0 if outliers is None else len(outliers)))
    assert count is not None
    check_count(count, len(keep), len(stored))
    if count >= len(stored) and not options.quotas and options.group is None:
        return rank(count)
    groups = [np.concatenate(parts) for parts in zip(*overview.groups, strict=True)]
    constraints = Constraints(keep, labels=labels, groups=groups)
    return choose_number(count, options, constraints, keep[~is_first], rank, stored.besides)
