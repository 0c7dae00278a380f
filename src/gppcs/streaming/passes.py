"""Simplify a cloud in files without ever holding all of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.choice import choose
from gppcs.clouds.cloud import PointCloud
from gppcs.engine.ahead import compiled_ahead
from gppcs.engine.journal import Journal
from gppcs.engine.stages import Stages
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods import Method, Selection
from gppcs.simplification import Result, check_scores, check_usable, number_to_keep, with_scores
from gppcs.spatial.scaling import Frame
from gppcs.streaming.cluster import Cluster
from gppcs.streaming.overview import Overview
from gppcs.streaming.partitions import ClusterPasses
from gppcs.streaming.plan import Plan, Way
from gppcs.streaming.reading import FilePasses
from gppcs.streaming.scratch import scratch_folder, work_name


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
) -> tuple[Result, int]:
    """Choose exactly M points of a cloud without ever holding all of it.

    Parameters
    ----------
    files : CloudFiles
    plan : Plan
        Made for them.
    method : Method
    ratio, n_points, invalid, scores
        As for `simplify_files`.
    stages : Stages
        Times "bounds", the stages of the method, and "kept points". A step of a pass is a point.
    scratch : path, optional
        As for `simplify_files`.
    cluster : Cluster, optional
        Where to work; by default in this process.
    resume : bool
        As for `simplify_files`.

    Returns
    -------
    result : Result
    n : int
        The number of points in the files.

    Raises
    ------
    ClusterError, FileFormatError, InputError, OSError, ParameterError
        As for `simplify_files`.
    """
    check_scores(scores, method, files.head().cloud)
    passes = ClusterPasses(files, plan.rows, cluster, plan.part) if cluster else FilePasses(files, plan.rows)
    asked = (method, ratio, n_points, invalid, plan.way, cluster is not None)
    with scratch_folder(scratch, plan.disk, work_name(files, asked) if resume else None) as folder:
        journal = Journal(folder)
        seen = journal.once("bounds", lambda: _overview(passes, plan, stages))
        check_usable(seen.count, seen.bad, seen.first_bad, invalid)
        count = number_to_keep(seen.finite, ratio, n_points)
        frame = Frame.around(seen.low, seen.high)
        points = passes.points(seen, frame)
        each = cluster.each if cluster else map

        def chosen() -> Selection:
            with compiled_ahead(method.name):
                if plan.way is Way.TILES and count < len(points):
                    return method.in_tiles(points, count, folder, stages, each)
                return choose(points, count, method, stages)

        selection = journal.once("choice", chosen)
        rows, kept = _kept(passes, seen, selection, stages)
    if selection.points is not None:
        kept = kept.moved(np.ldexp(selection.points, frame.exponent) + frame.corner)
    if scores:
        kept = with_scores(kept, method, selection)
    ranked = method.ranks and selection.ranked
    return Result(rows, kept, method, stages.seconds, selection.diagnostics, ranked=ranked), seen.count


def _overview(passes: FilePasses | ClusterPasses, plan: Plan, stages: Stages) -> Overview:
    with stages("bounds", plan.points) as advanced:
        return passes.overview(advanced)


def _kept(
    passes: FilePasses | ClusterPasses, seen: Overview, selection: Selection, stages: Stages
) -> tuple[NDArray[np.int64], PointCloud]:
    """Read the chosen points with their attributes, in the order of choice, and their rows among all points."""
    with stages("kept points", seen.finite) as advanced:
        order = np.argsort(selection.indices)
        rows, clouds = passes.kept(seen, selection.indices[order], advanced)
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return rows[back], seen.columns.joined(clouds).take(back)
