"""Simplify a cloud in files without ever holding all of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.engine.ahead import compiled_ahead
from gppcs.engine.stages import Stages
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles, JointColumns
from gppcs.methods import Method
from gppcs.simplification import Result, check_scores, check_usable, choose, moved, number_to_keep, with_scores
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.scaling import Frame, bounds
from gppcs.streaming.plan import Plan, Way
from gppcs.streaming.scratch import scratch_folder


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

    Returns
    -------
    result : Result
    n : int
        The number of points in the files.

    Raises
    ------
    FileFormatError, InputError, OSError, ParameterError
        As for `simplify_files`.
    """
    with stages("bounds", plan.points) as advanced:
        seen = _Overview()
        for cloud in files.chunks(True, plan.rows):
            check_scores(scores, method, cloud)
            seen.add(cloud)
            advanced(len(cloud))
    check_usable(seen.count, seen.bad, seen.first_bad, invalid)
    count = number_to_keep(seen.count - seen.bad, ratio, n_points)
    frame = Frame.around(seen.low, seen.high)

    def chunks() -> Iterator[NDArray[np.float64]]:
        for part in _finite_parts(files, plan.rows, seen.count, attributes=False):
            yield frame.local(part.cloud.points)

    points = ChunkedPoints(seen.count - seen.bad, chunks)
    with compiled_ahead(method.name):
        if plan.way is Way.TILES and count < len(points):
            with scratch_folder(scratch, plan.disk) as folder:
                selection = method.in_tiles(points, count, folder, stages)
        else:
            selection = choose(points, count, method, stages)
    with stages("kept points", seen.count - seen.bad) as advanced:
        order = np.argsort(selection.indices)
        indices: list[NDArray[np.int64]] = []
        clouds: list[PointCloud] = []
        finite = 0
        for part in _finite_parts(files, plan.rows, seen.count, attributes=True):
            begin, end = np.searchsorted(selection.indices, [finite, finite + len(part.cloud)], sorter=order)
            taken = selection.indices[order[begin:end]] - finite
            indices.append(part.rows[taken])
            clouds.append(part.cloud.take(taken))
            finite += len(part.cloud)
            advanced(len(part.cloud))
        back = np.empty_like(order)
        back[order] = np.arange(count)
        kept = seen.columns.joined(clouds).take(back)
    if selection.points is not None:
        kept = moved(kept, np.ldexp(selection.points, frame.exponent) + frame.corner)
    if scores:
        kept = with_scores(kept, method, selection)
    return Result(np.concatenate(indices)[back], kept, method, stages.seconds, selection.diagnostics), seen.count


class _Overview:
    """What the first pass finds: the bounds of the finite points, and how many others there are."""

    def __init__(self) -> None:
        self.count = self.bad = self.first_bad = 0
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.columns = JointColumns()

    def add(self, cloud: PointCloud) -> None:
        self.columns.add(cloud)
        low, high = bounds(cloud.points)
        if not np.isfinite([low, high]).all():
            bad = cloud.non_finite()
            self.first_bad = self.first_bad if self.bad else self.count + int(bad[0])
            self.bad += len(bad)
            finite = np.delete(cloud.points, bad, axis=0)
            low, high = bounds(finite) if len(finite) else (self.low, self.high)
        self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)
        self.count += len(cloud)


class _Part(NamedTuple):
    """The finite points of a chunk, and their rows in the whole cloud."""

    cloud: PointCloud
    rows: NDArray[np.int64]


def _finite_parts(files: CloudFiles, rows: int, count: int, attributes: bool) -> Iterator[_Part]:
    """Yield the finite points of all chunks; raise an error if there are not as many points as in the first pass."""
    first = 0
    for cloud in files.chunks(attributes, rows):
        here = np.arange(first, first + len(cloud))
        first += len(cloud)
        if not np.isfinite(bounds(cloud.points)).all():
            finite = cloud.finite_rows()
            cloud, here = cloud.take(finite), here[finite]
        if len(cloud):
            yield _Part(cloud, here)
    if first != count:
        raise InputError(
            f"expected {count:,} points again, found {first:,}: the files have changed meanwhile; start anew"
        )
