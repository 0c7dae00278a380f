"""Several methods on one cloud, each simplified to the same number of points and judged alike."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from time import perf_counter

from numpy.typing import ArrayLike

from gppcs.cloud import PointCloud
from gppcs.errors import InputError
from gppcs.evaluation.judge import evaluate
from gppcs.evaluation.report import Report
from gppcs.mesh import Mesh
from gppcs.methods import METHODS, Method
from gppcs.simplification import Result, simplify
from gppcs.stages import Stages

PREPARATION = 6_000  # points, at least, of the run that compiles kernels: enough for all stages of any method


@dataclass(frozen=True)
class Entry:
    """What one method made of the cloud.

    Attributes
    ----------
    result : Result
        The simplified cloud and the method.
    report : Report
        Its figures.
    seconds : float
        Wall time of the simplification, without the compilation of its kernels.
    failure : str, optional
        Why the report lacks the figures of the rebuilt mesh, where no surface could be rebuilt.
    """

    result: Result
    report: Report
    seconds: float
    failure: str | None = None


def compare(
    cloud: PointCloud | ArrayLike,
    methods: Iterable[str | Method] = tuple(METHODS),
    *,
    ratio: float | None = None,
    n_points: int | None = None,
    mesh: Mesh | None = None,
    seed: int | None = None,
    stages: Stages | None = None,
) -> list[Entry]:
    """Simplify a cloud by several methods and evaluate what each made of it.

    Parameters
    ----------
    cloud : PointCloud or (N, 3) array-like
        With finite coordinates.
    methods : iterable of str or Method
        Names, or methods with parameters of their own.
    ratio, n_points, seed
        As for `gppcs.simplify`.
    mesh : Mesh, optional
        As for `gppcs.evaluate`.
    stages : Stages, optional
        Hears of the progress.

    Returns
    -------
    list of Entry
        One for each method, in their order.

    Raises
    ------
    InputError, ParameterError, MissingExtraError
        As `gppcs.simplify` and `gppcs.evaluate` do, but for a surface that cannot be rebuilt.
    """
    cloud = PointCloud.of(cloud)
    stages = stages or Stages()
    entries = []
    for method in methods:
        _prepare_kernels(cloud, method)
        start = perf_counter()
        result = simplify(cloud, ratio=ratio, n_points=n_points, method=method, seed=seed, stages=stages)
        seconds = perf_counter() - start
        report, failure = _judged(cloud, result.cloud, mesh, stages)
        entries.append(Entry(result, report, seconds, failure))
    return entries


def _prepare_kernels(cloud: PointCloud, method: str | Method) -> None:
    """Run the method on a part of the cloud, so that its kernels are there when it is timed."""
    part = cloud.take(cloud.finite_rows()[:: max(1, len(cloud) // PREPARATION)])
    if len(part):
        simplify(part, ratio=0.1, method=method)


def _judged(
    original: PointCloud, simplified: PointCloud, mesh: Mesh | None, stages: Stages
) -> tuple[Report, str | None]:
    """Return the figures, without those of the rebuilt mesh and with the reason where there is none."""
    try:
        return evaluate(original, simplified, mesh, stages), None
    except InputError as error:
        if mesh is None:
            raise
        return evaluate(original, simplified, None, stages), str(error)
