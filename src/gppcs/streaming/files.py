"""Simplify files that may be larger than memory: one function decides how, and does it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from numpy.typing import ArrayLike

from gppcs.amounts.request import Request
from gppcs.engine.timer import Timer, timer_of
from gppcs.errors import ParameterError, file_path, shown
from gppcs.io.cloud_files import CloudFiles, open_clouds
from gppcs.io.query import Query
from gppcs.methods import DEFAULT, Method
from gppcs.simplification import Result, simplify_cloud
from gppcs.streaming.beyond_memory import Run, simplify_stored
from gppcs.streaming.plan import Plan, plan
from gppcs.streaming.scratch import scratch_folder
from gppcs.streaming.sizes import bytes_of
from gppcs.streaming.workers import each_by


def simplify_files(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    ratio: float | str | None = None,
    n_points: int | str | None = None,
    tolerance: float | str | None = None,
    spacing: float | str | None = None,
    max_gap: float | str | None = None,
    unit: str | None = None,
    keep: str | ArrayLike | None = None,
    weight: str | ArrayLike | None = None,
    detail: str | Mapping[str, float] | None = None,
    quota: Mapping[str, float | str] | None = None,
    group: str | None = None,
    method: str | Method = DEFAULT,
    seed: int | None = None,
    invalid: Literal["error", "drop"] = "error",
    normals: bool = False,
    scores: bool = False,
    drop_outliers: bool = False,
    denoise: bool = False,
    format: str | None = None,  # noqa: A002
    columns: Sequence[str] | None = None,
    box: Sequence[float] | None = None,
    resolution: float | None = None,
    only: str | None = None,
    polygon: str | os.PathLike[str] | None = None,
    assume_same_crs: bool = False,
    memory: int | str | None = None,
    scratch: str | os.PathLike[str] | None = None,
    executor: Executor | None = None,
    timer: Timer | None = None,
) -> Result:
    """Choose M points of a cloud in files, which may be larger than memory.

    If the cloud fits into the memory allowed, it is read and simplified as by `gppcs.simplify`. Otherwise the methods
    `gp`, `fps`, `voxel` and `random` store its points in temporary files, sorted by place, and choose part by part:
    exactly as many points, without seams and as good ones as in memory, but other ones. The result depends neither on
    the number of workers nor on how much memory is allowed beyond that.

    Parameters
    ----------
    paths : path, or sequence of paths
        One file or several, in any format that `gppcs.read` reads. Several files are one cloud: its points are those of
        the first, then those of the second and so on. They must have the same attributes. A virtual point cloud (.vpc)
        stands for the files that it lists.
    ratio, n_points, method, seed, invalid, normals, scores, drop_outliers, denoise, timer
        As for `gppcs.simplify`. `normals` and `denoise` need all points in memory.
    tolerance, spacing, max_gap, unit, keep, weight, detail, quota, group
        As for `gppcs.simplify`. All points must be in memory for `tolerance` and `max_gap`, for texts as `detail`, for
        `keep` that is no condition, and for `weight` that is no name.
    format, columns
        As for `gppcs.read`, for all files. A text table whose columns are named so is read as a whole.
    box, resolution, only, polygon
        As for `gppcs.read`: which points of each file to read. Only these are the cloud, and `indices` are rows
        among them.
    assume_same_crs : bool
        Whether all files get the coordinate system of the first one. Otherwise, files with different coordinate
        systems are an error.
    memory : int or str, optional
        How much memory the process may hold: bytes, or a text such as "4GB" or "512 MiB". By default, half of what is
        free.
    scratch : path, optional
        An existing folder for temporary files, on a disk with enough space; by default the system's.
    executor : concurrent.futures.Executor, optional
        Who works on parts of the cloud, such as a `ProcessPoolExecutor`, or `client.get_executor()` of a Dask cluster
        (docs/large-files.md). The workers must see the files, and `scratch`, at the same paths. By default threads.

    Returns
    -------
    Result
        As of `gppcs.simplify` for the whole cloud.

    Raises
    ------
    ClusterError
        If the workers cannot be reached, have another version of gppcs, or end again and again.
    FileFormatError
        If a file is damaged, its format is unknown, `resolution` is given and the file is not COPC, or the files do
        not fit each other.
    InputError
        As for `gppcs.simplify`, and if the work would take more memory than allowed, or no point is in the box.
    ParameterError
        As for `gppcs.simplify`, and if `memory` is no number of bytes, or `format`, `columns`, `box` or `resolution` is
        not as above.
    OutputError
        If `scratch` does not exist, or its disk has too little space.
    OSError
        If a file does not exist or cannot be read.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=20_000)
    >>> gppcs.write("east.ply", cloud.take(range(12_000)))
    >>> gppcs.write("west.ply", cloud.take(range(12_000, 20_000)))
    >>> result = gppcs.simplify_files(["east.ply", "west.ply"], n_points=500, memory="2GB")
    >>> len(result.cloud)
    500
    """
    if isinstance(paths, str | os.PathLike):
        paths = [paths]
    if not isinstance(paths, Sequence) or not paths:
        raise ParameterError(f"expected a file or a list of files, found {shown(paths)}")
    request = Request.of(
        ratio=ratio, n_points=n_points, tolerance=tolerance, spacing=spacing, max_gap=max_gap,
        unit=unit, keep=keep, weight=weight, detail=detail, quota=quota, group=group, method=method, seed=seed,
        invalid=invalid, normals=normals, scores=scores, drop_outliers=drop_outliers, denoise=denoise,
    )  # fmt: skip
    work = Work(
        None if memory is None else bytes_of(memory), None if scratch is None else file_path(scratch), executor,
        timer_of(timer),
    )  # fmt: skip
    query = Query.of(box, resolution, only, polygon)
    with open_clouds(paths, format, columns, query, assume_same_crs) as files:
        return run(files, request, work).result


@dataclass(frozen=True)
class Work:
    """How the work on a cloud is done."""

    memory: int | None  # bytes that the process may hold
    scratch: Path | None  # for temporary files
    executor: Executor | None  # who works on parts of the cloud
    timer: Timer

    def planned(self, files: CloudFiles, request: Request, whole: str | None = None) -> Plan:
        """Return how a cloud is going to be simplified; `whole` is what takes all points at once."""
        return plan(files, request, self.memory, whole, self.executor is not None)


def run(files: CloudFiles, request: Request, work: Work, planned: Plan | None = None) -> Run:
    """Simplify the cloud in some files."""
    planned = planned or work.planned(files, request)
    if planned.in_memory:
        with work.timer("reading"):
            cloud = files.read()
        result = simplify_cloud(cloud, request, work.timer)
        left_out = 0 if result.outliers is None else len(result.outliers)
        return Run(result, len(cloud) - left_out, cloud)
    with scratch_folder(work.scratch, planned.disk) as folder, each_by(work.executor, planned.threads) as each:
        return simplify_stored(files, request, planned, folder, each, work.timer)
