"""Simplify a cloud, in memory or in files: the steps that all methods share."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial, wraps
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from gppcs.amounts.options import Options, method_of
from gppcs.amounts.order import in_order
from gppcs.clouds.cloud import CloudLike, PointCloud, array_of
from gppcs.engine.threads import number_of_threads
from gppcs.engine.timer import Timer, timer_of
from gppcs.errors import InputError, ParameterError, file_path, shown
from gppcs.io.joining import joined
from gppcs.io.reading import Function, source_of, taking_old_names
from gppcs.io.streams import check_distinct, without_query
from gppcs.methods import DEFAULT, Method, Selection
from gppcs.result import BatchResult, Result
from gppcs.steps import check_addable, result_of, simplify_cloud

if TYPE_CHECKING:
    from gppcs.io.cloud_files import CloudFiles
    from gppcs.streaming.folder import Target, Written
    from gppcs.streaming.plan import Plan


def _taking_old_settings(function: Function) -> Function:
    """Let a function take parameters of the method by themselves, with a warning, until release 0.3."""

    @wraps(function)
    def with_old_settings(*arguments: Any, **options: Any) -> Any:
        old = {name: options.pop(name) for name in ("seed", "denoise") if name in options}
        for name, value in old.items():
            if value is not None and value is not False:
                example = f"gppcs.{'LocalGP' if name == 'denoise' else 'Random'}({name}={value})"
                instead = f"set it where the method is made, as in method={example}"
                warnings.warn(f"`{name}` is deprecated here: {instead}", DeprecationWarning, stacklevel=3)
                options["method"] = method_of(options.get("method", DEFAULT), {name: value})
        return function(*arguments, **options)

    return cast(Function, with_old_settings)


@taking_old_names
@_taking_old_settings
def simplify(
    cloud: CloudLike,
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
    method: str | Method = DEFAULT,
    invalid: Literal["error", "drop"] = "error",
    drop_outliers: bool = False,
    normals: bool = False,
    scores: bool = False,
    order: Literal["importance", "input", "gps_time"] = "importance",
    memory: int | str | None = None,
    workers: str | Executor | None = None,
    scratch: str | os.PathLike[str] | None = None,
    timer: Timer | None = None,
) -> Result:
    """Choose M points of a cloud: a number, or as many as a tolerance, a spacing or a largest gap takes.

    Give one of `ratio`, `n_points`, `tolerance` and `spacing`, or `max_gap`. A length is a number in the unit of the
    coordinates, or a text: with a unit, such as "0.5mm", or a percentage of the diagonal of the bounding box, such as
    "0.02%". Points that exactly repeat others count as points, but are chosen last.

    Files that fit into the memory allowed are read and simplified as clouds are. Of others, methods that take points to
    keep, and "voxel", choose tile by tile: exactly as many points, about as good ones as in memory, but other ones.

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like, object that `PointCloud.from_object` takes, file, list of files or CloudFiles
        The original points, which are not changed. Several files are one cloud: its points are those of the first, then
        those of the second and so on. `gppcs.open` tells how to read files, and which of their points.
    ratio : float or str, optional
        Fraction of the points to keep: 0.03 or 3%. Above 0 and at most 1.
    n_points : int or str, optional
        Number of points to keep, such as 5000 or 1.5M. If there are fewer, all are kept.
    tolerance : float or str, optional
        Keep the fewest points whose surface is that near to all points but outliers: 0.5, 0.5mm, 0.02% of the diagonal,
        or 2mm:p95 (:mean, :rms, :max). With one of these behind it, it bounds that error; with :max, outliers count.
    spacing : float or str, optional
        Keep as many points as have this spacing, such as 5cm (gp, fps, sample-elimination, voxel). The descriptions of
        the methods say what it means.
    max_gap : float or str, optional
        Add points until each original one has a kept one within this length. Alone, or beside another amount.
    unit : str, optional
        Unit of the coordinates, such as m, if the file tells none.
    keep : str or array-like, optional
        Keep all points that meet a condition, such as 'classification == 6' (gp, fps, random). Or a mask or indices.
        They count, and come first.
    weight : str or array-like, optional
        Multiply the density by an attribute or a formula, such as 1/(x*x + y*y) (gp). Or by an array. Weights are 0 or
        above; no point of weight 0 is kept, but those to keep.
    detail : str or mapping of str to float, optional
        Let an attribute count beside the shape: rgb, a number or classes (gp). A mapping has several with their
        weights, from 0 to 1000; the weight of one is 1.
    quota : mapping of str to float or str, optional
        Keep exactly this number or fraction of points that meet a condition, such as 'z > 6: 10%'. In Python
        {'z > 6': '10%'}, a fraction of the kept points (methods that rank their points).
    method : str or Method
        The method: its name, or in Python an instance with other parameters.
    invalid : {"error", "drop"}
        Whether invalid coordinates are an error, or dropped. Invalid are NaN and infinite ones.
    drop_outliers : bool
        First drop points that neither their neighbours nor the surface explain. They do not count in ratios.
    normals : bool
        Add normals, estimated from all points of the input. On closed pieces they point outward, on flat ones along +z.
    scores : bool
        Add the score and deviation of each point (gp). They are those when it was chosen.
    order : {"importance", "input", "gps_time"}
        Order of the result: importance, input or gps_time. By importance, the first points are a good smaller result.
    memory : int or str, optional
        How much memory to use, such as 2GB; by default half of what is free. Larger clouds go tile by tile.
    workers : str or Executor, optional
        Share the work among workers of Dask, such as tcp://10.0.0.5:8786. Or of an executor of concurrent.futures.
    scratch : path, optional
        An existing folder for temporary files, by default the system's.
    timer : Timer, optional
        Measures the time of each stage, and reports progress.

    Returns
    -------
    Result
        The same input gives the same result, for any number of threads or workers. So does a shifted or scaled input,
        if rounding does not change the differences of its coordinates.

    Raises
    ------
    InputError
        If the cloud is empty, has a wrong shape or coordinates that are not finite; if it does not have what the
        options name; if a length has a unit and that of the cloud is not known; or if the work would take more memory
        than allowed.
    ParameterError
        If an option is outside its range, the method does not exist or cannot do what is asked for, or a condition
        cannot be read.
    FileFormatError
        If a file is damaged, its format is unknown, or several files do not fit each other.
    OutputError
        If `scratch` does not exist, or its disk has too little space.
    GppcsError
        If the workers are lost.
    OSError
        If a file does not exist or cannot be read.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> gppcs.simplify(cloud, ratio=0.1, method="fps").indices.shape
    (200,)
    >>> gppcs.simplify(cloud, n_points=50, method=gppcs.Random(seed=7)).cloud.points.shape
    (50, 3)
    >>> painted = gppcs.simplify(cloud, n_points=50, detail="rgb")
    >>> fine = gppcs.simplify(cloud, tolerance="1%")
    >>> gppcs.evaluate(cloud, fine.cloud).surface_max <= 0.01 * gppcs.info(cloud).diagonal
    True
    >>> gppcs.write("east.ply", cloud.take(range(1200)))
    >>> gppcs.write("west.ply", cloud.take(range(1200, 2000)))
    >>> len(gppcs.simplify(["east.ply", "west.ply"], n_points=500, memory="2GB").cloud)
    500
    """
    options = Options(**{name: value for name, value in locals().items() if name not in ("cloud", "timer")})
    timer, source = timer_of(timer), source_of(cloud)
    if source is None:
        options.check_in_memory()
        with timer("preparation"):
            in_memory = PointCloud.from_object(cloud)
        return simplify_cloud(in_memory, options, timer)
    from gppcs.streaming.plan import make_plan

    with source as files:
        return simplify_files(files, options, make_plan(files, options), timer)


@_taking_old_settings
def simplify_batch(
    clouds: ArrayLike | Sequence[CloudLike], *, timer: Timer | None = None, **options: Any
) -> BatchResult:
    """Simplify many small clouds, each by itself, as many at once as there are threads.

    Parameters
    ----------
    clouds : (B, N, 3) array-like, or sequence of what `simplify` takes
        The clouds, such as a tensor on the CPU, or files of one cloud each. (B, N, 2) are clouds of the plane z = 0.
    timer : Timer, optional
        Reports how many clouds are done.
    options : optional
        Those of `simplify`, which count for each cloud.

    Returns
    -------
    BatchResult
        A tuple of the B results. Its `indices` are (B, M), its `points` (B, M, 3). They do not depend on the threads.

    Raises
    ------
    InputError, ParameterError, FileFormatError, OSError
        As in `simplify`. Then no further cloud begins.

    Examples
    --------
    >>> batch = np.stack([gppcs.sample("bracket", n_points=1000, seed=seed).points for seed in range(3)])
    >>> indices = gppcs.simplify_batch(batch, n_points=100).indices
    >>> np.take_along_axis(batch, indices[..., np.newaxis], axis=1).shape
    (3, 100, 3)
    """
    from gppcs.streaming.graph import engine

    expected = "a (B, N, 3) array or a list of clouds"
    listed = clouds if isinstance(clouds, list | tuple) else array_of(clouds, expected)
    if isinstance(listed, np.ndarray) and listed.ndim != 3:
        raise InputError(f"expected {expected}, found {listed.shape or shown(clouds)}")
    with timer_of(timer)("clouds", len(listed)) as on_progress, engine(None, number_of_threads()) as run_on:
        return BatchResult(run_on.run(partial(simplify, **options), list(listed), on_progress=on_progress))


@taking_old_names
@_taking_old_settings
def simplify_tiles(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | CloudFiles,
    output: str | os.PathLike[str],
    *,
    force: bool = False,
    lossy: bool = False,
    timer: Timer | None = None,
    **options: Any,
) -> dict[str, int]:
    """Simplify files as one cloud, and write the kept points of each to a file of its name in a folder.

    Beside them, `index.vpc` lists all files. The kept points of files larger than memory are never held together. If a
    run is stopped, the same call goes on where it was.

    Parameters
    ----------
    paths : path, list of paths or CloudFiles
        The files, such as tiles that touch. A virtual point cloud (.vpc) stands for the files that it lists.
    output : path
        The folder, which is made if there is none. With workers on other machines, they must reach it.
    force : bool
        Whether to begin anew, and to overwrite existing files.
    lossy : bool
        Whether to leave out what a format cannot hold.
    timer : Timer, optional
        Measures the time of each stage, and reports progress.
    options : optional
        Those of `simplify` for clouds in files, such as `ratio`, which count all files together.

    Returns
    -------
    dict of str to int
        The number of points in each file that was written, by its path.

    Raises
    ------
    OutputError
        If a file exists, the folder cannot be written, or a run was begun there with other options, files that have
        changed since, or another version of gppcs.
    InputError, ParameterError, FileFormatError, GppcsError, OSError
        As in `simplify`.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> gppcs.write("east.ply", cloud.take(range(1200)))
    >>> gppcs.write("west.ply", cloud.take(range(1200, 2000)))
    >>> sum(gppcs.simplify_tiles(["east.ply", "west.ply"], "small", n_points=500).values())
    500
    """
    from gppcs.streaming.folder import Target
    from gppcs.streaming.plan import make_plan

    chosen, source = Options(**options), source_of(paths)
    if source is None:
        raise ParameterError(f"expected names of files, found {shown(paths)}")
    with source as files:
        names = [without_query(path).name for path in files.paths]
        targets = [Target(file_path(output) / name, None, chosen.order, lossy) for name in names]
        check_distinct([target.path for target in targets], files.paths)
        written, _, _ = simplify_each(
            files, targets, chosen, make_plan(files, chosen, to_files=True), timer_of(timer), force
        )
    return {str(file.target): file.n_points for file in written}


def simplify_files(files: CloudFiles, options: Options, plan: Plan, timer: Timer) -> Result:
    """Simplify a cloud in files as planned: in memory, or tile by tile."""
    if plan.in_memory:
        with timer("reading"):
            cloud = files.read()
        return simplify_cloud(cloud, options, timer)
    from gppcs.streaming.amounts import chosen_in_tiles
    from gppcs.streaming.output import take

    check_addable(files.preview, options)
    with chosen_in_tiles(files, options, plan, timer) as (survey, choice, diagnostics):
        kept = choice.all_kept(range(len(choice.tiling.tiles)))
        with timer("kept points"):
            cloud = take(survey.parts, kept, survey.overview.columns, survey.run_on.run)
    outliers = survey.source.excluded if options.drop_outliers else None
    selection, ranks = Selection(kept.indices, diagnostics, attributes=kept.scores), np.arange(len(cloud))
    if options.order != "importance":
        ranks = in_order(cloud, kept.indices, options.order)
        selection, cloud = selection.arranged(kept.indices[ranks]), cloud.take(ranks)
    return result_of(selection, cloud, ranks, outliers, survey.n_points, options, timer)


def simplify_each(
    files: CloudFiles, targets: Sequence[Target], options: Options, plan: Plan, timer: Timer, force: bool
) -> tuple[Sequence[Written], int, Mapping[str, float]]:
    """Simplify files as one cloud, and write the kept points of each to a file.

    Returns the files, the number of points among which was chosen, and diagnostics.

    A run that was stopped goes on where it was, if it goes tile by tile.
    """
    from gppcs.streaming.folder import run_in_folder, write_index

    for name in ("levels", "index", "rank", "mark"):
        if getattr(options, name):
            raise ParameterError(f"expected `{name}` with one output file, or each input by itself, found a folder")
    if files.reads_standard_input:
        raise InputError("expected names of files for one result each, found standard input or an open file; save it")
    check_addable(files.preview, options)
    with run_in_folder(files, options, targets, force) as work:
        if plan.in_memory:
            written, points_in, diagnostics = _each_in_memory(files, targets, options, timer)
        else:
            written, points_in, diagnostics = _each_by_tiles(files, targets, options, plan, work, timer)
        write_index(work.parent, written)
    return written, points_in, diagnostics


def _each_in_memory(
    files: CloudFiles, targets: Sequence[Target], options: Options, timer: Timer
) -> tuple[Sequence[Written], int, Mapping[str, float]]:
    """Simplify files as one cloud in memory, and write the kept points of each."""
    with timer("reading"):
        clouds = files.read_each()
    result = simplify_cloud(joined(clouds), options, timer)
    ends = np.cumsum([len(cloud) for cloud in clouds])
    written = []
    for target, cloud, end in zip(targets, clouds, ends.tolist(), strict=True):
        positions = np.flatnonzero((result.indices >= end - len(cloud)) & (result.indices < end))
        kept = replace(result.cloud.take(positions), header=cloud.header)
        written.append(target.write(kept, result.indices[positions]))
    return written, result.points_in, result.diagnostics


def _each_by_tiles(
    files: CloudFiles, targets: Sequence[Target], options: Options, plan: Plan, work: Path, timer: Timer
) -> tuple[Sequence[Written], int, Mapping[str, float]]:
    """Simplify files as one cloud tile by tile, and write the kept points of each."""
    from gppcs.streaming.amounts import chosen_in_tiles
    from gppcs.streaming.folder import write_file

    with chosen_in_tiles(files, options, plan, timer, work) as (survey, choice, diagnostics):
        by_file = groupby(survey.parts, lambda part: part.files.paths)
        tasks = [(list(parts), target) for (_, parts), target in zip(by_file, targets, strict=True)]
        with timer("writing", len(tasks)) as on_progress:
            written = survey.run_on.run(partial(write_file, choice), tasks, on_progress=on_progress)
        return written, survey.n_points, diagnostics
