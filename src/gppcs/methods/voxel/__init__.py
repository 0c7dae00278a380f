"""The method `voxel`: one point for each occupied cell of a grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection, parameter

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from gppcs.spatial.boxes import Each
    from gppcs.spatial.chunks import ChunkedPoints

LEAST_EDGE = 1e-12  # Of cells, in sizes of the cloud: a finer grid has more cells than whole numbers can count.


@dataclass(frozen=True)
class Voxel(Method):
    """Voxel grid: one point for each occupied cell.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("sphere", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=100, method=gppcs.Voxel(place="mean")).cloud)
    100
    """

    name = "voxel"
    summary = "one point for each occupied cell of a grid: the point nearest the mean of the cell's points, or the mean"
    description = (
        "Keeps one point for each occupied cell of a cubic grid. The edge length of the cells is chosen so that about "
        "the right number of cells is occupied, and not too few; sample elimination then removes the most crowded of "
        "the surplus points. The kept points are in the order of the input."
    )
    source = "baseline; the edge length of the cells is found by bisection"
    spacing = "The edge length of the cells; each occupied cell keeps one point."
    bytes_per_point: ClassVar[int] = 170

    place: Literal["representative", "mean"] = parameter(
        "representative",
        'What to keep of each cell: with "representative", the point nearest the mean of its points; with "mean", the '
        "mean itself, with the attributes of that point.",
    )

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method.__call__`."""
        from gppcs.methods.sample_elimination.elimination import thin
        from gppcs.methods.voxel.grid import cell_edge, representatives

        stages = Stages.of(stages)
        with stages("size of cells"):
            corner = points.min(axis=0)
            points = points - corner
            edge = cell_edge(points, n_points)
        with stages("representatives"):
            indices, means = representatives(points, edge)
        with stages("elimination"):
            kept, _ = thin(points[indices], n_points)
        return Selection(indices[kept], {}, means[kept] + corner if self.place == "mean" else None)

    def at_spacing(self, points: NDArray[np.float64], spacing: float, stages: Stages) -> Selection:
        """Keep one point for each occupied cell of this edge length; see `Method.at_spacing`.

        Parameters
        ----------
        points : (N, 3) array, float64
            Finite and without repeats.
        spacing : float
            In the unit of the points.
        stages : Stages
            Times "representatives".

        Returns
        -------
        Selection
        """
        from gppcs.methods.voxel.grid import representatives

        with stages("representatives"):
            corner = points.min(axis=0)
            indices, means = representatives(points - corner, max(spacing, LEAST_EDGE))
        return Selection(indices, {}, means + corner if self.place == "mean" else None)

    def in_tiles(
        self, points: ChunkedPoints, n_points: int, folder: Path, stages: Stages, each: Each = map
    ) -> Selection:
        """Choose the same points as in memory, with all but one tile on disk; see `Method.in_tiles`.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        n_points : int
            M, from 1 to N - 1.
        folder : path
            An empty folder, or that of an interrupted call.
        stages : Stages
            Times "sample", "boxes", "size of cells", "representatives" and "elimination".
        each : callable, optional
            Applies a function to each tile, like `map`.

        Returns
        -------
        Selection
        """
        import numpy as np

        from gppcs.methods.sample_elimination.elimination import thin
        from gppcs.methods.voxel.tiles import representatives_in_tiles
        from gppcs.spatial.chunks import first_repeats

        found = representatives_in_tiles(points, n_points, folder, stages, each)
        with stages("elimination"):
            kept = thin(found.places, n_points)[0] if len(found.rows) > n_points else np.arange(len(found.rows))
        rows = found.rows[kept]
        repeats = first_repeats(rows, n_points)
        moved = found.means[kept] if self.place == "mean" and not len(repeats) else None
        return Selection(np.concatenate([rows, repeats]), {}, moved)

    def memory_in_tiles(self, n: int, n_points: int) -> int:
        """Return about how much memory `in_tiles` takes; see `Method.memory_in_tiles`.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.

        Returns
        -------
        int
            Bytes.
        """
        return 250_000_000 + 500 * n_points

    def disk_in_tiles(self, n: int, n_points: int) -> int:
        """Return about how much disk space `in_tiles` takes; see `Method.disk_in_tiles`.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.

        Returns
        -------
        int
            Bytes.
        """
        from gppcs.spatial.stored import BYTES_ON_DISK

        return BYTES_ON_DISK * n
