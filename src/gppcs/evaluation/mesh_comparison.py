"""Makes light meshes of one cloud by several pipelines and evaluates each mesh in the same way."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from gppcs.amounts.options import Options
from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.clouds.quantities import count_of
from gppcs.engine.arrays import Floats
from gppcs.engine.extras import require_all, require_cgal, require_pymeshlab
from gppcs.engine.timer import Timer, timer_of
from gppcs.errors import InputError, MissingExtraError, NoSurfaceError, ParameterError, nearest_name, shown
from gppcs.evaluation.judge import evaluate_mesh, require_original
from gppcs.evaluation.reconstruction import ball_pivoted, decimated, oriented_alike, reconstruct, without_membranes
from gppcs.evaluation.report import MeshReport
from gppcs.meshing.arguments import MIN_VERTICES
from gppcs.meshing.pipeline import mesh as meshed
from gppcs.scans import sample
from gppcs.simplification import simplify
from gppcs.spatial.scaling import normalised
from gppcs.surface.normals import estimate_normals


@dataclass(frozen=True)
class MeshEntry:
    """The mesh of one pipeline in a comparison."""

    pipeline: str
    mesh: Mesh | None  # in the unit of the cloud; None if the pipeline finds no surface
    report: MeshReport | None  # None if there is no mesh, or if it does not lie on the cloud
    seconds: float  # wall time from the cloud to the mesh, without the compilation of kernels
    failure: str | None = None  # why there is no mesh or no report


def compare_meshes(
    cloud: CloudLike,
    *,
    ratio: float | str | None = None,
    n_points: int | str | None = None,
    pipelines: Iterable[str] | None = None,
    mesh: Mesh | None = None,
    invalid: Literal["error", "drop"] = "error",
    timer: Timer | None = None,
) -> list[MeshEntry]:
    """Make a light mesh of a cloud by several pipelines and evaluate each.

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like, path or object that `PointCloud.from_object` takes
        Points on a surface.
    ratio, n_points
        The number M of vertices, or of points to keep, at least 4; as for `gppcs.simplify`.
    pipelines : iterable of str, optional
        Names of pipelines. By default all whose packages are installed.

        - "mesh": `gppcs.mesh` with M vertices, which are points of the cloud.
        - "mesh-moved": the same with `moved=True`.
        - "mesh-effort": the same with `effort=2`.
        - "poisson-kept": screened Poisson reconstruction of the M points that `gp` keeps, with normals estimated from
          all points; it has more than M vertices. What lies far from all points is cut off.
        - "poisson-decimated": the same of all points, then quadric decimation to 2 M triangles.
        - "ball-pivoting", "advancing-front": these join the M points that `gp` keeps. The second, CGAL's, needs the
          extra `cgal`.
    mesh : Mesh, optional
        The true surface of the cloud. Distances are then measured from its vertices, and to it.
    invalid, timer
        As for `gppcs.simplify`.

    Returns
    -------
    list of MeshEntry
        One for each pipeline, also if it finds no surface.

    Raises
    ------
    InputError, ParameterError, MissingExtraError
        As by `gppcs.simplify` and `gppcs.evaluate_mesh`. Parameters are checked before any work.

    Examples
    --------
    >>> cloud = gppcs.sample("sphere", n_points=3000)
    >>> entries = gppcs.compare_meshes(cloud, n_points=200, pipelines=["mesh", "mesh-moved", "ball-pivoting"])
    >>> [entry.report.genus for entry in entries[:2]]
    [0.0, 0.0]
    >>> entries[1].report.mesh_mean < entries[0].report.mesh_mean
    True
    """
    chosen, timer = checked_pipelines(pipelines, ratio, n_points), timer_of(timer)
    original = simplify(cloud, ratio=1, invalid=invalid).cloud  # without dropped points
    require_original(original, mesh)
    count = Options(ratio=ratio, n_points=n_points).count(len(original))
    assert count is not None
    if count < MIN_VERTICES:
        raise ParameterError(
            f"expected a mesh of at least {MIN_VERTICES} vertices, found {count} of {len(original)} points"
        )
    _load_kernels()
    return [_entry(pipeline, original, count, mesh, Timer(timer.on_progress)) for pipeline in chosen]


def checked_pipelines(
    pipelines: Iterable[str] | None, ratio: float | str | None, n_points: int | str | None
) -> list[str]:
    """Check the names of pipelines and the size, as far as the cloud is not needed, and return the names."""
    if isinstance(pipelines, str) or not isinstance(pipelines, Iterable | None) or getattr(pipelines, "ndim", 1) == 0:
        raise ParameterError(f"expected a list of pipelines, such as ['mesh'], found {shown(pipelines)}")
    chosen = list(filter(is_installed, PIPELINES) if pipelines is None else pipelines)
    if not chosen:
        raise ParameterError("expected at least one pipeline to compare, found none")
    for name in chosen:
        if not (isinstance(name, str) and name in PIPELINES):
            raise ParameterError(f"there is no pipeline {shown(name)}{nearest_name(name, PIPELINES)}")
    size = Options(ratio=ratio, n_points=n_points).size
    if isinstance(size, int):
        count_of("n_points", size, MIN_VERTICES)
    require_all(require_pymeshlab, *(partial(require_pipeline, name) for name in chosen))
    return chosen


def _entry(pipeline: str, cloud: PointCloud, count: int, surface: Mesh | None, timer: Timer) -> MeshEntry:
    """Return what one pipeline gives."""
    made, report, failure = None, None, None
    clock = Timer()
    try:
        with clock(pipeline):
            made = PIPELINES[pipeline](cloud, count, timer)
        report = evaluate_mesh(cloud, made, surface, timer)
    except InputError as error:  # no surface, or one that does not lie on the cloud, as cloud and surface are checked
        failure = str(error)
    return MeshEntry(pipeline, made, report, clock.seconds[pipeline], failure)


@functools.cache
def _load_kernels() -> None:
    """Mesh and simplify a clean and a noisy cloud once, so that no measured time includes the loading of kernels."""
    for noise in (0.0, 0.01):
        cloud = sample("sphere", n_points=5_000, noise=noise)
        meshed(cloud, n_points=100, effort=1)
        simplify(cloud, n_points=100)


def _ours(cloud: PointCloud, n_vertices: int, timer: Timer, moved: bool, effort: int = 0) -> Mesh:
    return meshed(cloud, n_points=n_vertices, moved=moved, effort=effort, timer=timer).mesh


def _poisson(points: Floats, normals: Floats) -> Mesh:
    """Return the screened Poisson mesh of points, (M, 3), without the parts that lie far from all of them."""
    return without_membranes(reconstruct(points, normals), points)


def _of_kept(cloud: PointCloud, n_vertices: int, timer: Timer, join: Callable[[Floats, Floats], Mesh]) -> Mesh:
    """Join the points that `gp` keeps, with normals of the surface of all."""
    points, frame = normalised(cloud.points, cloud.units)
    vertices = points[simplify(cloud, n_points=n_vertices, timer=timer).indices]
    with timer("normals"):
        normals = estimate_normals(points, vertices)
    with timer("joining points"):
        made = join(vertices, normals)
    return Mesh(frame.world(made.vertices), made.faces)


def _decimated(cloud: PointCloud, n_vertices: int, timer: Timer) -> Mesh:
    """Join all points, and thin the mesh."""
    points, frame = normalised(cloud.points, cloud.units)
    with timer("normals"):
        normals = estimate_normals(points)
    with timer("Poisson reconstruction"):
        rebuilt = _poisson(points, normals)
    with timer("decimation"):
        made = decimated(rebuilt, 2 * n_vertices)
    return Mesh(frame.world(made.vertices), made.faces)


def _advancing_front(vertices: Floats, _: Floats) -> Mesh:
    """Join points by CGAL's advancing front (Cohen-Steiner and Da 2004)."""
    point, point_set = require_cgal("Kernel").Point_3, require_cgal("Point_set_3").Point_set_3
    front = require_cgal("Advancing_front_surface_reconstruction")
    corners: list[int] = []
    points = point_set()
    for vertex in vertices.tolist():
        points.insert(point(*vertex))
    front.advancing_front_surface_reconstruction(points, corners)
    if not corners:
        raise NoSurfaceError(f"the advancing front joined none of the {len(vertices)} points")
    return oriented_alike(Mesh(vertices, np.reshape(corners, (-1, 3))))  # CGAL gives corners in any order


PIPELINES: Mapping[str, Callable[[PointCloud, int, Timer], Mesh]] = {
    "mesh": partial(_ours, moved=False),
    "mesh-moved": partial(_ours, moved=True),
    "mesh-effort": partial(_ours, moved=True, effort=2),
    "poisson-kept": partial(_of_kept, join=_poisson),
    "poisson-decimated": _decimated,
    "ball-pivoting": partial(_of_kept, join=ball_pivoted),
    "advancing-front": partial(_of_kept, join=_advancing_front),
}


def require_pipeline(name: str) -> None:
    """Raise an error if a pipeline lacks a package besides PyMeshLab, which all figures need."""
    if name == "advancing-front":
        require_cgal("Advancing_front_surface_reconstruction")


def is_installed(pipeline: str) -> bool:
    """Return whether a pipeline has its packages."""
    try:
        require_pipeline(pipeline)
    except MissingExtraError:
        return False
    return True
