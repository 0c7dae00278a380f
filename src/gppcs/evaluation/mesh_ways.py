"""The ways from a dense cloud to a light mesh that `compare_meshes` puts side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.engine.extras import require_cgal
from gppcs.engine.stages import Stages
from gppcs.errors import MissingExtraError, NoSurfaceError
from gppcs.evaluation.reconstruction import ball_pivoted, decimated, oriented_alike, reconstruct, without_membranes
from gppcs.meshing.pipeline import mesh as meshed
from gppcs.simplification import simplify
from gppcs.spatial.scaling import normalised
from gppcs.surface.normals import estimate_normals


@dataclass(frozen=True)
class Wanted:
    """The mesh that is wanted."""

    cloud: PointCloud
    n_vertices: int
    stages: Stages

    def kept(self) -> NDArray[np.int64]:
        """Return the points that `gp` keeps.

        Shapes: returns (M,).
        """
        return simplify(self.cloud, n_points=self.n_vertices, stages=self.stages).indices


def _ours(wanted: Wanted, moved: bool) -> Mesh:
    return meshed(wanted.cloud, n_points=wanted.n_vertices, moved=moved, stages=wanted.stages).mesh


def _poisson_kept(wanted: Wanted) -> Mesh:
    points, corner, exponent = normalised(wanted.cloud.points)
    kept = points[wanted.kept()]
    return _outside(_poisson(kept, _normals(points, kept, wanted), wanted), corner, exponent)


def _poisson_decimated(wanted: Wanted) -> Mesh:
    points, corner, exponent = normalised(wanted.cloud.points)
    rebuilt = _poisson(points, _normals(points, points, wanted), wanted)
    with wanted.stages("decimation"):
        return _outside(decimated(rebuilt, 2 * wanted.n_vertices), corner, exponent)


def _ball_pivoting(wanted: Wanted) -> Mesh:
    points, corner, exponent = normalised(wanted.cloud.points)
    kept = points[wanted.kept()]
    normals = _normals(points, kept, wanted)
    with wanted.stages("ball pivoting"):
        return _outside(ball_pivoted(kept, normals), corner, exponent)


def _advancing_front(wanted: Wanted) -> Mesh:
    """Join the kept points by CGAL's advancing front (Cohen-Steiner and Da 2004)."""
    point, point_set = require_cgal("Kernel").Point_3, require_cgal("Point_set_3").Point_set_3
    front = require_cgal("Advancing_front_surface_reconstruction")
    kept = wanted.cloud.points[wanted.kept()]
    places, _, _ = normalised(kept)
    corners: list[int] = []
    with wanted.stages("advancing front"):
        given = point_set()
        for place in places.tolist():
            given.insert(point(*place))
        front.advancing_front_surface_reconstruction(given, corners)
        if not corners:
            raise NoSurfaceError(f"the advancing front joined none of the {len(kept)} points")
        mesh = oriented_alike(Mesh(places, np.reshape(corners, (-1, 3))))  # CGAL gives corners in any order
        return Mesh(kept, mesh.faces)


MESH_WAYS: Mapping[str, Callable[[Wanted], Mesh]] = {
    "mesh": partial(_ours, moved=False),
    "mesh-moved": partial(_ours, moved=True),
    "poisson-kept": _poisson_kept,
    "poisson-decimated": _poisson_decimated,
    "ball-pivoting": _ball_pivoting,
    "advancing-front": _advancing_front,
}


def require_way(name: str) -> None:
    """Raise an error if a way needs a package that is missing; PyMeshLab, which all figures need, is not checked."""
    if name == "advancing-front":
        require_cgal("Advancing_front_surface_reconstruction")


def installed_ways() -> list[str]:
    """Return the names of the ways whose packages are installed."""

    def is_installed(name: str) -> bool:
        try:
            require_way(name)
        except MissingExtraError:
            return False
        return True

    return list(filter(is_installed, MESH_WAYS))


def _normals(points: NDArray[np.float64], places: NDArray[np.float64], wanted: Wanted) -> NDArray[np.float64]:
    """Return the normals, (M, 3), of the surface of all points at some places."""
    with wanted.stages("normals"):
        return estimate_normals(points, None if places is points else places)


def _poisson(points: NDArray[np.float64], normals: NDArray[np.float64], wanted: Wanted) -> Mesh:
    """Return the screened Poisson mesh of points (M, 3), without the parts that lie far from all of them."""
    with wanted.stages("Poisson reconstruction"):
        return without_membranes(reconstruct(points, normals), points)


def _outside(made: Mesh, corner: NDArray[np.float64], exponent: int) -> Mesh:
    """Return a mesh of normalised points in the unit of the cloud."""
    return Mesh(np.ldexp(made.vertices, exponent) + corner, made.faces)
