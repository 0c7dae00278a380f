"""Makes light meshes of one cloud in several ways and evaluates each in the same way."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from gppcs.clouds.cloud import CloudLike
from gppcs.clouds.mesh import Mesh
from gppcs.clouds.quantities import Amount, count_of
from gppcs.engine.extras import require_all, require_pymeshlab
from gppcs.engine.timer import Timer, timer_of
from gppcs.errors import InputError, NoSurfaceError, ParameterError, nearest_name, shown
from gppcs.evaluation.judge import evaluate_mesh, require_original
from gppcs.evaluation.mesh_ways import MESH_WAYS, MeshTask, installed_ways, require_way
from gppcs.evaluation.report import MeshReport
from gppcs.meshing.pipeline import FEWEST_VERTICES
from gppcs.meshing.pipeline import mesh as meshed
from gppcs.scans import sample
from gppcs.simplification import simplify

LOADING_POINTS = 5_000  # points of the runs that load kernels


@dataclass(frozen=True)
class MeshEntry:
    """The mesh that one way gives, in a comparison.

    Attributes
    ----------
    way : str
        The name of the way.
    mesh : Mesh or None
        The mesh, in the unit of the cloud; None if the way finds no surface.
    report : MeshReport or None
        The figures of the mesh; None if there is no mesh, or if it does not lie on the cloud.
    seconds : float
        Wall time from the cloud to the mesh, without the compilation of kernels.
    failure : str or None
        Why there is no mesh or no report; None if both are there.

    Examples
    --------
    >>> cloud = gppcs.sample("sphere", n_points=3000)
    >>> (entry,) = gppcs.compare_meshes(cloud, n_points=100, ways=["mesh"])
    >>> entry.way, len(entry.mesh.vertices), entry.report.borders, entry.failure
    ('mesh', 100, 0, None)
    """

    way: str
    mesh: Mesh | None
    report: MeshReport | None
    seconds: float
    failure: str | None = None


def compare_meshes(
    cloud: CloudLike,
    *,
    ratio: float | str | None = None,
    n_points: int | str | None = None,
    ways: Iterable[str] | None = None,
    mesh: Mesh | None = None,
    invalid: Literal["error", "drop"] = "error",
    timer: Timer | None = None,
) -> list[MeshEntry]:
    """Make a light mesh of a cloud in several ways and evaluate each.

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like, path or object that `PointCloud.from_object` takes
        Points on a surface.
    ratio : float
        The size M as a share of the N points, above 0 and at most 1. Give exactly one of `ratio` and `n_points`.
    n_points : int
        The size M itself, at least 4: the number of vertices, or of points to keep.
    ways : iterable of str, optional
        Names of ways. By default all ways whose packages are installed.

        - "mesh": `gppcs.mesh` with M vertices, which are points of the cloud.
        - "mesh-moved": the same with `moved=True`.
        - "mesh-effort": the same with `effort=2`.
        - "poisson-kept": `gp` keeps M points, with normals estimated from all N points. Screened Poisson
          reconstruction makes a mesh of them, which has more than M vertices. Its parts that lie far from all points
          are cut off.
        - "poisson-decimated": screened Poisson reconstruction of all N points, cut in the same way, then quadric
          decimation to 2 M triangles.
        - "ball-pivoting": `gp` keeps M points. Ball pivoting joins them.
        - "advancing-front": `gp` keeps M points. CGAL's advancing front joins them. It needs the extra `cgal`.
    mesh : Mesh, optional
        The true surface of the cloud. Distances are then measured from its vertices, and to it.
    invalid, timer
        As for `gppcs.simplify`.

    Returns
    -------
    list of MeshEntry
        One for each way, in the order of `ways`. If a way finds no surface, its entry says why.

    Raises
    ------
    InputError
        If the cloud is empty, malformed or not finite, or `mesh` does not lie on it.
    ParameterError
        If a parameter is out of its range, or a way does not exist. Parameters are checked before any work.
    MissingExtraError
        If PyMeshLab is not installed, or CGAL is not and its way is asked for.

    Examples
    --------
    >>> cloud = gppcs.sample("sphere", n_points=3000)
    >>> entries = gppcs.compare_meshes(cloud, n_points=200, ways=["mesh", "mesh-moved", "ball-pivoting"])
    >>> [entry.report.genus for entry in entries[:2]]
    [0.0, 0.0]
    >>> entries[1].report.mesh_mean < entries[0].report.mesh_mean
    True
    """
    chosen, timer = checked_ways(ways, ratio, n_points), timer_of(timer)
    original = simplify(cloud, ratio=1, invalid=invalid).cloud  # without dropped points
    require_original(original, mesh)
    count = Amount.of(ratio, n_points).known_count(len(original))
    assert count is not None
    if count < FEWEST_VERTICES:
        raise ParameterError(
            f"expected a mesh of at least {FEWEST_VERTICES} vertices, found {count} of {len(original)} points"
        )
    _load_kernels()
    return [_entry(way, MeshTask(original, count, Timer(timer.on_progress)), mesh) for way in chosen]


def checked_ways(ways: Iterable[str] | None, ratio: float | str | None, n_points: int | str | None) -> list[str]:
    """Check the names of ways and the size, as far as the cloud is not needed, and return the names."""
    if isinstance(ways, str) or not isinstance(ways, Iterable | None) or getattr(ways, "ndim", 1) == 0:
        raise ParameterError(f"expected a list of ways, such as ['mesh', 'ball-pivoting'], found {shown(ways)}")
    chosen = installed_ways() if ways is None else list(ways)
    if not chosen:
        raise ParameterError("expected at least one way to compare, found none")
    for way in chosen:
        if not (isinstance(way, str) and way in MESH_WAYS):
            raise ParameterError(f"there is no way to a mesh {shown(way)}{nearest_name(way, MESH_WAYS)}")
    asked = Amount.of(ratio, n_points)
    if asked.n_points is not None:
        count_of("n_points", asked.n_points, FEWEST_VERTICES)
    require_all(require_pymeshlab, *(partial(require_way, way) for way in chosen))
    return chosen


def _entry(way: str, task: MeshTask, mesh: Mesh | None) -> MeshEntry:
    """Return what one way gives."""
    made, report, failure = None, None, None
    timer = Timer()
    try:
        with timer(way):
            made = MESH_WAYS[way](task)
    except NoSurfaceError as error:
        failure = str(error)
    if made is not None:
        try:
            report = evaluate_mesh(task.cloud, made, mesh, task.timer)
        except InputError as error:  # of this mesh, as cloud and surface have been checked
            failure = str(error)
    return MeshEntry(way, made, report, timer.seconds[way], failure)


@functools.cache
def _load_kernels() -> None:
    """Mesh and simplify a clean and a noisy cloud once, so that the time of no way includes the loading of kernels."""
    for noise in (0.0, 0.01):
        cloud = sample("sphere", n_points=LOADING_POINTS, noise=noise)
        meshed(cloud, n_points=100, effort=1)
        simplify(cloud, n_points=100)
