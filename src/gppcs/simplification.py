"""Simplify a cloud, in memory or in files: the steps that all methods share."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from gppcs.amounts.choice import choose_by_options
from gppcs.amounts.constraints import Constraints, WeightRange, check_constraints, check_finite
from gppcs.amounts.options import Options, described_options, require
from gppcs.amounts.order import check_order, in_order
from gppcs.clouds.cloud import CloudLike, PointCloud, with_normals
from gppcs.clouds.objects import single_or_double
from gppcs.clouds.quantities import Scale, count_of, units_of
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.equality import ComparedByValue
from gppcs.engine.timer import Timer, in_words, timer_of
from gppcs.errors import InputError, ParameterError
from gppcs.io.joining import joined
from gppcs.io.streams import check_distinct
from gppcs.methods import DEFAULT, Feature, Method, Selection
from gppcs.methods.method import SCORES
from gppcs.spatial.units import Units

if TYPE_CHECKING:  # for arrays, no files are needed
    from gppcs.io.cloud_files import CloudFiles
    from gppcs.streaming.folder import Target, Written
    from gppcs.streaming.plan import Plan


@dataclass(frozen=True, eq=False)
class Result(ComparedByValue):
    """A simplified cloud, with the method and the times of the run.

    It can be used wherever a cloud can, as in `gppcs.evaluate(cloud, result)` and `gppcs.write("small.ply", result)`:
    `len(result)` is M, and `np.asarray(result)` is `result.points`.

    Attributes
    ----------
    indices : (M,) array, int64
        The indices of the kept points in the input: unique, in the order chosen, or that of the option `order`.
    cloud : PointCloud
        The kept points in that order, with all their attributes. If the method moves points, these are the moved ones.
    method : Method
        The method with all its parameters.
    seconds : mapping of str to float
        Wall time of each stage in seconds, in the order of the run. If kernels were compiled meanwhile, that time is in
        an entry of its own, `compilation`.
    diagnostics : mapping of str to float
        Figures that the method reports about its run, such as fitted hyperparameters.
    outliers : (n,) array, int64, or None
        The indices of the points that were dropped as outliers, ascending. None if none were looked for.
    ranked : bool
        Whether the first points are a simplification to fewer points: if the method ranks its points, not all but
        repeats were kept, and the order is that of importance.
    points_in : int
        Number of points among which was chosen: those of the input that were not dropped; 0 if that is not known.

    Examples
    --------
    >>> import gppcs
    >>> result = gppcs.simplify(gppcs.sample("sphere", n_points=1000), n_points=100, method="random")
    >>> isinstance(result, gppcs.Result)
    True
    >>> result.points.shape, len(result), str(result.method)
    ((100, 3), 100, 'random')
    """

    indices: Ints
    cloud: PointCloud
    method: Method
    seconds: Mapping[str, float]
    diagnostics: Mapping[str, float]
    outliers: Ints | None = None
    ranked: bool = field(default=True, repr=False, compare=False)
    points_in: int = field(default=0, repr=False, compare=False)

    @property
    def points(self) -> NDArray[np.floating[Any]]:
        """The coordinates of the kept points, (M, 3): float32 if those of the input were, otherwise float64."""
        return single_or_double(self.cloud)

    def __len__(self) -> int:
        return len(self.indices)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is False:
            raise ValueError("expected that a copy may be made of the points of a Result, found copy=False")
        return np.asarray(self.points, dtype)  # which are a copy

    def __repr__(self) -> str:
        return f"Result({len(self):,} points by {self.method} in {in_words(self.seconds)})"

    def prefix(self, n_points: int) -> Result:
        """Return the first `n_points` points, a simplification to fewer points, if the method ranks its points.

        Diagnostics and times are those of the whole run.

        Examples
        --------
        >>> result = gppcs.simplify(gppcs.sample("bracket", n_points=2000), n_points=200, method="fps")
        >>> len(result.prefix(50))
        50
        """
        count = count_of("n_points", n_points)
        if count > len(self):
            raise ParameterError(f"expected at most {len(self):,} points, as the result has, found {count:,}")
        require(self.method, Feature.RANKING)
        if not self.ranked:
            raise ParameterError(
                "expected points in the order of importance, found another one, or all points in the order of the "
                "cloud; ask for fewer points, and for no other order"
            )
        return replace(self, indices=self.indices[:count], cloud=self.cloud.take(np.arange(count)))


def simplify(
    cloud: CloudLike | Sequence[str | os.PathLike[str]],
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
    seed: int | None = None,
    invalid: Literal["error", "drop"] = "error",
    drop_outliers: bool = False,
    normals: bool = False,
    scores: bool = False,
    denoise: bool = False,
    order: Literal["importance", "input", "gps_time"] = "importance",
    format: str | None = None,  # noqa: A002  # as NumPy and pandas say
    columns: Sequence[str] | None = None,
    inside: Sequence[Any] | str | os.PathLike[str] | None = None,
    resolution: float | None = None,
    only: str | None = None,
    assume_same_crs: bool = False,
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
    cloud : PointCloud, (N, 3) array-like, path, list of paths or object that `PointCloud.from_object` takes
        The original points, which are not changed. Several files are one cloud: its points are those of the first, then
        those of the second and so on. A virtual point cloud (.vpc) stands for the files that it lists.
    OPTIONS
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
    timer = timer_of(timer)
    paths = [cloud] if isinstance(cloud, str | os.PathLike) else cloud
    if not isinstance(paths, list | tuple) or not paths or not all(isinstance(p, str | os.PathLike) for p in paths):
        options.check_in_memory()
        with timer("preparation"):
            in_memory = PointCloud.from_object(cast(CloudLike, cloud))
        return simplify_cloud(in_memory, options, timer)
    from gppcs.streaming.plan import make_plan

    with options.open(cast(Sequence[str], paths)) as files:
        return simplify_files(files, options, make_plan(files, options), timer)


if simplify.__doc__:  # which `python -OO` removes
    simplify.__doc__ = simplify.__doc__.replace("    OPTIONS\n", described_options())


def simplify_tiles(
    paths: Sequence[str | os.PathLike[str]],
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
    paths : sequence of paths
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

    chosen = Options(**options)
    with chosen.open(paths) as files:
        targets = [Target(Path(output, path.name), None, chosen.order, lossy) for path in files.paths]
        check_distinct([target.path for target in targets], files.paths)
        written, _ = simplify_each(
            files, targets, chosen, make_plan(files, chosen, to_files=True), timer_of(timer), force
        )
    return {str(file.target): file.n_points for file in written}


def simplify_files(files: CloudFiles, options: Options, plan: Plan, timer: Timer) -> Result:
    """Simplify a cloud in files as planned: in memory, or tile by tile."""
    if plan.in_memory:
        with timer("reading"):
            cloud = files.read()
        return simplify_cloud(cloud, options, timer)
    from gppcs.streaming.amounts import choose
    from gppcs.streaming.beyond_memory import Survey
    from gppcs.streaming.graph import engine
    from gppcs.streaming.output import take
    from gppcs.streaming.scratch import scratch_folder

    _check_preview(files, options)
    with (
        scratch_folder(options.scratch, plan.disk) as folder,
        engine(options.workers, plan.threads) as run_on,
    ):
        survey = Survey.read(files.parts(plan.part), options, folder, folder, run_on, timer)
        choice, diagnostics = choose(survey)
        kept = choice.all_kept()
        with timer("kept points"):
            cloud = take(survey.parts, kept, survey.overview.columns, run_on.run)
    selection = Selection(kept.indices, diagnostics, attributes=kept.scores)
    return _result(selection, cloud, survey.outliers, survey.n_points, options, timer)


def simplify_each(
    files: CloudFiles, targets: Sequence[Target], options: Options, plan: Plan, timer: Timer, force: bool
) -> tuple[Sequence[Written], Mapping[str, float]]:
    """Simplify files as one cloud, and write the kept points of each to a file; return these and diagnostics.

    A run that was stopped goes on where it was, if it goes tile by tile.
    """
    from gppcs.streaming.folder import run_in_folder, write_index

    _check_preview(files, options)
    with run_in_folder(files.paths, options, targets, force) as work:
        if plan.in_memory:
            written, diagnostics = _each_in_memory(files, targets, options, timer)
        else:
            written, diagnostics = _each_by_tiles(files, targets, options, plan, work, timer)
        write_index(work.parent, written)
    return written, diagnostics


def _each_in_memory(
    files: CloudFiles, targets: Sequence[Target], options: Options, timer: Timer
) -> tuple[Sequence[Written], Mapping[str, float]]:
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
    return written, result.diagnostics


def _each_by_tiles(
    files: CloudFiles, targets: Sequence[Target], options: Options, plan: Plan, work: Path, timer: Timer
) -> tuple[Sequence[Written], Mapping[str, float]]:
    """Simplify files as one cloud tile by tile, and write the kept points of each."""
    from gppcs.streaming.amounts import choose
    from gppcs.streaming.beyond_memory import Survey
    from gppcs.streaming.folder import write_file
    from gppcs.streaming.graph import engine
    from gppcs.streaming.scratch import scratch_folder

    with scratch_folder(options.scratch, plan.disk) as scratch, engine(options.workers, plan.threads) as run_on:
        survey = Survey.read(files.parts(plan.part), options, scratch, work, run_on, timer)
        choice, diagnostics = choose(survey)
        tasks = [(survey.parts_of(path), target) for path, target in zip(files.paths, targets, strict=True)]
        with timer("writing", len(tasks)) as on_progress:
            return run_on.run(partial(write_file, choice), tasks, on_progress=on_progress), diagnostics


def simplify_cloud(cloud: PointCloud, options: Options, timer: Timer) -> Result:
    """Simplify a cloud in memory: prepare its points, choose among them, and add what the options ask for."""
    from gppcs.spatial.scaling import Frame, bounds

    units = units_of(options.unit, cloud.header)
    with timer("preparation"):
        check_order(cloud, options.order)
        if options.scores:
            _check_scores(cloud)
        points = cloud.points
        lower, upper = bounds(points)
        indices = None if np.isfinite([lower, upper]).all() else _finite_indices(cloud, options.invalid)
    outliers = None
    if options.drop_outliers:
        indices, outliers = _without_outliers(cloud, indices, units, timer)
    with timer("preparation"):
        constraints = Constraints()
        if options.constrains_points:
            usable = np.arange(len(cloud)) if indices is None else indices
            constraints = Constraints.from_cloud(cloud, usable, options)
            check_constraints(options, len(constraints.keep), WeightRange.from_weights(constraints.weights))
        if indices is not None:
            points = points[indices]
            lower, upper = bounds(points)
        frame = Frame.from_bounds(lower, upper, units)
        points = frame.local(points)
        diagonal = float(np.linalg.norm(frame.local(upper[np.newaxis])))
        scale = Scale(diagonal, units, frame.exponent)
    selection = choose_by_options(points, options, constraints, scale, timer)
    kept = cloud.take(selection.indices if indices is None else indices[selection.indices])
    if options.denoises:
        selection = _with_shifts(selection, points, frame.exponent)
    if selection.points is not None:
        kept = kept.moved(frame.world(selection.points))
    if selection.normals is not None and (original := kept.normals()) is not None:
        from gppcs.surface.normals import with_signs_of

        kept = with_normals(kept, with_signs_of(selection.normals, original))
    if options.normals:
        with timer("normals"):
            kept = _with_estimated_normals(kept, points, selection)
    if indices is not None:
        selection = replace(selection, indices=indices[selection.indices])
    return _result(selection, kept, outliers, len(points), options, timer)


def _finite_indices(cloud: PointCloud, invalid: str) -> Ints:
    """Return the indices of the points with finite coordinates, if the others may be dropped."""
    bad = np.flatnonzero(~cloud.is_finite())
    check_finite(len(cloud), len(bad), int(bad[0]) if len(bad) else 0, invalid)
    return np.delete(np.arange(len(cloud)), bad)


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


def _with_scores(kept: PointCloud, selection: Selection) -> PointCloud:
    """Return the kept points with the scores of the method; 0 for points that it did not choose."""
    scores = {name: np.zeros(len(kept), dtype=np.float32) for name in SCORES}
    for name, values in selection.attributes.items():
        scores[name][:] = values
    return replace(kept, attributes={**kept.attributes, **scores})


def _check_preview(files: CloudFiles, options: Options) -> None:
    """Check by the first points that what the options add can be added."""
    check_order(files.preview, options.order)
    if options.scores:
        _check_scores(files.preview)


def _check_scores(cloud: PointCloud) -> None:
    """Check that scores can be added to a cloud."""
    if taken := sorted(set(SCORES) & set(cloud.attributes)):
        raise InputError(
            f"the cloud already has an attribute {taken[0]!r}, which the scores would replace: "
            "rename it, or ask for no scores"
        )


def _result(
    selection: Selection, kept: PointCloud, outliers: Ints | None, n: int, options: Options, timer: Timer
) -> Result:
    """Return the result of a choice among n points."""
    if options.scores:
        kept = _with_scores(kept, selection)
    method, diagnostics, indices = options.algorithm, dict(selection.diagnostics), selection.indices
    if outliers is not None:
        diagnostics["outliers"] = float(len(outliers))
    is_ranked = Feature.RANKING in method.supports and selection.ranked and options.order == "importance"
    if options.order != "importance":
        positions = in_order(kept, indices, options.order)
        indices, kept = indices[positions], kept.take(positions)
    return Result(indices, kept, method, dict(timer.seconds), diagnostics, outliers, is_ranked, n)
