"""Runs several methods on one cloud and evaluates each result in the same way."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Literal

from gppcs.amounts.options import Options, method_of
from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.clouds.ranges import weights_of_detail
from gppcs.engine.memory import available_memory
from gppcs.engine.timer import COMPILATION, Timer, timer_of
from gppcs.errors import NoSurfaceError, ParameterError, shown
from gppcs.evaluation.judge import judged, require_mesh
from gppcs.evaluation.reconstruction import estimated_normals, reconstruct, without_membranes
from gppcs.evaluation.report import Report
from gppcs.io.reading import as_cloud
from gppcs.methods import METHODS, Feature, Method
from gppcs.methods.parameters import parameters_of
from gppcs.result import Result
from gppcs.simplification import simplify
from gppcs.spatial.scaling import normalised

PREPARATION_POINTS = 30_000  # points of the run that compiles kernels: enough for several parts that choose at once


@dataclass(frozen=True)
class Entry:
    """The result of one method in a comparison.

    Attributes
    ----------
    result : Result
    report : Report
    seconds : float
        Wall time of the simplification, without the compilation of kernels.
    failure : str or None
        Why no surface could be rebuilt.
    """

    result: Result
    report: Report
    seconds: float
    failure: str | None = None

    @property
    def method(self) -> Method:
        """The method with all its parameters."""
        return self.result.method


def compare(
    cloud: CloudLike,
    methods: Iterable[str | Method] | None = None,
    *,
    ratio: float | str | None = None,
    n_points: int | str | None = None,
    mesh: Mesh | None = None,
    seed: int | None = None,
    detail: str | Mapping[str, float] | None = None,
    invalid: Literal["error", "drop"] = "error",
    timer: Timer | None = None,
) -> list[Entry]:
    """Simplify a cloud by several methods and evaluate each result.

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like, path or object that `PointCloud.from_object` takes
        The original.
    methods : iterable of str or Method, optional
        Names from `gppcs.METHODS`, or methods with other parameters. By default all whose memory suffices.
    ratio, n_points, invalid
        As for `gppcs.simplify`. Give exactly one of `ratio` and `n_points`.
    mesh : Mesh, optional
        The original surface, to which a surface rebuilt from each result is compared. This needs PyMeshLab.
    seed : int, optional
        Replaces the seed of each method that has one.
    detail : str or mapping of str to float, optional
        Attributes whose errors are measured, too. Methods that look at attributes let them count in the choice; see
        `gppcs.simplify`.
    timer : Timer, optional
        Reports progress. The times of each run are in its own result.

    Returns
    -------
    list of Entry
        One for each method, in the order of `methods`.

    Raises
    ------
    InputError, ParameterError, MissingExtraError
        As by `gppcs.simplify` and `gppcs.evaluate`. Parameters are checked before any work.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> entries = gppcs.compare(cloud, ["fps", gppcs.Random(seed=3)], ratio=0.1)
    >>> fps, random = entries
    >>> fps.report.covering_radius < random.report.covering_radius
    True
    """
    chosen = checked_methods(METHODS if methods is None else methods, ratio, n_points, seed)
    cloud, timer, weights = as_cloud(cloud), timer_of(timer), weights_of_detail(detail)
    if mesh is not None:
        require_mesh(mesh)
    original = simplify(cloud, ratio=1, invalid=invalid).cloud  # without dropped points
    if methods is None:
        chosen = those_that_fit(chosen, len(original), Options(ratio=ratio, n_points=n_points))
    entries = []
    for method in chosen:
        # A run on a part of the cloud compiles the kernels before the method is timed.
        simplify(original.points[:: max(1, len(original) // PREPARATION_POINTS)], ratio=0.1, method=method)
        start = perf_counter()
        run = Timer(timer.on_progress)
        of_method = weights if Feature.DETAIL in method.supports else None
        result = simplify(
            cloud, ratio=ratio, n_points=n_points, method=method, detail=of_method, invalid=invalid, timer=run
        )
        seconds = perf_counter() - start - result.seconds.get(COMPILATION, 0.0)
        report, failure, _ = judged(original, result.cloud, mesh, timer, list(weights))
        entries.append(Entry(result, report, seconds, str(failure) if failure else None))
    return entries


def those_that_fit(methods: Iterable[Method], n: int, options: Options) -> list[Method]:
    """Return the methods that can choose so many of n points in the memory that is free."""
    free, kept = available_memory(), options.count(n) or n
    return [method for method in methods if free is None or method.memory(n, kept) <= free]


def checked_methods(
    methods: Iterable[str | Method], ratio: float | str | None, n_points: int | str | None, seed: int | None
) -> list[Method]:
    """Return methods with all their parameters, after checking that these are in their ranges."""
    if isinstance(methods, str) or not isinstance(methods, Iterable) or getattr(methods, "ndim", 1) == 0:
        raise ParameterError(f"expected a list of methods or names, such as ['fps', 'random'], found {shown(methods)}")
    chosen = [Options(ratio=ratio, n_points=n_points, method=method).algorithm for method in methods]
    if seed is not None:
        chosen = [method_of(m, {"seed": seed}) if "seed" in parameters_of(m) else m for m in chosen]
    if not chosen:
        raise ParameterError("expected at least one method to compare, found none")
    return chosen


def rebuilt_mesh(cloud: PointCloud, original: PointCloud, mesh: Mesh | None = None) -> Mesh | None:
    """Return the surface rebuilt from a cloud, or one that is there already, for a picture.

    It has not the membranes that close the gaps of an open scan.
    """
    (points, frame), normals = normalised(original.points, original.units), original.normals()
    try:
        if mesh is None:
            kept, guides = frame.near(cloud.points), () if normals is None else (points, normals)
            mesh = reconstruct(kept, estimated_normals(kept, *guides))
            mesh = Mesh(frame.world(mesh.vertices), mesh.faces)
        return Mesh(mesh.vertices, without_membranes(Mesh(frame.near(mesh.vertices), mesh.faces), points).faces)
    except NoSurfaceError:
        return None
