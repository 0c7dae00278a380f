"""Several methods on one cloud, each simplified to the same number of points and judged alike."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from time import perf_counter
from typing import Literal

from numpy.typing import ArrayLike

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.engine.stages import Stages
from gppcs.errors import NoSurfaceError, ParameterError
from gppcs.evaluation.judge import judged
from gppcs.evaluation.report import Report
from gppcs.methods import METHODS, Method
from gppcs.simplification import Result, simplify

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
        Why the report lacks figures of the rebuilt mesh, where no surface could be rebuilt.
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
    invalid: Literal["error", "drop"] = "error",
    stages: Stages | None = None,
) -> list[Entry]:
    """Simplify a cloud by several methods and evaluate what each made of it.

    Parameters
    ----------
    cloud : PointCloud or (N, 3) array-like
        The original.
    methods : iterable of str or Method
        Names, or methods with parameters of their own.
    ratio, n_points, seed, invalid
        As for `gppcs.simplify`.
    mesh : Mesh, optional
        As for `gppcs.evaluate`.
    stages : Stages, optional
        One with a listener tells it of the progress; each result has the times of its own stages.

    Returns
    -------
    list of Entry
        One for each method, in their order.

    Raises
    ------
    InputError, ParameterError, MissingExtraError
        As `gppcs.simplify` and `gppcs.evaluate` do, parameters before any work; but a surface that cannot be rebuilt
        is told in the entry.
    """
    chosen = checked_methods(methods, ratio, n_points, seed)
    cloud, stages = PointCloud.of(cloud), stages or Stages()
    original = simplify(cloud, ratio=1, invalid=invalid).cloud  # without the points that are dropped
    entries = []
    for method in chosen:
        _prepare_kernels(original, method)
        start = perf_counter()
        result = simplify(
            cloud, ratio=ratio, n_points=n_points, method=method, invalid=invalid, stages=stages.anew()
        )  # fmt: skip
        seconds = perf_counter() - start
        report, failure = judged(original, result.cloud, mesh, stages)
        entries.append(Entry(result, report, seconds, str(failure) if failure else None))
    return entries


def checked_methods(
    methods: Iterable[str | Method], ratio: float | None, n_points: int | None, seed: int | None
) -> list[Method]:
    """Return the methods with all their parameters; raise a ParameterError unless everything is in its range."""
    point = [[0.0, 0.0, 0.0]]  # on which no method has work to do
    chosen = [
        simplify(point, ratio=ratio, n_points=n_points, method=method, seed=seed).method for method in methods
    ]  # fmt: skip
    if not chosen:
        raise ParameterError("expected at least one method to compare, found none")
    return chosen


def rebuilt_mesh(cloud: PointCloud, original: PointCloud) -> Mesh | None:
    """Return the surface rebuilt from a cloud, to be looked at, or None where none comes out.

    Its normals have the sign of those that the original carries nearest by; where it carries none, they agree with
    their neighbours.

    Raises
    ------
    MissingExtraError
        If PyMeshLab is not installed.
    """
    from gppcs.evaluation.reconstruction import estimated_normals, reconstruct

    normals = original.normals()
    corner = original.points.min(axis=0)
    points = cloud.points - corner
    guides = () if normals is None else (original.points - corner, normals)
    try:
        mesh = reconstruct(points, estimated_normals(points, *guides))
    except NoSurfaceError:
        return None
    return mesh.shifted(corner)


def _prepare_kernels(original: PointCloud, method: Method) -> None:
    """Run the method on a part of the cloud, so that its kernels are there when it is timed."""
    simplify(original.points[:: max(1, len(original) // PREPARATION)], ratio=0.1, method=method)
