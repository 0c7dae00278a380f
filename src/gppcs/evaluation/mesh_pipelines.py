"""The pipelines from a dense cloud to a light mesh that `compare_meshes` puts side by side."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.engine.extras import require_cgal
from gppcs.engine.timer import Timer
from gppcs.errors import MissingExtraError, NoSurfaceError
from gppcs.evaluation.reconstruction import ball_pivoted, decimated, oriented_alike, reconstruct, without_membranes
from gppcs.meshing.pipeline import mesh as meshed
from gppcs.simplification import simplify
from gppcs.spatial.scaling import normalised
from gppcs.surface.normals import estimate_normals


@dataclass(frozen=True)
class MeshTask:
    """The mesh that a pipeline is to make."""

    cloud: PointCloud
    n_vertices: int
    timer: Timer

    def kept(self) -> NDArray[np.int64]:
        """Return the indices of the points that `gp` keeps, (M,)."""
        return simplify(self.cloud, n_points=self.n_vertices, timer=self.timer).indices

    def poisson(self, points: NDArray[np.float64], normals: NDArray[np.float64]) -> Mesh:
        """Return the screened Poisson mesh of points, (M, 3), without the parts that lie far from all of them."""
        with self.timer("Poisson reconstruction"):
            return without_membranes(reconstruct(points, normals), points)


def _ours(task: MeshTask, moved: bool, effort: int = 0) -> Mesh:
    return meshed(task.cloud, n_points=task.n_vertices, moved=moved, effort=effort, timer=task.timer).mesh


def _with_normals(
    task: MeshTask, kept: bool, join: Callable[[MeshTask, NDArray[np.float64], NDArray[np.float64]], Mesh]
) -> Mesh:
    """Join points, those that `gp` keeps or all, with normals of the surface of all."""
    points, frame = normalised(task.cloud.points)
    vertices = points[task.kept()] if kept else points
    with task.timer("normals"):
        normals = estimate_normals(points, vertices if kept else None)
    made = join(task, vertices, normals)
    return Mesh(frame.world(made.vertices), made.faces)


def _decimated(task: MeshTask, points: NDArray[np.float64], normals: NDArray[np.float64]) -> Mesh:
    rebuilt = task.poisson(points, normals)
    with task.timer("decimation"):
        return decimated(rebuilt, 2 * task.n_vertices)


def _pivoted(task: MeshTask, points: NDArray[np.float64], normals: NDArray[np.float64]) -> Mesh:
    with task.timer("ball pivoting"):
        return ball_pivoted(points, normals)


def _advancing_front(task: MeshTask) -> Mesh:
    """Join the kept points by CGAL's advancing front (Cohen-Steiner and Da 2004)."""
    point, point_set = require_cgal("Kernel").Point_3, require_cgal("Point_set_3").Point_set_3
    front = require_cgal("Advancing_front_surface_reconstruction")
    kept = task.cloud.points[task.kept()]
    vertices, _ = normalised(kept)
    corners: list[int] = []
    with task.timer("advancing front"):
        points = point_set()
        for vertex in vertices.tolist():
            points.insert(point(*vertex))
        front.advancing_front_surface_reconstruction(points, corners)
        if not corners:
            raise NoSurfaceError(f"the advancing front joined none of the {len(kept)} points")
        mesh = oriented_alike(Mesh(vertices, np.reshape(corners, (-1, 3))))  # CGAL gives corners in any order
        return Mesh(kept, mesh.faces)


PIPELINES: Mapping[str, Callable[[MeshTask], Mesh]] = {
    "mesh": partial(_ours, moved=False),
    "mesh-moved": partial(_ours, moved=True),
    "mesh-effort": partial(_ours, moved=True, effort=2),
    "poisson-kept": partial(_with_normals, kept=True, join=MeshTask.poisson),
    "poisson-decimated": partial(_with_normals, kept=False, join=_decimated),
    "ball-pivoting": partial(_with_normals, kept=True, join=_pivoted),
    "advancing-front": _advancing_front,
}


def require_pipeline(name: str) -> None:
    """Raise an error if a pipeline needs a package that is missing, besides PyMeshLab, which all figures need."""
    if name == "advancing-front":
        require_cgal("Advancing_front_surface_reconstruction")


def installed_pipelines() -> list[str]:
    """Return the names of the pipelines whose packages are installed."""
    installed = []
    for name in PIPELINES:
        with contextlib.suppress(MissingExtraError):
            require_pipeline(name)
            installed.append(name)
    return installed
