"""The result of `gppcs.mesh`, and what was measured while it was made."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.engine.equality import ComparedByValue
from gppcs.engine.timer import in_words


@dataclass(frozen=True)
class MeshDiagnostics:
    """What was measured while a mesh was made. Lengths are in the unit of the cloud."""

    dense_points: int  # from which the mesh was made
    noise: float  # root mean square distance of these from the surface; 0 if it is too small to count
    joined_sheets: float  # distance between two sheets that became one, as the points are farther apart; 0 if none did
    # Mean distance from the mesh of the dense points that the first mesh reaches; of a noisy cloud, that of their
    # projections onto the surface before vertices take their last step.
    mean_distance: float
    area_ratio: float  # of the area of the mesh to that of the surface, estimated from the dense points
    off_sheet: float  # fraction of the dense points near which no triangle is, or only one of another sheet
    excluded: float  # fraction of the points of the first mesh that are on no piece of it that is large enough
    open_holes: int  # small holes that stay open because all triangles that would close them cut others
    boundary_loops: int  # closed curves of boundary edges, around holes and pieces; 0 if the mesh is closed
    pieces: int  # connected ones
    genus: int  # handles
    # With `keep`: the number of these points that are no vertices, and of vertices that are none of these points.
    missing: int | None = None
    added: int | None = None
    # With a tolerance of the largest distance: itself, the largest distance of the points that count, and that of a
    # vertex from the local surface of the points.
    tolerance: float | None = None
    largest_distance: float | None = None
    back_distance: float | None = None
    # Points that do not count, repeats once: outliers as `gppcs.find_outliers` finds them, and others that even the
    # full-resolution mesh misses (holes, noise), or that noise moved nearly as far as the tolerance.
    outliers: int | None = None
    off_surface: int | None = None
    unconverged: bool = False  # whether the solver that fits the vertices to noisy points stopped before it converged


@dataclass(frozen=True, eq=False)
class MeshResult(ComparedByValue):
    """A light mesh of a cloud, with the times of the run.

    Attributes
    ----------
    mesh : Mesh
        Oriented triangles between M vertices.
    indices : (M,) array, int64
        The index in the input of each vertex: of the point that it is, or with `moved` of the point that it was.
    cloud : PointCloud
        The vertices as a cloud, with all attributes of these points. If the input has no normals, those estimated
        from all points are added as `nx`, `ny` and `nz`.
    seconds : mapping of str to float
        Wall time of each stage in seconds, in the order of the run. If kernels were compiled meanwhile, that time is
        in an entry of its own, `compilation`.
    diagnostics : MeshDiagnostics
        What was measured: distances, noise, boundary loops, pieces, handles and so on.

    Examples
    --------
    >>> result = gppcs.mesh(gppcs.sample("sphere", n_points=3000), n_points=100)
    >>> isinstance(result, gppcs.MeshResult)
    True
    >>> len(result.mesh.vertices), len(result.mesh.faces), result.diagnostics.boundary_loops
    (100, 196, 0)
    """

    mesh: Mesh
    indices: NDArray[np.int64]
    cloud: PointCloud
    seconds: Mapping[str, float]
    diagnostics: MeshDiagnostics

    def __repr__(self) -> str:
        size = f"{len(self.mesh.vertices):,} vertices, {len(self.mesh.faces):,} triangles"
        return f"MeshResult({size} in {in_words(self.seconds)})"
